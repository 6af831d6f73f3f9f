"""Disparity: the paper's census matching inside segments (section 2.2), and plain window matching."""

from stereohdr.disparity.aggregation import aggregate_in_segments, winner_takes_all
from stereohdr.disparity.candidates import select_candidates
from stereohdr.disparity.census import census_transform, similarity_volume
from stereohdr.disparity.segment_matching import estimate_disparity
from stereohdr.disparity.window_matching import correlation_volume, left_right_check, match_windows

__all__ = [
    "aggregate_in_segments",
    "census_transform",
    "correlation_volume",
    "estimate_disparity",
    "left_right_check",
    "match_windows",
    "select_candidates",
    "similarity_volume",
    "winner_takes_all",
]
