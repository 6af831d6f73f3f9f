"""Twins of stereohdr.segmentation._kernels."""

import numpy as np


def lattice_paths(cost, pitch, tolerance):
    """Shortest path per line over the set of allowed pixels, by explicit dynamic programming."""
    height, width = cost.shape
    lines = []
    for nominal in range(pitch, width, pitch):
        if nominal > width - 1:
            break
        allowed = np.zeros((height, width), dtype=bool)
        allowed[:, max(0, nominal - tolerance) : nominal + tolerance + 1] = True
        if lines:
            allowed &= np.arange(width)[None, :] > lines[-1][:, None]
        total = np.full((height, width), np.inf)
        total[0, nominal] = cost[0, nominal]
        origin = np.zeros((height, width), dtype=int)
        for y in range(1, height):
            for x in np.flatnonzero(allowed[y]):
                # Staying wins a tie, then coming from the left.
                options = [x, *(n for n in (x - 1, x + 1) if 0 <= n < width)]
                origin[y, x] = min(options, key=lambda n: (total[y - 1, n], options.index(n)))
                total[y, x] = total[y - 1, origin[y, x]] + cost[y, x]
        line = np.zeros(height, dtype=np.int32)
        # Of equally cheap ends the one nearest the nominal line, left before right.
        line[-1] = min(range(width), key=lambda x: (total[-1, x], abs(x - nominal), x))
        for y in range(height - 1, 0, -1):
            line[y - 1] = origin[y, line[y]]
        lines.append(line)
    return np.array(lines, dtype=np.int32).reshape(-1, height)


def merge_graph(first, second, weight, nodes, scale, minimum_size):
    """Felzenszwalb-Huttenlocher with explicit sets; each node's root is the smallest of its set."""
    component = {n: frozenset([n]) for n in range(nodes)}
    inner = dict.fromkeys(component.values(), 0.0)

    def join(a, b, w):
        union = a | b
        inner[union] = w
        for n in union:
            component[n] = union

    for only_small in (False, True):
        for i, j, w in zip(first, second, weight, strict=True):
            a, b = component[i], component[j]
            if a is b:
                continue
            if only_small:
                if min(len(a), len(b)) < minimum_size:
                    join(a, b, w)
            elif w <= min(inner[a] + scale / len(a), inner[b] + scale / len(b)):
                join(a, b, w)
    return np.array([min(component[n]) for n in range(nodes)], dtype=np.int32)
