"""Hot loops of the segmentation; readable twins in tests/reference/segmentation.py."""

from __future__ import annotations

import numpy as np

from stereohdr.kernels import kernel


@kernel
def lattice_paths(cost, pitch, tolerance):
    """Cheapest non-crossing vertical paths, ``(paths, H)`` int32 columns, one near each multiple of `pitch`.

    `cost` is ``(H, W)`` float64. A path takes one pixel per row, moves by at most one column, starts on its
    nominal column and stays within `tolerance` of it and to the right of the path before.
    """
    height, width = cost.shape
    paths = (width - 1) // pitch
    columns = np.zeros((paths, height), dtype=np.int32)
    band = 2 * tolerance + 1
    total = np.empty(band)
    following = np.empty(band)
    step = np.zeros((height, band), dtype=np.int8)
    for i in range(paths):
        nominal = pitch * (i + 1)
        first = nominal - tolerance
        for k in range(band):
            total[k] = np.inf
        total[tolerance] = cost[0, nominal]
        for y in range(1, height):
            for k in range(band):
                following[k] = np.inf
                x = first + k
                if x >= width or (i > 0 and x <= columns[i - 1, y]):
                    continue
                best = total[k]
                move = 0
                if k > 0 and total[k - 1] < best:
                    best = total[k - 1]
                    move = -1
                if k < band - 1 and total[k + 1] < best:
                    best = total[k + 1]
                    move = 1
                following[k] = best + cost[y, x]
                step[y, k] = move
            total, following = following, total
        # Of equally cheap ends the one nearest the nominal line, so that flat areas keep a straight lattice.
        k = tolerance
        for j in range(1, tolerance + 1):
            if total[tolerance - j] < total[k]:
                k = tolerance - j
            if total[tolerance + j] < total[k]:
                k = tolerance + j
        for y in range(height - 1, -1, -1):
            columns[i, y] = first + k
            k += step[y, k] if y > 0 else 0
    return columns


@kernel
def merge_graph(first, second, weight, nodes, scale, minimum_size):
    """Merge graph nodes along edges sorted by weight; returns each node's root, ``(nodes,)`` int32.

    Felzenszwalb and Huttenlocher 2004: two components merge when the edge between them is no heavier than
    the heaviest edge inside each of them plus scale / size.
    """
    parent = np.arange(nodes).astype(np.int32)
    size = np.ones(nodes, dtype=np.int32)
    limit = np.full(nodes, scale)
    for only_small in range(2 if minimum_size > 1 else 1):
        for e in range(weight.shape[0]):
            a = first[e]
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            b = second[e]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if a == b:
                continue
            if only_small == 1:
                if min(size[a], size[b]) >= minimum_size:
                    continue
            elif weight[e] > min(limit[a], limit[b]):
                continue
            if b < a:
                a, b = b, a
            parent[b] = a
            size[a] += size[b]
            limit[a] = weight[e] + scale / size[a]
    for a in range(nodes):
        root = a
        while parent[root] != root:
            root = parent[root]
        parent[a] = root
    return parent
