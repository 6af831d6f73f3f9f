"""How well two views agree: the share of matches that the other view confirms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.disparity.census import census_transform, similarity_volume

BOX = 9
"""Side of the window that is summed before the best disparity is taken, pixels."""


LEAST_COUNTED = 0.05
"""Share of the pixels that must count for the answer to mean anything."""


def consistent_share(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    usable_main: NDArray[np.bool_],
    usable_auxiliary: NDArray[np.bool_],
    *,
    max_disparity: int,
) -> float:
    """Return the share of auxiliary pixels whose best match has them as its own best match.

    A plain window match for checking a pair, on small images: memory is H x W x D floats.

    Parameters
    ----------
    main, auxiliary
        ``(H, W)`` float32 luminance or luma of both views.
    usable_main, usable_auxiliary
        ``(H, W)`` bool, well-exposed pixels. An auxiliary pixel counts if it and most of its search range are.
    max_disparity
        d_max, pixels; pixels whose search would leave the main view do not count.

    Returns
    -------
    0..1, disparities that differ by at most 1 px count as the same; NaN when hardly any pixel counts. Unrelated
    images reach about 0.3 to 0.5 by chance.
    """
    width = main.shape[1]
    codes = [census_transform(view, threads=1) for view in (auxiliary, main)]
    similarity = similarity_volume(codes[0], codes[1], max_disparity=max_disparity)
    score = _box_sum(_box_sum(similarity.astype(np.uint16), axis=0), axis=1)
    of_auxiliary = score.argmax(axis=2)
    seen_from_main = np.zeros_like(score)
    for d in range(max_disparity + 1):
        seen_from_main[:, d:, d] = score[:, : width - d, d]
    of_main = seen_from_main.argmax(axis=2)

    column = np.arange(width)
    partner = np.minimum(column + of_auxiliary, width - 1)
    confirmed = np.abs(np.take_along_axis(of_main, partner, axis=1) - of_auxiliary) <= 1
    last = np.minimum(column + max_disparity + 1, width)
    before = np.pad(np.cumsum(usable_main, axis=1), ((0, 0), (1, 0)))
    range_usable = before[:, last] - before[:, column] > 0.5 * (max_disparity + 1)
    counted = usable_auxiliary & range_usable & (column + max_disparity < width)
    return float(confirmed[counted].mean()) if counted.mean() > LEAST_COUNTED else float("nan")


def _box_sum(volume: NDArray[np.uint16], *, axis: int) -> NDArray[np.uint16]:
    """Sum `BOX` neighbours along an axis; there is nothing beyond the ends."""
    padding = [(0, 0)] * volume.ndim
    padding[axis] = (BOX // 2, BOX // 2)
    padded = np.moveaxis(np.pad(volume, padding), axis, 0)
    total = np.zeros_like(volume)
    for start in range(BOX):
        total += np.moveaxis(padded[start : start + volume.shape[axis]], 0, axis)
    return total
