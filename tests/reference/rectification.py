"""Slow, readable twin of the kernel of `stereohdr.rectification`."""

import math

import numpy as np


def interpolate(image, pattern, x, y, slack, out, inside):
    """Interpolate pixel by pixel; arguments as in the kernel."""
    height, width, _ = image.shape
    for i, (px, py) in enumerate(zip(x, y, strict=True)):
        inside[i] = -slack <= px <= width - 1 + slack and -slack <= py <= height - 1 + slack
        if not inside[i]:
            out[i] = 0
            continue
        px, py = np.clip(px, 0, width - 1), np.clip(py, 0, height - 1)
        x0, y0 = min(math.floor(px), max(width - 2, 0)), min(math.floor(py), max(height - 2, 0))
        fx, fy = px - x0, py - y0
        corners = [
            (min(y0 + dy, height - 1), min(x0 + dx, width - 1), (fx if dx else 1 - fx) * (fy if dy else 1 - fy))
            for dy in (0, 1)
            for dx in (0, 1)
        ]
        shares = {}
        for row, column, weight in corners:
            shares[pattern[row, column]] = shares.get(pattern[row, column], 0) + weight
        winner = max(shares, key=shares.get)  # the first of equals
        chosen = [corner for corner in corners if pattern[corner[0], corner[1]] == winner]
        around = (slice(y0 - 1, y0 + 3), slice(x0 - 1, x0 + 3))
        complete = x0 >= 1 and y0 >= 1 and x0 + 2 < width and y0 + 2 < height
        if complete and len(chosen) == 4 and (pattern[around] == winner).all():
            value = np.einsum("i,j,ijc->c", catmull_rom(fy), catmull_rom(fx), image[around].astype(float))
            taps = np.array([image[row, column] for row, column, _ in corners])
            out[i] = np.clip(value, taps.min(axis=0), taps.max(axis=0))
        else:
            total = sum(weight for _, _, weight in chosen)
            out[i] = sum(weight * image[row, column].astype(float) for row, column, weight in chosen) / total


def catmull_rom(f):
    """Return the weights of the pixels at -1, 0, 1, 2 for a position f between 0 and 1."""
    return np.array(
        [
            -0.5 * f + f**2 - 0.5 * f**3,
            1 - 2.5 * f**2 + 1.5 * f**3,
            0.5 * f + 2 * f**2 - 1.5 * f**3,
            -0.5 * f**2 + 0.5 * f**3,
        ]
    )
