"""Response of a stereo pair: codes of equal cumulative frequency see equal radiance (paper section 2.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import CdfResponseConfig
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
        One channel of each view, any shape, integers 0..255.

    Returns
    -------
    ``(N, 2)`` intp, N <= 256: codes in the main and the auxiliary view.

    Notes
    -----
    Source: paper section 2.1 and Figure 2a; Grossberg and Nayar 2003 for a single camera.
    """
    levels = np.arange(RESPONSE_KNOTS) / (RESPONSE_KNOTS - 1)
    codes = []
    for view in (main, auxiliary):
        counts = np.bincount(np.ravel(view), minlength=RESPONSE_KNOTS)
        cumulative = np.cumsum(counts) / counts.sum()
        codes.append(np.abs(cumulative[None, :] - levels[:, None]).argmin(axis=1))
    pairs = np.stack(codes, axis=1)
    unclipped = ((pairs > 0) & (pairs < RESPONSE_KNOTS - 1)).all(axis=1)
    return pairs[unclipped]


def knot_codes(photo: Photo) -> NDArray[np.intp]:
    """Return the codes rounded to the 256 knots of a response curve, ``(H, W, C)``; 8-bit codes as they are."""
    codes = photo.codes.astype(np.intp)
    if photo.white == RESPONSE_KNOTS - 1:
        return codes
    return (codes * (2 * (RESPONSE_KNOTS - 1)) + photo.white) // (2 * photo.white)


def estimate_response(pair: StereoPair, *, config: CdfResponseConfig | None = None) -> ResponseCurve:
    """Estimate the inverse response of the camera type from one pair.

    Parameters
    ----------
    pair
        Photos of the same camera type at two exposures.
    config
        Smoothness of the curve.

    Returns
    -------
    One curve per channel. A channel that is clipped nearly everywhere takes the mean of the others.

    Raises
    ------
    ResponseError
        No channel has enough unclipped codes in common.
    """
    config = config or CdfResponseConfig()
    main, auxiliary = knot_codes(pair.main_photo), knot_codes(pair.auxiliary_photo)
    curves: list[NDArray[np.float64] | None] = []
    for channel in range(main.shape[2]):
        samples = cdf_sample_pairs(main[..., channel], auxiliary[..., channel])
        enough = len(samples) >= MINIMUM_PAIRS
        curves.append(solve_response(samples, pair.exposures, smoothness=config.smoothness) if enough else None)
    known = [curve for curve in curves if curve is not None]
    if not known:
        raise ResponseError(
            f"{pair.left.name} and {pair.right.name} have no overlap in exposure: hardly any radiance is "
            f"coded by both, so the response cannot be estimated; give a saved response, or choose exposures "
            f"that are closer together (the ratio is {pair.exposure_ratio:.3g})"
        )
    mean = np.mean(known, axis=0)
    return ResponseCurve(np.stack([mean if curve is None else curve for curve in curves]))
