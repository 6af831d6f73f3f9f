"""Aggregation inside segments and winner-takes-all (equations 6 to 9)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import AggregationConfig
from stereohdr.disparity._kernels import aggregate_rows


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
        ``(H, W)`` int32, G_a, the whole image.
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
    scores = np.empty(candidates.shape, dtype=np.float32)
    weights = support_weights(config)
    aggregate_rows(similarity, segments, candidates, weights, first_image_row, first_row, scores)
    return scores


def winner_takes_all(scores: NDArray[np.float32], candidates: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the candidate of highest score (equation 9), ties to the smaller disparity, ``(h, W)`` int16.

    -1 where a pixel has no candidate.
    """
    best = scores.max(axis=2, keepdims=True)
    none = np.int16(np.iinfo(np.int16).max)
    tied = np.where((scores == best) & (candidates >= 0), candidates, none)
    winner = tied.min(axis=2)
    return np.where(winner == none, np.int16(-1), winner)
