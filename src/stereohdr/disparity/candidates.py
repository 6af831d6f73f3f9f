"""Disparity candidates: local maxima of the box-filtered similarity (Min, Lu and Do, ICCV 2011)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import CandidateConfig
from stereohdr.disparity._kernels import candidate_rows


def select_candidates(
    similarity: NDArray[np.uint8],
    wanted: NDArray[np.bool_],
    *,
    first_row: int = 0,
    config: CandidateConfig | None = None,
) -> NDArray[np.int16]:
    """Keep the most promising disparities of each pixel.

    Parameters
    ----------
    similarity
        ``(rows, W, d_max + 1)`` uint8.
    wanted
        ``(h, W)`` bool, pixels that need a disparity.
    first_row
        Row of `similarity` that belongs to the first row of `wanted`; rows around it feed the box filter.
    config
        Box filter and number of candidates.

    Returns
    -------
    ``(h, W, K)`` int16 with K = 10 % of d_max: local maxima over d (a plateau counts once, at its smallest d),
    best first, ties to the smaller d; -1 where there are fewer or the pixel is not wanted.
    """
    config = config or CandidateConfig()
    count = config.count(similarity.shape[2] - 1)
    candidates = np.empty((*wanted.shape, count), dtype=np.int16)
    candidate_rows(similarity, wanted, config.box // 2, first_row, candidates)
    return candidates
