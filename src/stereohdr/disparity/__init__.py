"""Disparity of the auxiliary view: census similarity, candidates, aggregation inside segments (section 2.2)."""

from stereohdr.disparity.aggregation import aggregate_in_segments, winner_takes_all
from stereohdr.disparity.candidates import select_candidates
from stereohdr.disparity.census import census_transform, similarity_volume
from stereohdr.disparity.segment_matching import estimate_disparity

__all__ = [
    "aggregate_in_segments",
    "census_transform",
    "estimate_disparity",
    "select_candidates",
    "similarity_volume",
    "winner_takes_all",
]
