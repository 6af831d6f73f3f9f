"""Twins of stereohdr.restoration._highlights_kernels, pixel by pixel from the definitions."""

import numpy as np

NOTHING, BORROWED, MEASURED = range(3)


def classes(clipped, channel, limits):
    domain = clipped[..., channel]
    others = np.argwhere(~domain)
    result = np.zeros(domain.shape, int)
    for y, x in np.argwhere(domain):
        squares = ((others - (y, x)) ** 2).sum(axis=1)
        square = squares.min() if len(squares) else np.inf
        result[y, x] = clipped[y, x].sum() * (len(limits) + 1) + (np.array(limits) < square).sum()
    return result


def sum_excess(views, channel, classes, count):
    counted = views.clipped[..., channel] & (views.source[..., channel] == MEASURED)
    excess = (views.auxiliary - views.main)[..., channel]
    sums = np.zeros((count, 3))
    for y, x in np.argwhere(counted):
        sums[classes[y, x]] += 1, excess[y, x], float(excess[y, x]) ** 2
    return sums


def terms(views, channel, classes, prior, prior_weight, weights):
    """Data, its weight, and ``(2, H, W)`` differences and their weights."""
    domain, source = views.clipped[..., channel], views.source[..., channel]
    auxiliary, height, width = views.auxiliary[..., channel], *domain.shape
    data, data_weight = np.zeros((2, height, width))
    gradient, gradient_weight = np.zeros((2, 2, height, width))
    for y, x in np.argwhere(domain):
        value, weight = auxiliary[y, x], {MEASURED: weights.level, BORROWED: weights.borrowed_level}
        if source[y, x] == NOTHING:
            value = views.main[y, x, channel] + prior[classes[y, x]]
            weight = {NOTHING: prior_weight[classes[y, x]]}
        data[y, x], data_weight[y, x] = value, weight[source[y, x]]
    for axis, y, x in np.ndindex(2, height, width):
        q = (y, x + 1) if axis == 0 else (y + 1, x)
        if q[0] == height or q[1] == width or not (domain[y, x] or domain[q]):
            continue
        free = [c for c in range(views.main.shape[2]) if not views.clipped[y, x, c] and not views.clipped[(*q, c)]]
        free = [c for c in free if c != channel]
        if NOTHING not in (source[y, x], source[q]):
            gradient[axis, y, x] = auxiliary[q] - auxiliary[y, x]
            both = source[y, x] == source[q] == MEASURED
            gradient_weight[axis, y, x] = weights.gradient if both else weights.borrowed_gradient
        elif free:
            gradient[axis, y, x] = np.mean([views.main[(*q, c)] - views.main[y, x, c] for c in free])
            gradient_weight[axis, y, x] = weights.colour
        else:
            gradient_weight[axis, y, x] = weights.smoothness
    return data, data_weight, gradient, gradient_weight
