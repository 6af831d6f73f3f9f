"""Hot loops of the survey; readable twins in tests/reference/survey.py."""

from __future__ import annotations

import math

import numpy as np

from stereohdr.kernels import kernel


@kernel
def flat_rows(codes, weights, slopes, darkest, steepest, start, stop, flat):
    """Write where the gradient of the log code, smoothed, is less steep than `steepest`; rows start to stop.

    Parameters
    ----------
    codes
        ``(H, W, C)`` float32; the mean over the channels plus `darkest` is what counts.
    weights, slopes
        ``(2 r + 1,)`` float32, the Gaussian and its derivative.
    flat
        ``(H, W)`` bool.
    """
    height, width, channels = codes.shape
    size = weights.size
    radius = size // 2
    logs = np.zeros((size, width + 2 * radius), dtype=np.float32)  # row y is at y % size
    smooth, steep = np.empty((2, width + 2 * radius), dtype=np.float32)
    across, down = np.empty((2, width), dtype=np.float32)
    seen = max(start - radius, 0)
    for y in range(start, stop):
        while seen <= min(y + radius, height - 1):
            row = logs[seen % size]
            for x in range(width):
                total = np.float32(0)
                for c in range(channels):
                    total += codes[seen, x, c]
                row[x + radius] = math.log(total / np.float32(channels) + darkest)
            row[:radius], row[radius + width :] = row[radius], row[radius + width - 1]
            seen += 1
        smooth[:], steep[:] = 0, 0
        for k in range(size):
            row = logs[min(max(y + k - radius, 0), height - 1) % size]
            add_weighted(row, weights[k], smooth)
            add_weighted(row, slopes[k], steep)
        across[:], down[:] = 0, 0
        for k in range(size):
            add_weighted(smooth[k : k + width], slopes[k], across)
            add_weighted(steep[k : k + width], weights[k], down)
        for x in range(width):
            flat[y, x] = math.sqrt(across[x] * across[x] + down[x] * down[x]) < steepest


@kernel
def add_weighted(values, weight, total):
    for x in range(total.size):
        total[x] += weight * values[x]


@kernel
def count_pairs(main, auxiliary, disparity, used_main, used_auxiliary, counts):
    """Add to ``counts[c, i, j]`` how often knot i of a used main pixel meets knot j of a used auxiliary pixel.

    Knots are ``(H, W, C)`` uint8; the partner of a main pixel is at ``x - d``, rounded as in the two-way matching.
    """
    height, width, channels = main.shape
    for y in range(height):
        for x in range(width):
            place = x - np.float64(disparity[y, x])
            if not (used_main[y, x] and 0 <= place <= width - 1):
                continue
            partner = min(max(x - int(np.rint(disparity[y, x])), 0), width - 1)
            if used_auxiliary[y, partner]:
                for c in range(channels):
                    counts[c, main[y, x, c], auxiliary[y, partner, c]] += 1
