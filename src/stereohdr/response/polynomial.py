"""Response as a polynomial, fitted to pixels that are known to correspond."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import PolynomialResponseConfig
from stereohdr.model import MID_KNOT, RESPONSE_KNOTS, Disparity, DisparityFlag, ResponseCurve, StereoPair
from stereohdr.response.cdf_matching import MINIMUM_PAIRS, knot_codes
from stereohdr.response.debevec1997 import debevec_weight

USED_CODES = (5, 250)
"""Lowest and highest code (of 255) that take part; nearer to the ends clipping bends the relation."""

OUTLIER = 3.0
"""Pairs further than this many median absolute errors from one fit are left out of the next."""

FITS = 10
"""Most fits of one curve."""


def fit_polynomial_response(
    pair: StereoPair, disparity: Disparity, *, config: PolynomialResponseConfig | None = None
) -> ResponseCurve | None:
    """Fit ``ln X = g(z)`` to the codes of corresponding pixels.

    ``g(z) = a ln(u) + b_1 u + ... + b_n u^n`` plus what makes ``g(128) = 0``, with ``u = (z + 1/2) / 256``: a
    gamma curve times the exponential of a polynomial. Each pixel gives the equation
    ``g(z_main) - g(z_auxiliary) = ln t_main - ln t_auxiliary``, weighted by the smaller hat weight of its codes;
    least squares, and again without outliers until these stay the same.

    Parameters
    ----------
    pair
        Photos; the main view is the left one.
    disparity
        Disparity of the **main** view, rounded to whole pixels; only ``MATCHED`` pixels count.
    config
        Degree n. A curve that does not rise at every code is fitted again with a lower degree.

    Returns
    -------
    One rising curve per channel; a channel without enough unclipped pairs, or for which not even a gamma curve
    rises, takes the mean of the others. None when this holds for all channels.

    Notes
    -----
    Known of Sun et al. 2010: a polynomial response, fitted to matched pixels. Chosen here: its form and the fit.
    """
    config = config or PolynomialResponseConfig()
    y, x = np.nonzero(disparity.flags == DisparityFlag.MATCHED)
    partner = x - np.rint(disparity.values[y, x]).astype(np.intp)
    y, x, partner = (index[partner >= 0] for index in (y, x, partner))
    main, auxiliary = (
        knot_codes(photo.codes[y, column], photo.white)
        for photo, column in ((pair.main_photo, x), (pair.auxiliary_photo, partner))
    )
    log_ratio = float(np.log(pair.exposures[0] / pair.exposures[1]))
    curves = [
        _channel_curve(main[:, c], auxiliary[:, c], log_ratio, config.degree) for c in range(pair.left.channels)
    ]
    known = [curve for curve in curves if curve is not None]
    if not known:
        return None
    mean = np.mean(known, axis=0)
    return ResponseCurve(np.stack([mean if curve is None else curve for curve in curves]))


def _channel_curve(
    main: NDArray[np.intp], auxiliary: NDArray[np.intp], log_ratio: float, degree: int
) -> NDArray[np.float64] | None:
    low, high = USED_CODES
    codes = np.stack([main, auxiliary])
    inside = ((codes >= low) & (codes <= high)).all(axis=0)
    # One equation per pair of codes that occurs, weighted by how often: 256^2 at most, whatever the image size.
    cells, count = np.unique(codes[0, inside] * RESPONSE_KNOTS + codes[1, inside], return_counts=True)
    main, auxiliary = cells // RESPONSE_KNOTS, cells % RESPONSE_KNOTS
    weight = count * np.minimum(debevec_weight(main), debevec_weight(auxiliary))
    u = (np.arange(RESPONSE_KNOTS) + 0.5) / RESPONSE_KNOTS
    for terms in range(degree + 1, 0, -1):
        powers = np.column_stack([np.log(u), u[:, None] ** np.arange(1, terms)])
        powers -= powers[MID_KNOT]
        rows = powers[main] - powers[auxiliary]
        kept = np.ones(len(cells), dtype=bool)
        coefficients = np.zeros(terms)
        for _ in range(FITS):
            if count[kept].sum() < MINIMUM_PAIRS:
                return None
            share = weight[kept, None]
            normal = rows[kept].T @ (share * rows[kept])
            normal[np.diag_indices(terms)] += 1e-9 * np.trace(normal)
            coefficients = np.linalg.solve(normal, rows[kept].T @ (share[:, 0] * log_ratio))
            error = np.abs(rows @ coefficients - log_ratio)
            before, kept = kept, error <= OUTLIER * _weighted_median(error, weight)
            if (kept == before).all():
                break
        curve = powers @ coefficients
        if (np.diff(curve) > 0).all():
            return np.round(curve, 6)
    return None


def _weighted_median(values: NDArray[np.float64], weight: NDArray[Any]) -> float:
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, 0.5 * below[-1])])
