"""Aggregation inside segments and winner-takes-all (equations 6 to 9)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import AggregationConfig
from stereohdr.disparity._kernels import TILE_ROWS, aggregate_rows, best_candidates, fill_tiles
from stereohdr.float_vectors import LANES


def support_weights(config: AggregationConfig) -> NDArray[np.float32]:
    """Return the window ``exp(-distance / sigma)``, ``(2r+1, 2r+1)`` float32 (equation 6)."""
    offset = np.arange(-config.radius, config.radius + 1)
    distance = np.hypot(offset[:, None], offset[None, :])
    decay = config.sigma**2 if config.squared_sigma else config.sigma
    return np.exp(-distance / decay).astype(np.float32)


def aggregate_in_segments(
    similarity: NDArray[np.uint8],
    segments: NDArray[np.int32],
    candidates: NDArray[np.int16],
    *,
    first_image_row: int = 0,
    first_row: int = 0,
    config: AggregationConfig | None = None,
) -> NDArray[np.float32]:
    """Average the similarity of each candidate over the pixel's own segment.

    Parameters
    ----------
    similarity
        ``(rows, W, D)`` uint8.
    segments
        ``(H, W)`` int32, not negative, G_a, the whole image.
    candidates
        ``(h, W, K)`` int16 from `select_candidates`.
    first_image_row, first_row
        Image row, and row of `similarity`, of the first row of `candidates`. `similarity` must hold `radius`
        rows more on both sides where the image has them.
    config
        Window and weights.

    Returns
    -------
    ``(h, W, K)`` float32 mean similarity C_A, -1 where there is no candidate. Neighbours whose partner would
    be outside the main view are left out of the mean.
    """
    config = config or AggregationConfig()
    # Windows are taken as whole vectors, and so everything has margins.
    radius, side = config.radius, 2 * config.radius + 1
    weights = np.pad(support_weights(config), ((0, 0), (LANES, LANES + -side % LANES)))
    rows, width, disparities = similarity.shape
    margin = _whole_vectors(radius)
    tile_shape = (-(-rows // TILE_ROWS), _whole_vectors(width + 2 * margin) // LANES, TILE_ROWS, LANES)
    tiles = np.zeros((disparities, *tile_shape), dtype=np.uint8)
    fill_tiles(similarity, margin, tiles)
    labels = np.full((len(candidates) + 2 * radius, tile_shape[1] * LANES), -1, dtype=np.int32)
    first, last = max(first_image_row - radius, 0), first_image_row + len(candidates) + radius
    inside = segments[first:last]
    top = first - (first_image_row - radius)
    labels[top : top + len(inside), margin : margin + width] = inside
    scratch = np.empty(2 * weights.size, dtype=np.float32)
    scores = np.empty(candidates.shape, dtype=np.float32)
    aggregate_rows(tiles, margin, labels, candidates, weights, radius, first_row, scratch, scores)
    return scores


def _whole_vectors(count: int) -> int:
    return -(-count // LANES) * LANES


def winner_takes_all(scores: NDArray[np.float32], candidates: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the candidate of highest score (equation 9), ties to the smaller disparity, ``(h, W)`` int16.

    -1 where a pixel has no candidate.
    """
    winner = np.empty(candidates.shape[:2], dtype=np.int16)
    best_candidates(scores, candidates, winner)
    return winner
