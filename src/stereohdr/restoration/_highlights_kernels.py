"""Hot loops of `restore_highlights`; readable twins in tests/reference/highlights.py.

Radiance is in log units, ``(H, W, C)`` float32; `channel` is the one to restore.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereohdr.kernels import kernel

NOTHING, BORROWED, MEASURED = range(3)
"""Where the auxiliary radiance of a pixel comes from."""


class Views(NamedTuple):
    """What is known, ``(H, W, C)``; see `restore_highlights`."""

    main: NDArray[np.float32]
    clipped: NDArray[np.bool_]
    auxiliary: NDArray[np.float32]
    source: NDArray[np.uint8]
    """Where `auxiliary` comes from."""


class Terms(NamedTuple):
    """What the screened Poisson equation takes, float32; 0 where no pixel to solve for has a part."""

    data: NDArray[np.float32]
    """``(H, W)``, as `data_weight`."""
    data_weight: NDArray[np.float32]
    gradient: NDArray[np.float32]
    """``(2, H, W)``, wanted difference to the next column and to the next row, as `gradient_weight`."""
    gradient_weight: NDArray[np.float32]


class Weights(NamedTuple):
    """1 / error^2 of each kind of term, float32; `HighlightsConfig` has the errors."""

    level: np.float32
    borrowed_level: np.float32
    gradient: np.float32
    borrowed_gradient: np.float32
    colour: np.float32
    smoothness: np.float32


@kernel
def fill_classes(clipped, channel, limits, rows, classes):
    """Write the class of each clipped pixel: by the number of clipped channels, and by its distance from the rim.

    Parameters
    ----------
    limits
        ``(N,)`` int64, rising: the largest squared distances of all but the last class. The distance is that from
        the nearest pixel where the channel is not clipped.
    rows
        ``(H, W)`` uint8, scratch memory: the distance from the nearest one above or below.
    classes
        ``(H, W)`` uint8.
    """
    height, width, channels = clipped.shape
    farthest = 1
    while farthest * farthest <= limits[-1]:
        farthest += 1
    for y in range(height):
        for x in range(width):
            above = rows[y - 1, x] if y > 0 else farthest
            rows[y, x] = min(above + 1, farthest) if clipped[y, x, channel] else 0
    for y in range(height - 2, -1, -1):
        for x in range(width):
            rows[y, x] = min(rows[y, x], rows[y + 1, x] + 1)
    for y in range(height):
        for x in range(width):
            square = np.int64(rows[y, x]) ** 2
            step = 1
            while step * step < square:
                if x >= step:
                    square = min(square, np.int64(rows[y, x - step]) ** 2 + step * step)
                if x + step < width:
                    square = min(square, np.int64(rows[y, x + step]) ** 2 + step * step)
                step += 1
            number = 0
            for c in range(channels):
                number += clipped[y, x, c]
            number *= limits.size + 1
            for limit in limits:
                number += square > limit
            classes[y, x] = number


@kernel
def sum_excess(views, channel, classes, sums):
    """Sum by class how far measured radiance exceeds the clip value.

    `sums` is ``(classes, 3)``: number, sum, and sum of squares.
    """
    height, width = classes.shape
    for y in range(height):
        for x in range(width):
            if views.clipped[y, x, channel] and views.source[y, x, channel] == MEASURED:
                excess = np.float64(views.auxiliary[y, x, channel] - views.main[y, x, channel])
                k = classes[y, x]
                sums[k, 0] += 1
                sums[k, 1] += excess
                sums[k, 2] += excess * excess


@kernel
def fill_terms(views, channel, classes, prior, prior_weight, weights, start, stop, terms):
    """Write rows start to stop of all terms.

    `prior` is how far a pixel of each class is expected to exceed the clip value, and `prior_weight` its weight.
    """
    main, clipped, auxiliary, source = views
    height, width, channels = main.shape
    for y in range(start, stop):
        for x in range(width):
            here = source[y, x, channel]
            if not clipped[y, x, channel]:
                terms.data[y, x] = 0
                terms.data_weight[y, x] = 0
            elif here == NOTHING:
                terms.data[y, x] = main[y, x, channel] + prior[classes[y, x]]
                terms.data_weight[y, x] = prior_weight[classes[y, x]]
            else:
                terms.data[y, x] = auxiliary[y, x, channel]
                terms.data_weight[y, x] = weights.level if here == MEASURED else weights.borrowed_level
            for axis in range(2):
                v, u = y + axis, x + 1 - axis
                wanted = weight = np.float32(0)
                if v < height and u < width and (clipped[y, x, channel] or clipped[v, u, channel]):
                    there = source[v, u, channel]
                    wanted = auxiliary[v, u, channel] - auxiliary[y, x, channel]
                    if here == MEASURED and there == MEASURED:
                        weight = weights.gradient
                    elif here != NOTHING and there != NOTHING:
                        weight = weights.borrowed_gradient
                    else:
                        wanted, count = np.float32(0), np.float32(0)
                        for c in range(channels):
                            if c != channel and not clipped[y, x, c] and not clipped[v, u, c]:
                                wanted += main[v, u, c] - main[y, x, c]
                                count += np.float32(1)
                        wanted = wanted / max(count, np.float32(1))
                        weight = weights.colour if count > 0 else weights.smoothness
                terms.gradient[axis, y, x] = wanted
                terms.gradient_weight[axis, y, x] = weight
