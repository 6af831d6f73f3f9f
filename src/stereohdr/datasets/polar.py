"""POLAR: a static scene on a tripod, left and right bracket of 32 to 2048 ms, linear, grey, 12 bit.

References
----------
NASA Ames, "POLAR stereo dataset" (2017). The views are not rectified: corresponding points lie about 15 rows
apart.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stereohdr.datasets.brackets import StereoBracket, read_bracket_view
from stereohdr.model import MID_KNOT, RESPONSE_KNOTS, ResponseCurve

WHITE_LEVEL = 4094
"""The sensor clips here, one code below the 12-bit range: no pixel of any photo holds 4095."""

BLACK_LEVEL = 14.0
"""Code without light. Measured: photos at twice the exposure have twice ``z - 14`` at all dark codes. (The
response estimated from the left bracket differs from this one by 0.01, RMS of ln X.)"""


def polar_response() -> ResponseCurve:
    """Return the response of the cameras: exposure proportional to the code above the black level, grey."""
    codes = np.linspace(0, WHITE_LEVEL, RESPONSE_KNOTS)
    exposure = np.maximum(codes - BLACK_LEVEL, 0.5)  # half a code stands for what rounds to the black level
    log_exposure = np.log(exposure)
    return ResponseCurve((log_exposure - log_exposure[MID_KNOT])[None])


def read_polar(folder: str | Path) -> StereoBracket:
    """Read the brackets of both cameras.

    Parameters
    ----------
    folder
        Holds ``left_0032ms.png``, ..., ``right_2048ms.png``; 16-bit PNG.

    Returns
    -------
    Photos of 1936x1216 pixels, grey; not rectified.

    Raises
    ------
    FileFormatError
        A photo is missing or damaged.
    """
    folder = Path(folder)
    left = read_bracket_view(folder, "left", white_level=WHITE_LEVEL)
    right = read_bracket_view(folder, "right", white_level=WHITE_LEVEL)
    return StereoBracket("POLAR", left, right, polar_response())
