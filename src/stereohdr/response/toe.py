"""The lowest codes of a response: what the longer exposure measures where the shorter one is nearly black."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereohdr.model import LARGEST_LOG_EXPOSURE, RESPONSE_KNOTS, ResponseCurve

TOE_CODES = 4
"""Codes 0 to 3: too coarse and noisy for the fit of the curve, and code 0 stands for everything below."""

PRIOR_PIXELS = 100.0
"""The curve counts as so many pixels against those found."""

SMALLEST_STEP = 1e-3
"""Rise of ln X from code to code that is kept."""


def calibrate_toe(response: ResponseCurve, counts: NDArray[np.integer], *, exposure_ratio: float) -> ResponseCurve:
    """Set ln X of the lowest codes to the median that the longer exposure sees there.

    Parameters
    ----------
    response
        Curves fitted to the other codes.
    counts
        ``(C, 256, 256)``, how often knot i of the shorter exposure meets knot j of the longer one at matched
        pixels.
    exposure_ratio
        Longer over shorter exposure, > 1.

    Returns
    -------
    The curves, changed at codes 0 to 3 only, and rising there. Codes that do not occur keep their value.
    """
    curves = response.log_exposure.copy()
    for curve, table in zip(curves, counts, strict=True):
        for code in range(TOE_CODES):
            pixels = table[code].sum()
            if pixels == 0:
                continue
            middle = int(np.searchsorted(np.cumsum(table[code]), 0.5 * pixels))
            seen = curve[min(middle, RESPONSE_KNOTS - 1)] - math.log(exposure_ratio)
            curve[code] = (pixels * seen + PRIOR_PIXELS * curve[code]) / (pixels + PRIOR_PIXELS)
        for code in reversed(range(TOE_CODES)):
            highest = curve[code + 1] - SMALLEST_STEP
            curve[code] = min(max(curve[code], code * SMALLEST_STEP - LARGEST_LOG_EXPOSURE), highest)
    return ResponseCurve(np.round(curves, 6))


def resolve_black(response: ResponseCurve, white_level: int) -> ResponseCurve:
    """Let the exposure go on falling below knot 1, for codes that are finer than the knots.

    An 8-bit code 0 stands for all that rounds to it, and so does knot 0 of a fitted curve. Codes of 10 to 16 bits
    tell more: between knots 0 and 1 their exposure is interpolated linearly, and a knot 0 at half of knot 1 would
    raise all of them.

    Parameters
    ----------
    response
        Fitted curves.
    white_level
        Code at which the sensor clips.

    Returns
    -------
    The curves with knot 0 on the straight line (in exposure) through knots 1 and 2, but not below the exposure of
    half a code; unchanged for 8-bit codes.
    """
    if white_level < RESPONSE_KNOTS:
        return response
    curves = response.log_exposure.copy()
    first, second = np.exp(curves[:, 1]), np.exp(curves[:, 2])
    half_code = 0.5 * (RESPONSE_KNOTS - 1) / white_level
    black = np.log(np.maximum(2 * first - second, half_code * first))
    curves[:, 0] = np.maximum(black, -LARGEST_LOG_EXPOSURE)
    return ResponseCurve(np.round(curves, 6))
