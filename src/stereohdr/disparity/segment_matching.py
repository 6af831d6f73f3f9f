"""The paper's disparity estimation from end to end, strip by strip (section 2.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import AggregationConfig, CandidateConfig, CensusConfig
from stereohdr.disparity.aggregation import aggregate_in_segments, winner_takes_all
from stereohdr.disparity.candidates import select_candidates
from stereohdr.disparity.census import census_transform, similarity_volume
from stereohdr.model import Disparity, DisparityFlag
from stereohdr.strips import available_threads, run_strips

STRIP_BYTES = 64 * 2**20
"""Similarity that one thread holds at a time, in both layouts, as far as `STRIP_ROWS` allows."""

MOST_BYTES = 512 * 2**20
"""What all threads may hold together; with wide photos and many disparities fewer of them run."""

STRIP_ROWS = (16, 48)
"""Fewest and most rows matched at a time, without the margin."""


def estimate_disparity(
    auxiliary: NDArray[np.float32],
    main: NDArray[np.float32],
    segments: NDArray[np.int32],
    interest: NDArray[np.bool_],
    *,
    max_disparity: int,
    census: CensusConfig | None = None,
    candidates: CandidateConfig | None = None,
    aggregation: AggregationConfig | None = None,
    threads: int | None = None,
) -> Disparity:
    """Estimate the disparity D_a of the auxiliary view inside the interest region.

    Parameters
    ----------
    auxiliary, main
        ``(H, W)`` float32 luminance of the initial radiance of both views.
    segments
        ``(H, W)`` int32, segments G_a of the auxiliary view.
    interest
        ``(H, W)`` bool, auxiliary pixels that need a disparity.
    max_disparity
        d_max, pixels.
    census, candidates, aggregation
        Parameters of the steps.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    Integer disparities in the auxiliary view, ``x_main = x_auxiliary + d``. Exactly the steps
    `census_transform`, `similarity_volume`, `select_candidates`, `aggregate_in_segments` and
    `winner_takes_all` on the whole image, computed in strips with enough rows around them.
    """
    census = census or CensusConfig()
    candidates = candidates or CandidateConfig()
    aggregation = aggregation or AggregationConfig()
    codes_auxiliary = census_transform(auxiliary, config=census, threads=threads)
    codes_main = census_transform(main, config=census, threads=threads)
    height, width = interest.shape
    margin = max(aggregation.radius, candidates.box // 2)
    winner = np.full((height, width), -1, dtype=np.int16)

    def task(start: int, stop: int) -> None:
        wanted = interest[start:stop]
        if not wanted.any():
            return
        top, bottom = max(0, start - margin), min(height, stop + margin)
        similarity = similarity_volume(
            codes_auxiliary, codes_main, max_disparity=max_disparity, rows=(top, bottom), config=census
        )
        found = select_candidates(similarity, wanted, first_row=start - top, config=candidates)
        scores = aggregate_in_segments(
            similarity,
            segments,
            found,
            first_image_row=start,
            first_row=start - top,
            config=aggregation,
        )
        winner[start:stop] = winner_takes_all(scores, found)

    fewest, most = STRIP_ROWS
    affordable = STRIP_BYTES // (2 * width * (max_disparity + 1)) - 2 * margin
    rows = min(max(affordable, fewest), most)
    at_once = MOST_BYTES // (2 * width * (max_disparity + 1) * (rows + 2 * margin))
    run_strips(task, height, strip_rows=rows, threads=max(min(threads or available_threads(), at_once), 1))
    flags = np.where(winner >= 0, DisparityFlag.MATCHED, DisparityFlag.NOT_COMPUTED).astype(np.uint8)
    return Disparity(np.maximum(winner, 0).astype(np.float32), flags)
