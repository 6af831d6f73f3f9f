"""How much memory method ``robust`` takes, stage by stage, and how it matches within a limit.

The numbers are bytes per pixel of arrays that exist at the same time, beside the photos, as `tracemalloc` counts
them; tests compare them with that.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import RobustConfig
from stereohdr.disparity.tiled import MatchingPlan, plan_matching
from stereohdr.memory import Budget, MemoryPlan
from stereohdr.model import StereoPair
from stereohdr.restoration.highlights import SIDE_BY_SIDE_PIXELS
from stereohdr.strips import available_threads
from stereohdr.survey import survey_bytes

LUMINANCE = 8.0
"""What is matched, both views."""


def plan_robust(
    pair: StereoPair,
    disparities: tuple[int, int] | None,
    config: RobustConfig,
    budget: Budget,
    *,
    clipped: NDArray[np.bool_],
    keep_stages: bool,
    threads: int | None = None,
) -> tuple[MemoryPlan, MatchingPlan]:
    """Estimate what each stage takes, and choose how to match.

    Parameters
    ----------
    pair
        Photos.
    disparities
        Smallest and largest disparity to try, pixels; None when the disparity is known.
    config
        Of the method.
    budget
        What may be taken.
    clipped
        ``(H, W)`` bool, the pixels that a shorter auxiliary exposure restores.
    keep_stages
        Whether every intermediate array is kept.
    threads
        Threads that will be used.

    Returns
    -------
    The plan of the whole, which may be above the limit, and that of the matching.
    """
    pixels, channels = clipped.size, pair.main_photo.channels
    left = budget.limit - budget.held
    matching = MatchingPlan(1, False, 0)
    if disparities is not None:
        most = left - math.ceil(LUMINANCE * pixels)
        matching = plan_matching(clipped.shape, disparities, memory=most, runs=config.two_way.runs)
    kept = 5 + 14 * channels if keep_stages else 0
    stages = {
        "the survey": survey_bytes(pair, max_disparity=config.max_disparity, config=config.survey, memory=left),
        "matching": LUMINANCE * pixels + matching.bytes,
        "the response": (17 + 14 * channels) * pixels,
        "the result": (14 + 23 * channels + kept) * pixels,
    }
    if pair.exposures[1] < pair.exposures[0]:
        rows, box = _rows_and_box(clipped)
        at_once = min(threads or available_threads(), channels) if rows <= SIDE_BY_SIDE_PIXELS else 1
        stages["restoring highlights"] = (20 + 11 * channels + kept) * pixels + at_once * (28 * rows + 72 * box)
    else:
        stages["cleaning shadows"] = (22 + 19 * channels + kept) * pixels
    stage, most_bytes = max(stages.items(), key=lambda item: item[1])
    estimate = budget.held + math.ceil(most_bytes)
    return MemoryPlan(budget.limit, estimate, stage, matching.strips, matching.coarse_to_fine), matching


def _rows_and_box(clipped: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the number of pixels in the rows with clipped pixels, and in the box around them."""
    rows, columns = (np.flatnonzero(clipped.any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return 0, 0
    height = int(rows[-1] - rows[0]) + 3
    return height * clipped.shape[1], height * (int(columns[-1] - columns[0]) + 3)
