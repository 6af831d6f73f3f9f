"""Hot loops of the matching; readable twins in tests/reference/disparity.py.

Inner loops run over contiguous slices: indexing with ``x - 1`` or ``x + d`` would keep LLVM from vectorising.
No fastmath: contraction would change census codes.
"""

from __future__ import annotations

import numpy as np

from stereohdr.float_vectors import (
    LANES,
    any_positive,
    even_lanes,
    load,
    load_bytes,
    odd_lanes,
    pointer,
    splat,
    store,
    where_labelled,
)
from stereohdr.kernels import kernel

TILE_ROWS = 4
"""Rows of the tiles of `aggregate_rows`; with `LANES` columns each, a tile is a cache line."""


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
    total = np.zeros(disparities, dtype=np.uint16)
    raised = np.zeros(disparities + 2, dtype=np.uint16)  # score + 1, between two zeros
    is_peak = np.zeros(disparities, dtype=np.uint8)
    peak = np.zeros(disparities, dtype=np.int64)
    kept = np.zeros(count, dtype=np.int64)
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
                target = columns[x]
                for d in range(disparities):
                    target[d] += source[d]
        total[:] = 0
        for x in range(min(box_radius, width)):
            source = columns[x]
            for d in range(disparities):
                total[d] += source[d]
        for x in range(width):
            if x + box_radius < width:
                source = columns[x + box_radius]
                for d in range(disparities):
                    total[d] += source[d]
            if x > box_radius:
                source = columns[x - box_radius - 1]
                for d in range(disparities):
                    total[d] -= source[d]
            if not wanted[y, x]:
                continue
            valid = min(disparities, width - x)
            before, here, after = raised[:valid], raised[1 : valid + 1], raised[2 : valid + 2]
            for d in range(valid):
                here[d] = total[d] + np.uint16(1)
            after[valid - 1] = 0
            for d in range(valid):
                is_peak[d] = (here[d] > before[d]) & (here[d] >= after[d])
            peaks = 0
            for d in range(valid):  # without a branch, since any would be mispredicted
                peak[peaks] = d
                peaks += is_peak[d]
            kept[:] = 0
            for n in range(peaks):
                d = peak[n]
                s = here[d]
                if after[d] == s:  # a plateau, which may go on to rise
                    end = d + 1
                    while end < valid and here[end] == s:
                        end += 1
                    if end < valid and here[end] > s:
                        continue
                key = np.int64(s) << 16 | (0xFFFF - d)
                for k in range(count):  # each place keeps the larger one and hands on the other
                    larger = max(kept[k], key)
                    key = min(kept[k], key)
                    kept[k] = larger
            found = candidates[y, x]
            for k in range(count):
                if kept[k] > 0:
                    found[k] = 0xFFFF - (kept[k] & 0xFFFF)


@kernel
def fill_tiles(volume, margin, tiles):
    """Write ``volume[y, x, d]`` into the tile of disparity d, see `aggregate_rows`; row y, column margin + x."""
    rows, width, disparities = volume.shape
    for y in range(rows):
        for left in range(0, width, LANES):
            columns = min(LANES, width - left)
            for d in range(disparities):
                source = volume[y, left : left + columns, d]
                target = tiles[d, y // TILE_ROWS, (margin + left) // LANES, y % TILE_ROWS, :columns]
                for i in range(columns):
                    target[i] = source[i]


@kernel
def aggregate_rows(tiles, margin, labels, candidates, weights, radius, offset, scratch, scores):
    """Fill ``scores[y, x, k]``, float32, with the weighted mean similarity of candidate k (equation 7).

    Parameters
    ----------
    tiles
        ``(D, M, N, TILE_ROWS, LANES)`` uint8, similarity: a tile holds a few rows and columns, so that a window
        takes few cache lines. Row y of the pixels is row y + offset, column x is x + margin; it is 0 where x + d
        lies outside the main view.
    margin
        A multiple of `LANES`, not less than `radius`.
    labels
        ``(height + 2 radius, N * LANES)`` int32, the segments, with the rows before and after those of the pixels,
        and in the columns of the tiles; -1 outside the image.
    candidates
        ``(height, W, K)`` int16. -1 where there is none, in the scores too.
    weights
        ``(2 radius + 1, n)`` float32, the window, with `LANES` zeros before and at least as many after each row.
        Only pixels of the same segment count, and only where x + d lies inside the main view.
    scratch
        float32, twice as many as the weights.
    """
    height, width, count = candidates.shape
    plane_size = tiles[0].size
    tile_size = TILE_ROWS * LANES
    tile_columns = tiles.shape[2]
    similarity, label, weight = pointer(tiles, 0), pointer(labels, 0), pointer(weights, 0)
    columns, sums = weights.size, 2 * weights.size - LANES  # where they begin in the scratch memory
    own_weights = pointer(scratch, 0)
    places = np.empty(weights.size // LANES, dtype=np.int64)
    zero = splat(np.float32(0))
    for y in range(height):
        for x in range(width):
            found = candidates[y, x]
            out = scores[y, x]
            out[:] = -1.0
            filled = 0
            while filled < count and found[filled] >= 0:
                filled += 1
            if filled == 0:
                continue
            # The window as vectors of the tiles, those without a pixel of the segment left out.
            own = labels[y + radius, x + margin]
            left = x + margin - radius
            first, last = left // LANES, (x + margin + radius) // LANES
            blocks = 0
            for tile in range(first, last + 1):
                column_sum = zero
                shift = LANES + tile * LANES - left
                for row in range(2 * radius + 1):
                    place = (y + row) * labels.shape[1] + tile * LANES
                    w = where_labelled(label, place, own, load(weight, row * weights.shape[1] + shift))
                    if any_positive(w):
                        store(own_weights, blocks * LANES, w)
                        similarity_row = y + offset + row - radius
                        number = similarity_row // TILE_ROWS * tile_columns + tile
                        places[blocks] = number * tile_size + similarity_row % TILE_ROWS * LANES
                        column_sum = column_sum + w
                        blocks += 1
                store(own_weights, columns + (tile - first) * LANES, column_sum)
            whole = np.float32(0)
            for j in range((last + 1 - first) * LANES):
                whole += scratch[columns + j]
            for k in range(0, filled, 4):
                a = found[k] * plane_size
                b = found[min(k + 1, filled - 1)] * plane_size
                c = found[min(k + 2, filled - 1)] * plane_size
                e = found[min(k + 3, filled - 1)] * plane_size
                sum_a = sum_b = sum_c = sum_e = zero
                for n in range(blocks):
                    w = load(own_weights, n * LANES)
                    at = places[n]
                    sum_a = sum_a + w * load_bytes(similarity, a + at)
                    sum_b = sum_b + w * load_bytes(similarity, b + at)
                    sum_c = sum_c + w * load_bytes(similarity, c + at)
                    sum_e = sum_e + w * load_bytes(similarity, e + at)
                # Lanes are summed for all four at once.
                sum_a = even_lanes(sum_a, sum_b) + odd_lanes(sum_a, sum_b)
                sum_c = even_lanes(sum_c, sum_e) + odd_lanes(sum_c, sum_e)
                sum_a = even_lanes(sum_a, sum_c) + odd_lanes(sum_a, sum_c)
                sum_a = even_lanes(sum_a, sum_a) + odd_lanes(sum_a, sum_a)
                store(own_weights, sums, even_lanes(sum_a, sum_a) + odd_lanes(sum_a, sum_a))
                for i in range(min(4, filled - k)):
                    beyond = width - found[k + i] + margin  # the first column without a partner
                    norm = whole
                    if beyond <= x + margin + radius:
                        norm = np.float32(0)
                        for j in range(beyond - first * LANES):
                            norm += scratch[columns + j]
                    out[k + i] = scratch[sums + i] / norm


@kernel
def best_candidates(scores, candidates, winner):
    """Fill ``winner[y, x]`` with the candidate of highest score, ties to the smaller one; -1 if there is none."""
    height, width, count = candidates.shape
    for y in range(height):
        for x in range(width):
            best, highest = candidates[y, x, 0], scores[y, x, 0]
            for k in range(1, count):
                d, score = candidates[y, x, k], scores[y, x, k]
                if d >= 0 and (best < 0 or score > highest or (score == highest and d < best)):
                    best, highest = d, score
            winner[y, x] = best


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
