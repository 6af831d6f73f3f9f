"""Hot loop of demosaicing; a readable twin is in tests/reference/demosaicing.py."""

from __future__ import annotations

import numpy as np

from stereohdr.kernels import kernel


@kernel
def _mirrored(index, size):
    """Return the index that a mirror at the border shows; it keeps the phase of the Bayer pattern."""
    while index < 0 or index >= size:
        index = -index if index < 0 else 2 * size - 2 - index
    return index


@kernel
def interpolate_colours(mosaic, colours, white, strength, rgb):
    """Write the three colours of every pixel of a Bayer mosaic to `rgb`.

    `colours` holds the channel (0..2) of each pixel of the 2x2 cell; ``strength[k, c]`` scales the curvature of
    channel c, sampled at the pixel itself, that is added to the mean of the neighbours of channel k. Where a mean
    would take in samples on both sides of a hard edge of clipping, the whole pixel is white.
    """
    height, width = mosaic.shape
    near = np.empty((3, 3))
    for y in range(height):
        for x in range(width):
            own = colours[y & 1, x & 1]
            beside = colours[y & 1, (x + 1) & 1]  # the channel to the left and to the right
            for i in range(3):
                for j in range(3):
                    near[i, j] = mosaic[_mirrored(y + i - 1, height), _mirrored(x + j - 1, width)]
            north = float(mosaic[_mirrored(y - 2, height), x])
            south = float(mosaic[_mirrored(y + 2, height), x])
            west = float(mosaic[y, _mirrored(x - 2, width)])
            east = float(mosaic[y, _mirrored(x + 2, width)])
            lowest_axial = min(near[0, 1], near[2, 1], near[1, 0], near[1, 2])
            highest_axial = max(near[0, 1], near[2, 1], near[1, 0], near[1, 2])
            lowest_diagonal = min(near[0, 0], near[0, 2], near[2, 0], near[2, 2])
            highest_diagonal = max(near[0, 0], near[0, 2], near[2, 0], near[2, 2])
            diagonal = near[0, 0] + near[0, 2] + near[2, 0] + near[2, 2]
            highest_own = max(near[1, 1], north, south, west, east)
            if own == 1:
                highest_own = max(highest_own, highest_diagonal)

            at_edge = False
            for channel in range(3):
                if channel == own:
                    rgb[y, x, channel] = mosaic[y, x]
                    continue
                if own == 1:  # red or blue at green
                    if channel == beside:
                        first, second = near[1, 0], near[1, 2]
                        along, across = west + east, north + south
                    else:
                        first, second = near[0, 1], near[2, 1]
                        along, across = north + south, west + east
                    low, high = min(first, second), max(first, second)
                    mean = (first + second) / 2
                    curvature = (5 * near[1, 1] - along - diagonal + across / 2) / 8
                elif channel == 1:  # green at red or blue
                    low, high = lowest_axial, highest_axial
                    mean = (near[0, 1] + near[2, 1] + near[1, 0] + near[1, 2]) / 4
                    curvature = (4 * near[1, 1] - (north + south + west + east)) / 8
                else:  # red at blue, blue at red
                    low, high = lowest_diagonal, highest_diagonal
                    mean = diagonal / 4
                    curvature = (6 * near[1, 1] - 1.5 * (north + south + west + east)) / 8
                if high >= white:
                    rgb[y, x, channel] = white
                    at_edge = at_edge or 2 * low < white
                    continue
                if highest_own < white:
                    mean += strength[channel, own] * curvature
                rgb[y, x, channel] = int(np.floor(min(max(mean, low), high) + 0.5))
            if at_edge:
                for channel in range(3):
                    rgb[y, x, channel] = white
