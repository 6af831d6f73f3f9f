"""HDR-VDP-2, version 2.2.1: would an observer see the difference of two images, and how much does it disturb?

Own code after the published algorithm (R. Mantiuk, K. J. Kim, A. G. Rempel and W. Heidrich, HDR-VDP-2,
ACM Transactions on Graphics 30(4), 2011, doi:10.1145/2010324.1964935; quality weights of M. Narwaria, R. Mantiuk,
M. P. Da Silva and P. Le Callet, HDR-VDP-2.2, Journal of Electronic Imaging 24(1), 2015,
doi:10.1117/1.JEI.24.1.010501). One file per step:

=========================  =========================================================================
`encodings`                pixel values to linear channels
`spectral`                 channels to cones and rods
`optics`                   scatter in the eye
`receptors`                non-linear response of the photoreceptors
`steerable`                pyramid of frequency bands and orientations (filters in `sp3_filters`)
`contrast_sensitivity`     neural contrast sensitivity of every band at every pixel
`masking`                  differences in units of the threshold (bands meet by `resize`)
`quality`                  differences to Q and Q_MOS
`metric`                   all of it in order
=========================  =========================================================================
"""

from stereohdr.metrics.hdrvdp2.encodings import ENCODINGS
from stereohdr.metrics.hdrvdp2.metric import VERSION, HdrVdp2Result, hdrvdp2
from stereohdr.metrics.hdrvdp2.options import HdrVdp2Options, pixels_per_degree
from stereohdr.metrics.hdrvdp2.quality import PlaneError, quality_213, quality_220, quality_221

__all__ = [
    "ENCODINGS",
    "VERSION",
    "HdrVdp2Options",
    "HdrVdp2Result",
    "PlaneError",
    "hdrvdp2",
    "pixels_per_degree",
    "quality_213",
    "quality_220",
    "quality_221",
]
