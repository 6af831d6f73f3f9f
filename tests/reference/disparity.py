"""Twins of stereohdr.disparity._kernels."""

import itertools

import numpy as np


def census_codes(luminance, radius, threshold):
    """Codes 0..3 of equation 3 for every neighbour, ``(H, W, N)``, straight from the definition."""
    padded = np.pad(luminance, radius, mode="edge")
    height, width = luminance.shape
    codes = []
    for dy in range(2 * radius + 1):
        for dx in range(2 * radius + 1):
            if dy == radius and dx == radius:
                continue
            q = padded[dy : dy + height, dx : dx + width]
            r = luminance
            t = r * threshold
            codes.append(np.select([q < r - t, q < r, q <= r + t], [0, 1, 2], 3))
    return np.stack(codes, axis=-1)


def census_planes(padded, radius, threshold, start, stop, planes):
    inner = padded[radius : padded.shape[0] - radius, radius : padded.shape[1] - radius]
    codes = census_codes(inner, radius, threshold)[start:stop].astype(np.uint64)
    bits = np.arange(codes.shape[-1], dtype=np.uint64)
    planes[0, start:stop] = ((codes >= 2).astype(np.uint64) << bits).sum(axis=-1)
    planes[1, start:stop] = (((codes == 1) | (codes == 2)).astype(np.uint64) << bits).sum(axis=-1)


def similarity_rows(auxiliary, main, codes, start, stop, volume):
    for y in range(start, stop):
        for x in range(main.shape[2]):
            for d in range(volume.shape[2]):
                volume[y - start, x, d] = 0
                if x + d < main.shape[2]:
                    different = int(auxiliary[0, y, x] ^ main[0, y, x + d]) | int(
                        auxiliary[1, y, x] ^ main[1, y, x + d]
                    )
                    volume[y - start, x, d] = int(codes) - different.bit_count()


def candidate_rows(volume, wanted, box_radius, offset, candidates):
    width, disparities = volume.shape[1:]
    for y in range(candidates.shape[0]):
        for x in range(width):
            candidates[y, x] = -1
            if not wanted[y, x]:
                continue
            top = max(0, y + offset - box_radius)
            left = max(0, x - box_radius)
            box = volume[top : y + offset + box_radius + 1, left : x + box_radius + 1].astype(int)
            score = box.sum(axis=(0, 1))[: min(disparities, width - x)]
            maxima = []
            runs = [list(run) for _, run in itertools.groupby(range(len(score)), key=lambda d: score[d])]
            for before, run, after in zip([None, *runs], runs, [*runs[1:], None], strict=False):
                higher_than = [score[other[0]] for other in (before, after) if other]
                if all(score[run[0]] > value for value in higher_than):
                    maxima.append(run[0])
            best = sorted(maxima, key=lambda d: (-score[d], d))[: candidates.shape[2]]
            candidates[y, x, : len(best)] = best


def aggregate_rows(volume, segments, candidates, weights, start, offset, scores):
    height, width = segments.shape
    radius = weights.shape[0] // 2
    scores[:] = -1
    for y in range(scores.shape[0]):
        for x in range(width):
            for k, d in enumerate(candidates[y, x]):
                if d < 0:
                    continue
                value = norm = 0.0
                for dy in range(-radius, radius + 1):
                    for dx in range(-radius, radius + 1):
                        row, column = y + start + dy, x + dx
                        if not (0 <= row < height and 0 <= column < width and column + d < width):
                            continue
                        if segments[row, column] == segments[y + start, x]:
                            w = float(weights[dy + radius, dx + radius])
                            value += w * volume[y + offset + dy, column, d]
                            norm += w
                scores[y, x, k] = value / norm


def patch_vectors(padded, weights, range_factor, y, vectors):
    side = weights.shape[0]
    for x in range(vectors.shape[1]):
        patch = padded[y : y + side, x : x + side].astype(np.float64)
        w = weights * np.exp(-range_factor * (patch - patch[side // 2, side // 2]) ** 2)
        vector = w * (patch - (w * patch).sum() / w.sum())
        length = np.linalg.norm(vector)
        flat = length <= 1e-6 * np.linalg.norm(w * patch)
        vectors[:, x] = 0 if flat else vector.ravel() / length


def correlation_rows(auxiliary, main, weights, range_factor, start, stop, volume):
    _, width, disparities = volume.shape
    of_auxiliary, of_main = np.zeros((2, weights.size, width))
    for y in range(start, stop):
        patch_vectors(auxiliary, weights, range_factor, y, of_auxiliary)
        patch_vectors(main, weights, range_factor, y, of_main)
        for x in range(width):
            for d in range(disparities):
                inside = x + d < width
                volume[y - start, x, d] = of_auxiliary[:, x] @ of_main[:, x + d] if inside else -2


def winner_rows(volume, start, of_main, of_auxiliary):
    rows, width, disparities = volume.shape
    for y in range(rows):
        for x in range(width):
            scores = [volume[y, x, d] for d in range(disparities) if x + d < width]
            of_auxiliary[y + start, x] = int(np.argmax(scores))
            scores = [volume[y, x - d, d] for d in range(disparities) if x - d >= 0]
            of_main[y + start, x] = int(np.argmax(scores))
