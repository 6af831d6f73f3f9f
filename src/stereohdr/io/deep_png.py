"""Writing photos as 16-bit PNG, with their exposure as EXIF data."""

from __future__ import annotations

import struct
import zlib
from fractions import Fraction
from pathlib import Path

import numpy as np

from stereohdr.errors import FileFormatError
from stereohdr.io.files import atomic_path
from stereohdr.io.metadata import EXIF_FOLDER, EXPOSURE_TIME, F_NUMBER, ISO
from stereohdr.model import Photo

WHITE = 65535

_HEADER = 8 + 25
"""Bytes of the signature and the first chunk, after which the EXIF chunk may stand."""


def write_photo(path: str | Path, photo: Photo) -> None:
    """Write a photo as 16-bit PNG, whole or not at all.

    Codes are scaled so that white is 65535: whoever reads the file need not be told the white level.

    Parameters
    ----------
    path
        Ends in ``.png``.
    photo
        ``(H, W, C)``. What is known of its exposure is written as EXIF data.

    Raises
    ------
    FileFormatError
        Another suffix, or the file cannot be written.
    """
    import imagecodecs

    if Path(path).suffix.lower() != ".png":
        raise FileFormatError(f"{path}: this photo is written as PNG; give a name that ends in .png")
    codes = np.rint(photo.codes * (WHITE / photo.white)).astype(np.uint16)
    data = imagecodecs.png_encode(codes[..., 0] if photo.channels == 1 else codes)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data[:_HEADER] + _exif_chunk(photo) + data[_HEADER:])


def _exif_chunk(photo: Photo) -> bytes:
    from PIL import Image
    from PIL.TiffImagePlugin import IFDRational

    tags = {
        EXPOSURE_TIME: None if photo.exposure_time is None else IFDRational(*_rational(photo.exposure_time)),
        F_NUMBER: None if photo.f_number is None else IFDRational(*_rational(photo.f_number)),
        ISO: None if photo.iso is None else round(photo.iso),
    }
    exif = Image.Exif()
    exif.get_ifd(EXIF_FOLDER).update({tag: value for tag, value in tags.items() if value is not None})
    content = b"eXIf" + exif.tobytes().removeprefix(b"Exif\x00\x00")
    return struct.pack(">I", len(content) - 4) + content + struct.pack(">I", zlib.crc32(content))


def _rational(value: float) -> tuple[int, int]:
    """Return a number as EXIF holds it: two whole numbers of 32 bits."""
    fraction = Fraction(value).limit_denominator(1_000_000)
    if fraction == 0:
        fraction = Fraction(1, min(round(1 / value), 2**32 - 1))
    return min(fraction.numerator, 2**32 - 1), fraction.denominator
