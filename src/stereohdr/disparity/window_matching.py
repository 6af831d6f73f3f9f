"""Plain window matching of both views: normalised cross-correlation, winner takes all, left-right check."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import BilateralWindowConfig, WindowMatchingConfig
from stereohdr.disparity._kernels import correlation_rows, winner_rows
from stereohdr.model import Disparity, DisparityFlag
from stereohdr.strips import run_strips

STRIP_ROWS = 8
"""Rows of the volume that one thread holds at a time."""


def correlation_volume(
    auxiliary: NDArray[np.float32],
    main: NDArray[np.float32],
    *,
    max_disparity: int,
    rows: tuple[int, int] | None = None,
    config: WindowMatchingConfig | None = None,
    bilateral: BilateralWindowConfig | None = None,
) -> NDArray[np.float32]:
    """Return the zero-mean normalised cross-correlation of each auxiliary pixel and its possible partners.

    Parameters
    ----------
    auxiliary, main
        ``(H, W)`` float32 luminance of both views, or its logarithm.
    max_disparity
        d_max, pixels.
    rows
        First and one past the last row to compute; all by default.
    config
        Window.
    bilateral
        Weights inside the window, each view's own; constant when None.

    Returns
    -------
    ``(rows, W, d_max + 1)`` float32, -1..1: auxiliary pixel x against main pixel x + d. 0 where either patch is
    flat, -2 where x + d is outside the image. Images are extended by their border pixels.

    Notes
    -----
    With weights, both mean and correlation are weighted: the adaptive normalised cross-correlation of Heo, Lee and
    Lee 2011 (PAMI 33).
    """
    config = config or WindowMatchingConfig()
    start, stop = rows or (0, main.shape[0])
    radius = config.window // 2
    padded = [np.pad(np.asarray(image, dtype=np.float32), radius, mode="edge") for image in (auxiliary, main)]
    volume = np.empty((stop - start, main.shape[1], max_disparity + 1), dtype=np.float32)
    weights, range_factor = _window(radius, bilateral)
    correlation_rows(padded[0], padded[1], weights, range_factor, start, stop, volume)
    return volume


def match_windows(
    auxiliary: NDArray[np.float32],
    main: NDArray[np.float32],
    *,
    max_disparity: int,
    config: WindowMatchingConfig | None = None,
    bilateral: BilateralWindowConfig | None = None,
    threads: int | None = None,
) -> tuple[Disparity, Disparity]:
    """Match every pixel of both views.

    Parameters
    ----------
    auxiliary, main
        ``(H, W)`` float32 luminance of both views, or its logarithm.
    max_disparity
        d_max, pixels.
    config, bilateral
        See `correlation_volume`.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    of_main, of_auxiliary
        Integer disparities of the best correlation (ties to the smaller) from the same volume, which is held a few
        rows at a time. ``MATCHED`` where the left-right check confirms the value, ``OCCLUDED`` elsewhere.
    """
    config = config or WindowMatchingConfig()
    height, width = main.shape
    of_main, of_auxiliary = np.zeros((2, height, width), dtype=np.int32)

    def task(start: int, stop: int) -> None:
        volume = correlation_volume(
            auxiliary, main, max_disparity=max_disparity, rows=(start, stop), config=config, bilateral=bilateral
        )
        winner_rows(volume, start, of_main, of_auxiliary)

    run_strips(task, height, strip_rows=STRIP_ROWS, threads=threads)
    return left_right_check(of_main, of_auxiliary, tolerance=config.tolerance)


def left_right_check(
    of_main: NDArray[np.integer], of_auxiliary: NDArray[np.integer], *, tolerance: float = 1.0
) -> tuple[Disparity, Disparity]:
    """Flag the disparities that the other view confirms.

    Parameters
    ----------
    of_main, of_auxiliary
        ``(H, W)`` whole disparities of both views whose partners lie inside the other view.
    tolerance
        Largest difference that counts as confirmed, pixels.

    Returns
    -------
    Both maps: ``MATCHED`` where confirmed, ``OCCLUDED`` elsewhere (the partner has a better match, as happens
    where the other view does not see the point, and where a match is wrong). Values are kept.
    """
    column = np.arange(of_main.shape[1])
    maps = []
    for own, other, partner in (
        (of_main, of_auxiliary, column - of_main),
        (of_auxiliary, of_main, column + of_auxiliary),
    ):
        confirmed = np.abs(np.take_along_axis(other, partner, axis=1) - own) <= tolerance
        flags = np.where(confirmed, DisparityFlag.MATCHED, DisparityFlag.OCCLUDED).astype(np.uint8)
        maps.append(Disparity(own.astype(np.float32), flags))
    return maps[0], maps[1]


def _window(radius: int, bilateral: BilateralWindowConfig | None) -> tuple[NDArray[np.float64], float]:
    """Return the spatial weights and the factor of the squared difference in the exponent, 0 for none."""
    if bilateral is None:
        return np.ones((2 * radius + 1, 2 * radius + 1)), 0.0
    offset = np.arange(-radius, radius + 1)
    squared = offset[:, None] ** 2 + offset[None, :] ** 2
    return np.exp(-squared / (2 * bilateral.spatial_sigma**2)), 0.5 / bilateral.range_sigma**2
