"""Hot loops of the matching; readable twins in tests/reference/disparity.py.

Inner loops run over contiguous slices: indexing with ``x - 1`` or ``x + d`` would keep LLVM from vectorising.
No fastmath: contraction would change census codes.
"""

from __future__ import annotations

import numpy as np

from stereohdr.kernels import kernel


@kernel
def census_planes(padded, radius, threshold, start, stop, planes):
    """Fill rows `start` to `stop` of `planes`, ``(2, H, W)`` uint64, from an edge-padded luminance.

    Neighbour number n sets bit n of the first plane where it is at least the centre, and of the second where
    it is within the threshold of it: two bits that tell the four codes of equation 3 apart.
    """
    width = planes.shape[2]
    for y in range(start, stop):
        centre = padded[y + radius, radius : radius + width]
        higher = planes[0, y]
        near = planes[1, y]
        higher[:] = 0
        near[:] = 0
        bit = np.uint64(0)
        for dy in range(2 * radius + 1):
            for dx in range(2 * radius + 1):
                if dy == radius and dx == radius:
                    continue
                neighbour = padded[y + dy, dx : dx + width]
                for x in range(width):
                    r = centre[x]
                    q = neighbour[x]
                    t = r * threshold
                    higher[x] |= np.uint64(q >= r) << bit
                    near[x] |= np.uint64((q >= r - t) & (q <= r + t)) << bit
                bit += np.uint64(1)


@kernel
def similarity_rows(auxiliary, main, codes, start, stop, volume):
    """Fill ``volume[y - start, x, d]``, uint8, with the number of equal codes of x and x + d; 0 outside.

    `auxiliary` and `main` are ``(2, H, W)`` uint64 census planes of `codes` neighbours.
    """
    width = main.shape[2]
    disparities = volume.shape[2]
    m1 = np.uint64(0x5555555555555555)
    m2 = np.uint64(0x3333333333333333)
    m4 = np.uint64(0x0F0F0F0F0F0F0F0F)
    h01 = np.uint64(0x0101010101010101)
    for y in range(start, stop):
        for x in range(width):
            valid = min(disparities, width - x)
            cell = volume[y - start, x]
            higher = main[0, y, x : x + valid]
            near = main[1, y, x : x + valid]
            a = auxiliary[0, y, x]
            b = auxiliary[1, y, x]
            for d in range(valid):
                v = (higher[d] ^ a) | (near[d] ^ b)
                # Bit count; LLVM recognises this form and uses one instruction where there is one.
                v = v - ((v >> np.uint64(1)) & m1)
                v = (v & m2) + ((v >> np.uint64(2)) & m2)
                v = (v + (v >> np.uint64(4))) & m4
                cell[d] = np.uint8(codes - ((v * h01) >> np.uint64(56)))
            cell[valid:] = 0


@kernel
def candidate_rows(volume, wanted, box_radius, offset, candidates):
    """Fill ``candidates[y, x, :]``, int16, with the best local maxima over d of the box-filtered similarity.

    `volume` is ``(rows, W, D)`` uint8 and holds image row y of `candidates` and `wanted` at row y + offset;
    rows outside `volume` are outside the image. Best first, ties to the smaller disparity, -1 where there
    are fewer; -1 throughout where `wanted` is False.
    """
    rows, width, disparities = volume.shape
    count = candidates.shape[2]
    columns = np.zeros((width, disparities), dtype=np.uint16)
    score = np.zeros(disparities, dtype=np.uint16)
    kept = np.zeros(count, dtype=np.uint16)
    for y in range(candidates.shape[0]):
        any_wanted = False
        for x in range(width):
            any_wanted |= wanted[y, x]
        candidates[y] = -1
        if not any_wanted:
            continue
        columns[:] = 0
        for yy in range(max(0, y + offset - box_radius), min(rows, y + offset + box_radius + 1)):
            for x in range(width):
                source = volume[yy, x]
                total = columns[x]
                for d in range(disparities):
                    total[d] += source[d]
        for x in range(width):
            if not wanted[y, x]:
                continue
            valid = min(disparities, width - x)
            score[:] = 0
            for xx in range(max(0, x - box_radius), min(width, x + box_radius + 1)):
                total = columns[xx]
                for d in range(valid):
                    score[d] += total[d]
            found = candidates[y, x]
            filled = 0
            for d in range(valid):
                s = score[d]
                if d > 0 and s <= score[d - 1]:
                    continue
                end = d + 1  # of the plateau that begins at d
                while end < valid and score[end] == s:
                    end += 1
                if end < valid and score[end] > s:
                    continue
                if filled == count and s <= kept[count - 1]:
                    continue
                k = filled if filled < count else count - 1
                while k > 0 and kept[k - 1] < s:
                    kept[k] = kept[k - 1]
                    found[k] = found[k - 1]
                    k -= 1
                kept[k] = s
                found[k] = d
                if filled < count:
                    filled += 1


@kernel
def aggregate_rows(volume, segments, candidates, weights, start, offset, scores):
    """Fill ``scores[y, x, k]``, float32, with the weighted mean similarity of candidate k (equation 7).

    `volume` is ``(rows, W, D)`` uint8; row y of `scores` and `candidates` is image row y + start, whose
    similarity is in volume row y + offset. `segments` is the whole ``(H, W)`` image and `weights` the
    ``(2r+1, 2r+1)`` float32 window. Only pixels of the same segment count, and only where x + d lies inside
    the main view. -1 where there is no candidate.
    """
    height, width = segments.shape
    disparities = volume.shape[2]
    radius = weights.shape[0] // 2
    count = candidates.shape[2]
    flat = volume.reshape(-1)
    tap_base = np.empty(weights.size, dtype=np.int64)
    tap_column = np.empty(weights.size, dtype=np.int64)
    tap_weight = np.empty(weights.size, dtype=np.float32)
    total = np.empty(count, dtype=np.float32)
    for y in range(scores.shape[0]):
        row = y + start
        for x in range(width):
            found = candidates[y, x]
            out = scores[y, x]
            out[:] = -1.0
            filled = 0
            furthest = 0
            while filled < count and found[filled] >= 0:
                furthest = max(furthest, found[filled])
                filled += 1
            if filled == 0:
                continue
            own = segments[row, x]
            taps = 0
            weight_sum = np.float32(0.0)
            left = max(0, x - radius)
            right = min(width - 1, x + radius)
            for yy in range(max(0, row - radius), min(height, row + radius + 1)):
                base = ((yy - row + y + offset) * width) * disparities
                for xx in range(left, right + 1):
                    if segments[yy, xx] == own:
                        w = weights[yy - row + radius, xx - x + radius]
                        tap_base[taps] = base + xx * disparities
                        tap_column[taps] = xx
                        tap_weight[taps] = w
                        weight_sum += w
                        taps += 1
            if right + furthest < width:
                for k in range(filled):
                    total[k] = 0.0
                for t in range(taps):
                    base = tap_base[t]
                    w = tap_weight[t]
                    for k in range(filled):
                        total[k] += w * np.float32(flat[base + found[k]])
                for k in range(filled):
                    out[k] = total[k] / weight_sum
            else:  # some taps of some candidates fall outside the main view
                for k in range(filled):
                    d = found[k]
                    value = np.float32(0.0)
                    norm = np.float32(0.0)
                    for t in range(taps):
                        if tap_column[t] + d < width:
                            value += tap_weight[t] * np.float32(flat[tap_base[t] + d])
                            norm += tap_weight[t]
                    out[k] = value / norm


@kernel
def patch_vectors(padded, weights, range_factor, y, vectors):
    """Fill ``vectors[k, x]``, float32, with the patch around pixel (y, x) of an edge-padded float32 image.

    Tap k holds ``w (value - weighted mean)``, and the vector of a pixel has length 1: the dot product of two of
    them is their normalised cross-correlation. ``w`` is `weights`, ``(2r+1, 2r+1)`` float64, times
    ``exp(-range_factor (value - centre)^2)``. A flat patch gives the zero vector. Sums are float64, and the mean
    is subtracted first, so that neither a large dynamic range nor low contrast costs digits.
    """
    side = weights.shape[0]
    radius = side // 2
    width = vectors.shape[1]
    value = np.empty(side * side, dtype=np.float64)
    share = np.empty(side * side, dtype=np.float64)
    for x in range(width):
        centre = np.float64(padded[y + radius, x + radius])
        total = 0.0
        mean = 0.0
        k = 0
        for dy in range(side):
            for dx in range(side):
                v = np.float64(padded[y + dy, x + dx])
                w = weights[dy, dx]
                if range_factor > 0.0:
                    w *= np.exp(-range_factor * (v - centre) ** 2)
                value[k] = v
                share[k] = w
                total += w
                mean += w * v
                k += 1
        mean /= total
        power = 0.0
        scale = 0.0
        for k in range(side * side):
            scale += (share[k] * value[k]) ** 2
            value[k] = share[k] * (value[k] - mean)
            power += value[k] ** 2
        factor = 0.0
        if power > 1e-12 * scale:
            factor = 1.0 / np.sqrt(power)
        for k in range(side * side):
            vectors[k, x] = factor * value[k]


@kernel
def correlation_rows(auxiliary, main, weights, range_factor, start, stop, volume):
    """Fill ``volume[y - start, x, d]``, float32, with the correlation of the patches at x and x + d; -2 outside.

    `auxiliary` and `main` are edge-padded float32 images, see `patch_vectors`.
    """
    disparities = volume.shape[2]
    width = volume.shape[1]
    taps = weights.size
    vectors_a = np.empty((taps, width), dtype=np.float32)
    vectors_m = np.empty((taps, width), dtype=np.float32)
    for y in range(start, stop):
        patch_vectors(auxiliary, weights, range_factor, y, vectors_a)
        patch_vectors(main, weights, range_factor, y, vectors_m)
        for x in range(width):
            valid = min(disparities, width - x)
            cell = volume[y - start, x, :valid]
            cell[:] = 0.0
            for k in range(taps):
                a = vectors_a[k, x]
                row = vectors_m[k, x : x + valid]
                for d in range(valid):
                    cell[d] += a * row[d]
            volume[y - start, x, valid:] = -2.0


@kernel
def winner_rows(volume, start, of_main, of_auxiliary):
    """Write the best disparity of each main and each auxiliary pixel of the rows in `volume`, ties to the smaller.

    ``volume[y, x, d]`` compares auxiliary pixel x with main pixel x + d of image row y + start; the maps are
    ``(H, W)`` int32.
    """
    rows, width, disparities = volume.shape
    best = np.empty(width, dtype=np.float32)
    for y in range(rows):
        best[:] = -np.inf
        main = of_main[y + start]
        for x in range(width):
            cell = volume[y, x]
            valid = min(disparities, width - x)
            winner = 0
            for d in range(1, valid):
                if cell[d] > cell[winner]:
                    winner = d
            of_auxiliary[y + start, x] = winner
            for d in range(valid):  # a main pixel meets its disparities in descending order
                if cell[d] >= best[x + d]:
                    best[x + d] = cell[d]
                    main[x + d] = d
