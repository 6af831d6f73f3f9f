"""Twins of stereohdr.restoration._kernels, and a dense Poisson solve."""

import numpy as np


def fill_along_rays(segments, valid, luminance, guide, hole, source):
    height, width = segments.shape
    for y in range(height):
        for x in range(width):
            source[y, x] = -1
            if not hole[y, x]:
                continue
            found = []
            for dy, dx in ((0, -1), (0, 1), (-1, 0), (1, 0)):
                yy, xx = y, x
                while 0 <= yy < height and 0 <= xx < width and segments[yy, xx] == segments[y, x]:
                    if valid[yy, xx]:
                        found.append((yy, xx))
                        break
                    yy, xx = yy + dy, xx + dx
            if found:
                yy, xx = min(found, key=lambda p: abs(luminance[p] - guide[y, x]))
                source[y, x] = yy * width + xx


def fill_from_nearest(segments, valid, hole, source):
    height, width = segments.shape
    index = np.arange(height * width).reshape(height, width)
    none = height * width
    nearest = np.where(valid, index, none)
    while True:
        spread = np.full((height + 2, width + 2), none)
        labels = np.full((height + 2, width + 2), -1)
        spread[1:-1, 1:-1] = nearest
        labels[1:-1, 1:-1] = segments
        best = np.full((height, width), none)
        for dy in range(3):
            for dx in range(3):
                same = labels[dy : dy + height, dx : dx + width] == segments
                candidate = np.where(same, spread[dy : dy + height, dx : dx + width], none)
                best = np.minimum(best, candidate)
        reached = (nearest == none) & (best < none)
        if not reached.any():
            break
        nearest[reached] = best[reached]
    todo = hole & (source < 0) & (nearest < none)
    source[todo] = nearest[todo]


def nearest_background(disparity, known, hole, source):
    height, width = disparity.shape
    for y in range(height):
        columns = np.flatnonzero(known[y])
        for x in range(width):
            beside = [*columns[columns <= x][-1:], *columns[columns >= x][:1]]
            best = min(beside, key=lambda c: (disparity[y, c], abs(c - x), c), default=-1)
            source[y, x] = best if hole[y, x] else -1


def recursive_pass(image, across, down):
    height, width, _ = image.shape
    for x in range(1, width):
        v = across[:, x, None]
        image[:, x] = (1 - v) * image[:, x] + v * image[:, x - 1]
    for x in range(width - 2, -1, -1):
        v = across[:, x + 1, None]
        image[:, x] = (1 - v) * image[:, x] + v * image[:, x + 1]
    for y in range(1, height):
        v = down[y, :, None]
        image[y] = (1 - v) * image[y] + v * image[y - 1]
    for y in range(height - 2, -1, -1):
        v = down[y + 1, :, None]
        image[y] = (1 - v) * image[y] + v * image[y + 1]


def poisson_edit(filled, valid, holes, main):
    """Normal equations of equation 11, written pixel by pixel and solved densely; holes must be bounded."""
    height, width, channels = main.shape
    unknown = [tuple(p) for p in np.argwhere(holes)]
    number = {p: i for i, p in enumerate(unknown)}
    matrix = np.zeros((len(unknown), len(unknown)))
    right = np.zeros((len(unknown), channels))
    for (y, x), i in number.items():
        for q in ((y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)):
            if not (0 <= q[0] < height and 0 <= q[1] < width):
                continue
            gradient = main[y, x].astype(float) - main[q]
            if q in number:
                matrix[i, i] += 1
                matrix[i, number[q]] -= 1
                right[i] += gradient
            elif valid[q]:
                matrix[i, i] += 1
                right[i] += filled[q] + gradient
    edited = filled.astype(float).copy()
    solution = np.linalg.solve(matrix, right)
    for p, i in number.items():
        edited[p] = solution[i]
    return edited
