"""Portable float map, ``.pfm``: a three-line text header, then raw 32-bit floats from the bottom row up."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np

from stereohdr.errors import FileFormatError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Exactly one white-space byte ends the header: the byte after it may be a pixel that looks like white space.
_HEADER = re.compile(rb"(PF|Pf)\s+([0-9]{1,9})\s+([0-9]{1,9})\s+([-+.0-9eE]{1,40})\s")


def decode_pfm(data: bytes, name: str = "PFM data") -> NDArray[np.float32]:
    """Decode a portable float map, grey (``Pf``) or colour (``PF``), of either byte order.

    The magnitude of the scale in the header is ignored, as by most readers; its sign is the byte order.

    Parameters
    ----------
    data
        The whole file.
    name
        What messages call it.

    Returns
    -------
    ``(H, W, C)`` float32, C 1 or 3, top row first; values as stored.

    Raises
    ------
    FileFormatError
        Not a portable float map, or it ends early.
    """
    header = _HEADER.match(data[:256])
    if header is None:
        raise FileFormatError(f"{name}: not a portable float map (PF or Pf header); get the file again")
    width, height = int(header[2]), int(header[3])
    try:
        scale = float(header[4])
    except ValueError:
        scale = math.nan
    if not (math.isfinite(scale) and scale != 0 and width > 0 and height > 0):
        raise FileFormatError(
            f"{name}: damaged PFM header: {width}x{height} pixels, scale {header[4].decode()}; get the file again"
        )
    channels = 3 if header[1] == b"PF" else 1
    count = width * height * channels
    available = (len(data) - header.end()) // 4
    if available < count:
        raise FileFormatError(
            f"{name}: the PFM file ends early, with {available} of {count} values; get the file again"
        )
    values = np.frombuffer(data, "<f4" if scale < 0 else ">f4", count, header.end())
    return values.reshape(height, width, channels)[::-1].astype(np.float32)


def encode_pfm(radiance: NDArray[np.float32]) -> bytes:
    """Encode ``(H, W, C)`` float32, C 1 or 3, as a little-endian portable float map with scale -1.0."""
    height, width, channels = radiance.shape
    header = f"{'PF' if channels == 3 else 'Pf'}\n{width} {height}\n-1.0\n".encode("ascii")
    return header + radiance[::-1].astype("<f4").tobytes()
