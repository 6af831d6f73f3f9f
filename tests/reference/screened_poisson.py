"""Twins of stereohdr.restoration.screened_poisson: dense matrices, and multigrid written pixel by pixel."""

import numpy as np


def equations(domain, fixed, *, data, data_weight, gradient_x, gradient_y, weight_x, weight_y):
    """Return matrix and right-hand side of the normal equations, pixels of the domain in reading order."""
    height, width = domain.shape
    index = np.arange(height * width).reshape(height, width)
    matrix = np.zeros((height * width, height * width))
    right = np.zeros(height * width)
    for y in range(height):
        for x in range(width):
            i = index[y, x]
            if data_weight[y, x] > 0:
                matrix[i, i] += data_weight[y, x]
                right[i] += float(data_weight[y, x]) * data[y, x]
            for yy, xx, weight, gradient in (
                (y, x + 1, weight_x[y, x], gradient_x[y, x]),
                (y + 1, x, weight_y[y, x], gradient_y[y, x]),
            ):
                if yy < height and xx < width and weight > 0:
                    j = index[yy, xx]
                    matrix[i, i] += weight
                    matrix[j, j] += weight
                    matrix[i, j] -= weight
                    matrix[j, i] -= weight
                    right[j] += float(weight) * gradient
                    right[i] -= float(weight) * gradient
    inside = domain.reshape(-1)
    known = np.where(domain, 0, np.nan_to_num(fixed)).reshape(-1).astype(float)
    return matrix[np.ix_(inside, inside)], right[inside] - (matrix @ known)[inside]


def minimise(matrix, right, lower):
    """Return the minimum of x A x / 2 - b x over x >= lower, by projected Gauss-Seidel sweeps."""
    x = np.maximum(np.linalg.solve(matrix, right), lower)
    while True:
        before = x.copy()
        for i in range(x.size):
            x[i] = max(lower[i], x[i] + (right[i] - matrix[i] @ x) / matrix[i, i])
        if np.abs(x - before).max(initial=0) < 1e-10:
            return x


def interpolation(matrix, free, height, width):
    """Return the interpolation from the pixels in even rows and columns, for a matrix of a nine-point stencil."""
    coarse_width = (width + 1) // 2
    result = np.zeros((height * width, (height + 1) // 2 * coarse_width))

    def coupling(y, x, yy, xx):
        inside = 0 <= yy < height and 0 <= xx < width
        return -matrix[y * width + x, yy * width + xx] if inside else 0.0

    for y in range(height):
        for x in range(width):
            i = y * width + x
            if not free[i] or (y % 2 == 1 and x % 2 == 1):
                continue
            if y % 2 == 0 and x % 2 == 0:
                result[i, y // 2 * coarse_width + x // 2] = 1
                continue
            sides, straight = [], []
            for step in (-1, 1):
                if y % 2 == 0:
                    sides.append(sum(coupling(y, x, y + across, x + step) for across in (-1, 0, 1)))
                    straight.append(abs(coupling(y, x, y, x + step)))
                else:
                    sides.append(sum(coupling(y, x, y + step, x + across) for across in (-1, 0, 1)))
                    straight.append(abs(coupling(y, x, y + step, x)))
            sides = np.maximum(sides, 0)
            if sides.sum() <= 0:
                sides = np.array(straight)
            screen = max(matrix[i].sum(), 0)
            for step, side in zip((-1, 1), sides, strict=True):
                yy, xx = (y, x + step) if y % 2 == 0 else (y + step, x)
                if side > 0 and 0 <= yy < height and 0 <= xx < width and free[yy * width + xx]:
                    result[i, yy // 2 * coarse_width + xx // 2] = side / (sides.sum() + screen)
    for y in range(1, height, 2):
        for x in range(1, width, 2):
            i = y * width + x
            if free[i]:
                others = -matrix[i].copy()
                others[i] = 0
                result[i] = others @ result / matrix[i, i]
    return result


def parts(domain, weight_x, weight_y):
    """Label the parts of the domain that weights connect."""
    height, width = domain.shape
    labels = np.where(domain, np.arange(domain.size).reshape(domain.shape), -1)
    while True:
        before = labels.copy()
        for y in range(height):
            for x in range(width):
                for yy, xx, weight in ((y, x + 1, weight_x[y, x]), (y + 1, x, weight_y[y, x])):
                    if yy < height and xx < width and weight > 0 and domain[y, x] and domain[yy, xx]:
                        labels[y, x] = labels[yy, xx] = min(labels[y, x], labels[yy, xx])
        if (labels == before).all():
            return labels
