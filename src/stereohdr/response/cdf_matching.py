"""Response of a stereo pair: codes of equal cumulative frequency see equal radiance (paper section 2.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import ResponseConfig
from stereohdr.errors import ResponseError
from stereohdr.model import RESPONSE_KNOTS, Photo, ResponseCurve, StereoPair
from stereohdr.response.debevec1997 import solve_response

MINIMUM_PAIRS = 8
"""A channel with fewer unclipped sample pairs (of 256) does not determine a curve."""


def cdf_sample_pairs(main: NDArray[np.integer], auxiliary: NDArray[np.integer]) -> NDArray[np.intp]:
    """Pair the codes of both views that have the same cumulative frequency.

    For ``u_i = i / 255``: ``z_m = argmin |H_m(z) - u_i|`` and ``z_a = argmin |H_a(z) - u_i|``; pairs in which
    either code is clipped (0 or 255) are dropped.

    Parameters
    ----------
    main, auxiliary
        Histograms of one channel of each view, ``(256,)`` counts of the codes 0..255.

    Returns
    -------
    ``(N, 2)`` intp, N <= 256: codes in the main and the auxiliary view.

    Notes
    -----
    Source: paper section 2.1 and Figure 2a; Grossberg and Nayar 2003 for a single camera.
    """
    levels = np.arange(RESPONSE_KNOTS) / (RESPONSE_KNOTS - 1)
    codes = []
    for counts in (main, auxiliary):
        cumulative = np.cumsum(counts) / counts.sum()
        codes.append(np.abs(cumulative[None, :] - levels[:, None]).argmin(axis=1))
    pairs = np.stack(codes, axis=1)
    unclipped = ((pairs > 0) & (pairs < RESPONSE_KNOTS - 1)).all(axis=1)
    return pairs[unclipped]


def knot_codes(codes: NDArray[np.integer], white_level: int) -> NDArray[np.intp]:
    """Return codes of any shape rounded to the 256 knots of a response curve; 8-bit codes as they are."""
    return (codes.astype(np.intp) * (2 * (RESPONSE_KNOTS - 1)) + white_level) // (2 * white_level)


def knot_histograms(photo: Photo) -> NDArray[np.intp]:
    """Return how often each of the 256 knots occurs, ``(C, 256)``; deeper codes count for the nearest knot."""
    knots = knot_codes(np.arange(photo.white + 1), photo.white)
    histograms = np.zeros((photo.channels, RESPONSE_KNOTS), dtype=np.intp)
    for channel in range(photo.channels):
        counts = np.bincount(photo.codes[..., channel].ravel(), minlength=photo.white + 1)
        np.add.at(histograms[channel], knots, counts)
    return histograms


def estimate_response(
    pair: StereoPair, *, config: ResponseConfig | None = None, max_disparity: int | None = None
) -> ResponseCurve:
    """Estimate the inverse response of the camera type from one pair.

    Parameters
    ----------
    pair
        Photos of the same camera type at two exposures.
    config
        Which sample pairs, and smoothness of the curve.
    max_disparity
        Largest plausible disparity of SIFT matches in pixels, see `sift_sample_pairs`.

    Returns
    -------
    One curve per channel. A channel that is clipped nearly everywhere takes the mean of the others.

    Raises
    ------
    ResponseError
        No channel has enough unclipped codes in common.
    MissingDependencyError
        SIFT samples are asked for, and scikit-image is not installed.
    """
    config = config or ResponseConfig()
    if config.samples == "sift":
        from stereohdr.response.sift_matching import sift_sample_pairs

        samples = sift_sample_pairs(pair, max_disparity=max_disparity)
        problem = "hardly any SIFT features match where both are well exposed"
    else:
        histograms = zip(knot_histograms(pair.main_photo), knot_histograms(pair.auxiliary_photo), strict=True)
        samples = [cdf_sample_pairs(main, auxiliary) for main, auxiliary in histograms]
        problem = "no overlap in exposure, hardly any radiance is coded by both"
    curves: list[NDArray[np.float64] | None] = []
    for pairs in samples:
        enough = len(pairs) >= MINIMUM_PAIRS
        curves.append(solve_response(pairs, pair.exposures, smoothness=config.smoothness) if enough else None)
    known = [curve for curve in curves if curve is not None]
    if not known:
        raise ResponseError(
            f"{pair.left.name} and {pair.right.name}: {problem}, so the response cannot be estimated; give a "
            f"saved response, or choose exposures closer together (the ratio is {pair.exposure_ratio:.3g})"
        )
    mean = np.mean(known, axis=0)
    return ResponseCurve(np.stack([mean if curve is None else curve for curve in curves]))
