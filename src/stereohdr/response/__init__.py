"""Inverse camera response: from the two views' histograms or SIFT matches, solved after Debevec and Malik."""

from stereohdr.response.cdf_matching import cdf_sample_pairs, estimate_response
from stereohdr.response.debevec1997 import debevec_weight, solve_response
from stereohdr.response.polynomial import fit_polynomial_response
from stereohdr.response.sift_matching import sift_sample_pairs

__all__ = [
    "cdf_sample_pairs",
    "debevec_weight",
    "estimate_response",
    "fit_polynomial_response",
    "sift_sample_pairs",
    "solve_response",
]
