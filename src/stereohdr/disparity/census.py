"""Four-valued census transform with a just-noticeable-difference threshold (equations 2 to 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import CensusConfig
from stereohdr.disparity._kernels import census_planes, similarity_rows
from stereohdr.strips import run_strips


def census_transform(
    luminance: NDArray[np.float32], *, config: CensusConfig | None = None, threads: int | None = None
) -> NDArray[np.uint64]:
    """Code every pixel by comparing its neighbours with it.

    Parameters
    ----------
    luminance
        ``(H, W)`` float32, luminance of linear radiance.
    config
        Window and threshold.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    ``(2, H, W)`` uint64. Bit n of the first plane: neighbour n >= centre; of the second: neighbour n within
    the threshold of the centre. Neighbours in reading order without the centre; the image is extended by its
    border pixels. The four combinations are the codes 0 to 3 of equation 3.
    """
    config = config or CensusConfig()
    radius = config.window // 2
    luminance = np.asarray(luminance, dtype=np.float32)
    padded = np.pad(luminance, radius, mode="edge")
    planes = np.empty((2, *luminance.shape), dtype=np.uint64)
    threshold = np.float32(config.threshold)

    def task(start: int, stop: int) -> None:
        census_planes(padded, radius, threshold, start, stop, planes)

    run_strips(task, luminance.shape[0], strip_rows=64, threads=threads)
    return planes


def similarity_volume(
    auxiliary: NDArray[np.uint64],
    main: NDArray[np.uint64],
    *,
    max_disparity: int,
    rows: tuple[int, int] | None = None,
    config: CensusConfig | None = None,
) -> NDArray[np.uint8]:
    """Count equal census codes of each auxiliary pixel and its possible partners; higher is better.

    Parameters
    ----------
    auxiliary, main
        ``(2, H, W)`` census planes of both views.
    max_disparity
        d_max, pixels.
    rows
        First and one past the last row to compute; all by default.
    config
        The window that made the planes.

    Returns
    -------
    ``(rows, W, d_max + 1)`` uint8: for auxiliary pixel x and disparity d the number of equal codes with main
    pixel x + d (0..48 for a 7x7 window); 0 where x + d is outside the image.
    """
    config = config or CensusConfig()
    start, stop = rows or (0, main.shape[1])
    volume = np.empty((stop - start, main.shape[2], max_disparity + 1), dtype=np.uint8)
    codes = np.uint64(config.window**2 - 1)
    similarity_rows(auxiliary, main, codes, start, stop, volume)
    return volume
