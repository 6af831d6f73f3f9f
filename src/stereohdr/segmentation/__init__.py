"""Two-step segmentation: a super-pixel lattice, then graph-based merging (paper section 2.1, Figure 5)."""

from stereohdr.segmentation.interest import auxiliary_interest, main_interest
from stereohdr.segmentation.lattice import boundary_map, superpixel_lattice
from stereohdr.segmentation.merging import merge_superpixels, segment_photo

__all__ = [
    "auxiliary_interest",
    "boundary_map",
    "main_interest",
    "merge_superpixels",
    "segment_photo",
    "superpixel_lattice",
]
