"""Inverse camera response: from the two views' histograms, solved after Debevec and Malik."""

from stereohdr.response.cdf_matching import cdf_sample_pairs, estimate_response
from stereohdr.response.debevec1997 import debevec_weight, solve_response

__all__ = ["cdf_sample_pairs", "debevec_weight", "estimate_response", "solve_response"]
