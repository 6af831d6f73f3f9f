"""BorealHDR: a forest, raw Bayer brackets of a stereo rig that is carried (1 to 3 px between exposures), 12 bit.

References
----------
Gamache et al., "Exposing the unseen: exposure time emulation for offline benchmarking of vision algorithms",
IROS 2024. The views are not rectified: corresponding points lie 11 to 28 rows apart.
"""

from __future__ import annotations

from pathlib import Path

from stereohdr.datasets.brackets import StereoBracket, read_bracket_view
from stereohdr.datasets.resizing import bayer_to_rgb
from stereohdr.errors import FileFormatError
from stereohdr.io.response_files import read_response_table
from stereohdr.model import ResponseCurve

WHITE_LEVEL = 4094
"""The sensor clips here, one code below the 12-bit range: no pixel of any photo holds 4095."""


def read_boreal(folder: str | Path, calibration: str | Path | None = None) -> StereoBracket:
    """Read the brackets of both cameras in RGB of half the size.

    Parameters
    ----------
    folder
        Holds ``left_01.0ms.png``, ..., ``right_32.0ms.png``: RGGB mosaics in 16-bit PNG.
    calibration
        Inverse response of the cameras, see `read_inverse_response`; without it the response is unknown.

    Returns
    -------
    Photos of 960x600 pixels, see `stereohdr.datasets.resizing.bayer_to_rgb`; not rectified.

    Raises
    ------
    FileFormatError
        A photo or the calibration is missing or damaged.
    """
    folder = Path(folder)
    left, right = (
        tuple(bayer_to_rgb(photo) for photo in read_bracket_view(folder, side, white_level=WHITE_LEVEL))
        for side in ("left", "right")
    )
    response = None
    if calibration is not None:
        response = read_inverse_response(calibration).with_channels(3)
    return StereoBracket("Boreal", left, right, response)


def read_inverse_response(path: str | Path) -> ResponseCurve:
    """Read a photometric calibration (``pcalib.txt``): 256 exposures of evenly spaced codes, in any unit.

    Raises
    ------
    FileFormatError
        The file cannot be read, or does not hold 256 increasing positive numbers.
    """
    curve = read_response_table(path)
    if curve.channels != 1:
        raise FileFormatError(
            f"{path}: a photometric calibration holds 256 numbers, not three columns; give pcalib.txt"
        )
    return curve
