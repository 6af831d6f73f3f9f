"""Numba kernel of resampling. Its slow twin is in ``tests/reference/rectification.py``."""

from __future__ import annotations

import numpy as np

from stereohdr.kernels import kernel


@kernel
def interpolate(image, pattern, x, y, slack, out, inside):
    """Interpolate an image at positions between its pixels, never across pixels of different pattern.

    Parameters
    ----------
    image
        ``(H, W, C)`` float32.
    pattern
        ``(H, W)`` uint8; pixels are mixed only with pixels of the same value.
    x, y
        ``(N,)`` float64 positions; NaN is outside.
    slack
        Pixels by which a position may leave the image and still count as inside.
    out
        ``(N, C)`` float32, written; 0 outside.
    inside
        ``(N,)`` bool, written.
    """
    height, width, channels = image.shape
    near = np.empty(4, np.float64)
    weight_x, weight_y = np.empty(4, np.float64), np.empty(4, np.float64)
    for i in range(x.shape[0]):
        px, py = x[i], y[i]
        if not (-slack <= px <= width - 1 + slack and -slack <= py <= height - 1 + slack):
            inside[i] = False
            out[i, :] = 0
            continue
        inside[i] = True
        px, py = min(max(px, 0.0), width - 1.0), min(max(py, 0.0), height - 1.0)
        x0, y0 = min(int(px), max(width - 2, 0)), min(int(py), max(height - 2, 0))
        x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
        fx, fy = px - x0, py - y0

        # The pattern that has the largest share of the four nearest pixels wins; of equals, the first.
        near[0], near[1] = (1 - fx) * (1 - fy), fx * (1 - fy)
        near[2], near[3] = (1 - fx) * fy, fx * fy
        corners = (pattern[y0, x0], pattern[y0, x1], pattern[y1, x0], pattern[y1, x1])
        share, winner = -1.0, corners[0]
        for a in range(4):
            total = 0.0
            for b in range(4):
                if corners[b] == corners[a]:
                    total += near[b]
            if total > share:
                share, winner = total, corners[a]
        whole = True
        for a in range(4):
            if corners[a] != winner:
                near[a] = 0.0
                whole = False

        cubic = whole and x0 >= 1 and y0 >= 1 and x0 + 2 < width and y0 + 2 < height
        if cubic:
            for row in range(y0 - 1, y0 + 3):
                for column in range(x0 - 1, x0 + 3):
                    cubic = cubic and pattern[row, column] == winner
        if cubic:  # Catmull-Rom
            for f, weight in ((fx, weight_x), (fy, weight_y)):
                weight[0] = ((-0.5 * f + 1.0) * f - 0.5) * f
                weight[1] = (1.5 * f - 2.5) * f * f + 1.0
                weight[2] = ((-1.5 * f + 2.0) * f + 0.5) * f
                weight[3] = (0.5 * f - 0.5) * f * f
        for channel in range(channels):
            a, b = image[y0, x0, channel], image[y0, x1, channel]
            c, d = image[y1, x0, channel], image[y1, x1, channel]
            if cubic:
                value = 0.0
                for row in range(4):
                    line = 0.0
                    for column in range(4):
                        line += weight_x[column] * image[y0 - 1 + row, x0 - 1 + column, channel]
                    value += weight_y[row] * line
                # No overshoot: beside a light in the dark it would make radiance negative.
                value = min(max(value, min(min(a, b), min(c, d))), max(max(a, b), max(c, d)))
            else:
                value = (near[0] * a + near[1] * b + near[2] * c + near[3] * d) / share
            out[i, channel] = value
