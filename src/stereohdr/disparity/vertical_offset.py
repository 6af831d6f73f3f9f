"""How far the rows of two views are from level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PATCH_RADIUS = 4
"""Patches of 9x9 pixels are compared."""

REACH = 3
"""Offsets from -3 to 3 rows are tried."""

POINTS = 600
"""Places that are looked at, at most."""

FEWEST_POINTS = 40
"""Fewer places with a clear answer say nothing."""

STRIP_ROWS = 64

CLEAR_CORRELATION = 0.8
"""Patches that correlate less are not the same surface."""

SAME_OFFSET = 0.5
"""At least half of the places must lie within this many rows of the median: else they look alike by chance."""


def vertical_offset(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    points: NDArray[np.integer],
    disparities: NDArray[np.floating],
    *,
    uncertainty: int,
) -> float:
    """Measure by how many rows the auxiliary view is too low.

    Parameters
    ----------
    main, auxiliary
        ``(H, W)`` float32, luminance of both views, cut to the range that both can see.
    points
        ``(N, 2)`` rows and columns of the main view whose match is known roughly.
    disparities
        ``(N,)`` their disparities, pixels.
    uncertainty
        How wrong these may be, pixels.

    Returns
    -------
    Row of the auxiliary view minus row of the main view, the median over the places with vertical structure; 0
    when too few of them give a clear answer, or they do not agree. Patches are compared by their correlation,
    which no exposure changes, and the best offset is refined by a parabola.
    """
    margin = PATCH_RADIUS + REACH
    height, width = main.shape
    log_m, log_a = (np.log(np.maximum(view, np.float32(1e-12))) for view in (main, auxiliary))
    rows, columns = points.T
    partners = np.rint(columns - disparities).astype(np.intp)
    inside = (rows >= margin) & (rows < height - margin)
    inside &= (columns >= PATCH_RADIUS) & (columns < width - PATCH_RADIUS)
    inside &= (partners >= PATCH_RADIUS + uncertainty) & (partners < width - PATCH_RADIUS - uncertainty)
    rows, columns, partners = rows[inside], columns[inside], partners[inside]
    if len(rows) == 0:
        return 0.0
    slope = np.abs(log_m[rows + 1, columns] - log_m[rows - 1, columns])
    if len(rows) > POINTS:
        steep = np.flatnonzero(slope >= np.partition(slope, -POINTS)[-POINTS])
        chosen = steep[np.argsort(-slope[steep], kind="stable")[:POINTS]]
        rows, columns, partners = rows[chosen], columns[chosen], partners[chosen]

    own = _normalised(_surroundings(log_m, rows, columns, 0, 0))
    around = _surroundings(log_a, rows, partners, REACH, uncertainty)
    size = 2 * PATCH_RADIUS + 1
    scores = np.full((2 * REACH + 1, len(rows)), -1.0)
    for n in range(2 * REACH + 1):
        for m in range(2 * uncertainty + 1):
            correlation = (own * _normalised(around[:, n : n + size, m : m + size])).sum(axis=1)
            scores[n] = np.maximum(scores[n], correlation)
    best = scores.argmax(axis=0)
    clear = (scores.max(axis=0) > CLEAR_CORRELATION) & (best > 0) & (best < 2 * REACH)
    if clear.sum() < FEWEST_POINTS:
        return 0.0
    column = np.nonzero(clear)[0]
    best = best[clear]
    before, peak, after = (scores[best + step, column] for step in (-1, 0, 1))
    curvature = np.maximum(2 * peak - before - after, 1e-12)
    offsets = best - REACH + 0.5 * (after - before) / curvature
    median = float(np.median(offsets))
    return median if np.mean(np.abs(offsets - median) < SAME_OFFSET) >= 0.5 else 0.0


def level_rows(image: NDArray[np.float32], offset: float) -> NDArray[np.float32]:
    """Shift an image so that row y shows what was at ``y + offset``, interpolated linearly between rows.

    Parameters
    ----------
    image
        ``(H, W)`` or ``(H, W, C)`` float32.
    offset
        Rows; the border rows are repeated.
    """
    if offset == 0:
        return image
    height = len(image)
    level = np.empty_like(image)
    for start in range(0, height, STRIP_ROWS):
        rows = start, min(start + STRIP_ROWS, height)
        level[slice(*rows)] = level_strip(image[slice(*rows_behind(rows, offset, height))], offset, rows, height)
    return level


def rows_behind(rows: tuple[int, int], offset: float, height: int) -> tuple[int, int]:
    """Return the first row, and one past the last, of what `level_rows` makes some rows of an image from."""
    if offset == 0:
        return rows
    first, last = (int(np.clip(np.floor(row + offset), 0, height - 1)) for row in (rows[0], rows[1] - 1))
    return first, min(last + 2, height)


def level_strip(
    image: NDArray[np.float32], offset: float, rows: tuple[int, int], height: int
) -> NDArray[np.float32]:
    """Return some rows of what `level_rows` makes of an image of so many rows, given those of `rows_behind`."""
    if offset == 0:
        return image
    first, _ = rows_behind(rows, offset, height)
    position = np.clip(np.arange(*rows) + offset, 0, height - 1)
    before = np.floor(position).astype(np.intp)
    share = (position - before).astype(np.float32).reshape(-1, *[1] * (image.ndim - 1))
    after = np.minimum(before + 1, height - 1)
    return np.asarray((1 - share) * image[before - first] + share * image[after - first], dtype=np.float32)


def _surroundings(
    image: NDArray[np.float32],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    more_rows: int,
    more_columns: int,
) -> NDArray[np.float32]:
    """Return the patches around some pixels with more rows and columns on all sides, ``(N, height, width)``."""
    dy, dx = (np.arange(-PATCH_RADIUS - more, PATCH_RADIUS + more + 1) for more in (more_rows, more_columns))
    return image[rows[:, None, None] + dy[:, None], columns[:, None, None] + dx]


def _normalised(patches: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return patches as ``(N, 81)``, of mean 0 and length 1 (0 for flat ones)."""
    values = patches.reshape(len(patches), -1)
    values = values - values.mean(axis=1, keepdims=True)
    return values / np.maximum(np.sqrt((values**2).sum(axis=1, keepdims=True)), np.float32(1e-6))
