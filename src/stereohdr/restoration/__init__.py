"""Making the warped auxiliary view whole: rejection, filling, filtering, Poisson editing (section 2.3)."""

from stereohdr.restoration.background_filling import fill_from_background
from stereohdr.restoration.domain_transform import edge_preserving_filter
from stereohdr.restoration.poisson import poisson_edit
from stereohdr.restoration.ray_filling import fill_holes
from stereohdr.restoration.rejection import reject_uncertain

__all__ = ["edge_preserving_filter", "fill_from_background", "fill_holes", "poisson_edit", "reject_uncertain"]
