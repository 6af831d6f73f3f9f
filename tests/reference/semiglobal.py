"""Twin of stereohdr.disparity.match_semiglobal, straight from the definition."""

import numpy as np

NO_COST = -1
"""Where a cell has no partner."""

FORBIDDEN = 10**6
"""Cost of a disparity that is not in a pixel's band."""


def match_semiglobal(main_planes, auxiliary_planes, guide_main, *, disparities, config, bands=None):
    """Of both views: disparity, cost, margin, matching cost; ``(H, W)`` each."""
    lowest, highest = disparities
    unequal = unequal_codes(main_planes, auxiliary_planes, lowest, highest - lowest + 1)
    inside = unequal != NO_COST
    cost = np.where(inside, box_mean(unequal), config.outside_cost)
    tried = in_band(cost.shape, lowest, bands)
    cost[~tried] = FORBIDDEN
    steps = [(0, 1), (0, -1), (1, 0), (-1, 0)]
    if config.paths == 8:
        steps += [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    total = sum(follow_paths(cost, guide_main, dy, dx, config) for dy, dx in steps)

    height, width, count = cost.shape
    of_main = [[None] * width for _ in range(height)]
    of_auxiliary = [[None] * width for _ in range(height)]
    for y in range(height):
        for x in range(width):
            cells = [(y, x, k) for k in range(count) if tried[y, x, k]]
            of_main[y][x] = winner(cells, total, cost, inside, lowest)
            cells = [(y, x + lowest + k, k) for k in range(count) if 0 <= x + lowest + k < width]
            if cells:
                cells = [cell for cell in cells if tried[cell]]
                nothing = 65535, 65535, 0, config.outside_cost
                of_auxiliary[y][x] = winner(cells, total, cost, inside, lowest) if cells else nothing
        seen = [x for x in range(width) if of_auxiliary[y][x]]
        for x in range(width):
            of_auxiliary[y][x] = of_auxiliary[y][min(max(x, seen[0]), seen[-1])]
    dtypes = (np.float32, np.uint16, np.uint16, np.uint8)
    return tuple(
        tuple(np.array(view, dtype=object)[..., i].astype(dtype) for i, dtype in enumerate(dtypes))
        for view in (of_main, of_auxiliary)
    )


def in_band(shape, lowest, bands):
    """Whether a pixel tries a disparity, ``(H, W, count)``."""
    tried = np.ones(shape, dtype=bool)
    for y, x, k in np.ndindex(shape if bands is not None else (0, 0, 0)):
        first = bands.lowest[y // bands.block, x // bands.block] - lowest
        tried[y, x, k] = first <= k < first + bands.count[y // bands.block, x // bands.block]
    return tried


def unequal_codes(main, auxiliary, lowest, count):
    _, height, width = main.shape
    unequal = np.full((height, width, count), NO_COST)
    for y, x, k in np.ndindex(unequal.shape):
        partner = x - (lowest + k)
        if 0 <= partner < width:
            higher, near = (int(main[i, y, x] ^ auxiliary[i, y, partner]) for i in range(2))
            unequal[y, x, k] = (higher | near).bit_count()
    return unequal


def box_mean(unequal):
    """Rounded half up, over the cells of 3x3 pixels that have a partner."""
    mean = np.zeros_like(unequal)
    for y, x, k in np.argwhere(unequal != NO_COST):
        box = unequal[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2, k]
        box = box[box != NO_COST]
        mean[y, x, k] = (2 * box.sum() + box.size) // (2 * box.size)
    return mean


def large_penalty(guide, p, q, config):
    difference = np.abs(guide[p] - guide[q])
    penalty = np.float32(config.large_penalty) / (np.float32(1) + np.float32(config.edge_factor) * difference)
    return max(int(penalty + np.float32(0.5)), config.small_penalty + 1)


def follow_paths(cost, guide, dy, dx, config):
    """L of the paths that step by (dy, dx)."""
    height, width, count = cost.shape
    path = np.zeros(cost.shape, dtype=int)
    for y in range(height)[:: -1 if dy < 0 else 1]:
        for x in range(width)[:: -1 if dx < 0 else 1]:
            path[y, x] = cost[y, x]
            q = y - dy, x - dx
            if 0 <= q[0] < height and 0 <= q[1] < width:
                jump = path[q].min() + large_penalty(guide, (y, x), q, config)
                for d in range(count):
                    beside = [path[q][e] + config.small_penalty for e in (d - 1, d + 1) if 0 <= e < count]
                    path[y, x, d] += min([path[q][d], jump, *beside]) - path[q].min()
    return path


def winner(cells, total, cost, inside, lowest):
    """Disparity, cost, margin, matching cost of the best of one pixel's cells (y, x, k), which rise in k."""
    sums = {k: int(total[y, x, k]) for y, x, k in cells}
    i, best = min(sums.items(), key=lambda item: item[1])
    others = [s for k, s in sums.items() if abs(k - i) >= 2]
    disparity = np.float32(lowest + i)
    near = [cell for cell in cells if abs(cell[2] - i) <= 1]
    if len(near) == 3 and all(inside[cell] for cell in near):
        before, after = sums[i - 1], sums[i + 1]
        if max(before, after) > best:
            disparity += np.float32(before - after) / np.float32(2 * (max(before, after) - best))
    own = next(cell for cell in cells if cell[2] == i)
    return disparity, best, min(others) - best if others else 65535, cost[own]
