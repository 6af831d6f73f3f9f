"""Exposure settings that a camera left in a photo (EXIF), and exposure times as people write them."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from stereohdr.errors import ExposureError, FileFormatError

ImageKind = Literal["PNG", "JPEG", "TIFF"]

ORIENTATION = 274
EXIF_FOLDER = 34665
EXPOSURE_TIME = 33434
F_NUMBER = 33437
ISO = 34855

ISO_OVERFLOW = 65535
"""What cameras write into the 16-bit ISO tag when the true value does not fit."""

# The EXIF names under which tifffile lists the tags of the EXIF folder; EXIF 2.3 renamed the ISO tag.
_TIFFFILE_NAMES = {
    EXPOSURE_TIME: ("ExposureTime",),
    F_NUMBER: ("FNumber",),
    ISO: ("PhotographicSensitivity", "ISOSpeedRatings"),
}

_SIGNATURES: dict[bytes, ImageKind] = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",  # BigTIFF
    b"MM\0+": "TIFF",
}

_NUMBER = r"((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?)"
_TIME = re.compile(rf"\s*{_NUMBER}\s*(?:/\s*{_NUMBER})?\s*(s|ms)?\s*", re.IGNORECASE)


@dataclass(frozen=True)
class Exposure:
    """How a photo was exposed, as far as the file says."""

    time: float | None = None
    """Exposure time in seconds."""
    f_number: float | None = None
    """Focal length over aperture diameter."""
    iso: float | None = None
    """Sensitivity."""


def parse_exposure_time(text: str) -> float:
    """Return the exposure time in seconds that `text` states.

    Parameters
    ----------
    text
        A number or a fraction, in seconds or with a unit: ``0.25``, ``1/60``, ``2``, ``1/60 s``, ``250ms``.

    Raises
    ------
    ExposureError
        Anything else, and times that are not positive and finite.
    """
    match = _TIME.fullmatch(text)
    seconds = math.nan
    if match is not None:
        numerator, denominator, unit = match.groups()
        divisor = float(denominator or 1) * (1000 if (unit or "s").lower() == "ms" else 1)
        seconds = float(numerator) / divisor if divisor > 0 else math.nan
    if not (math.isfinite(seconds) and seconds > 0):
        raise ExposureError(
            f"{text!r} is not an exposure time; give a positive number of seconds such as 0.25, 2, 1/60, "
            f"'1/60 s' or 250ms"
        )
    return seconds


def read_exposure(path: str | Path) -> Exposure:
    """Read exposure time, f-number and ISO from the EXIF data of a JPEG, PNG or TIFF file.

    What the file does not state, or states in a broken way (0/0, zero, not a number), is None.

    Raises
    ------
    FileFormatError
        The file cannot be read, or is none of these formats.
    """
    return exposure_from_tags(read_tags(path))


def exposure_from_tags(tags: Mapping[int, Any]) -> Exposure:
    """Return the exposure that `tags` (see `read_tags`) state, None for what is missing or broken."""
    iso = _positive(tags.get(ISO))
    return Exposure(
        time=_positive(tags.get(EXPOSURE_TIME)),
        f_number=_positive(tags.get(F_NUMBER)),
        iso=None if iso == ISO_OVERFLOW else iso,
    )


def read_tags(path: str | Path) -> dict[int, Any]:
    """Read the tags `ORIENTATION`, `EXPOSURE_TIME`, `F_NUMBER` and `ISO` of a photo, those that exist.

    Damaged EXIF data counts as missing: a photo is usable without it.

    Raises
    ------
    FileFormatError
        The file cannot be read, or is not PNG, JPEG or TIFF.
    """
    kind = image_kind(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow's remarks on odd EXIF data and on big images
        try:
            return _tiff_tags(path) if kind == "TIFF" else _pillow_tags(path)
        except Exception:  # the decoders raise many kinds of errors on damaged metadata
            return {}


def image_kind(path: str | Path) -> ImageKind:
    """Tell PNG, JPEG and TIFF apart by their first bytes, whatever the file is called.

    Raises
    ------
    FileFormatError
        The file cannot be read, or is none of them.
    """
    head = first_bytes(path, 8)
    for signature, kind in _SIGNATURES.items():
        if head.startswith(signature):
            return kind
    found = "the file is empty" if not head else "not a PNG, JPEG or TIFF file"
    raise FileFormatError(f"{path}: {found}; give a photo as PNG, JPEG or TIFF")


def first_bytes(path: str | Path, count: int) -> bytes:
    """Return the first `count` bytes of a file, fewer if it is shorter.

    Raises
    ------
    FileFormatError
        There is no such file, it is a folder, or it must not be read.
    """
    try:
        if Path(path).is_dir():
            raise FileFormatError(f"{path}: is a folder; give the name of a file")
        with open(path, "rb") as file:
            return file.read(count)
    except FileNotFoundError as error:
        raise FileFormatError(f"{path}: no such file; check the name and the folder") from error
    except FileFormatError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name that holds a NUL byte
        reason = getattr(error, "strerror", None) or error
        raise FileFormatError(f"{path}: cannot be read ({reason}); check its permissions") from error


def _pillow_tags(path: str | Path) -> dict[int, Any]:
    from PIL import Image

    with Image.open(path, formats=("PNG", "JPEG", "MPO")) as image:
        exif = image.getexif()
        # The pieces are parsed one by one, so that a broken EXIF folder leaves the orientation usable.
        tags: dict[int, Any] = {ORIENTATION: exif.get(ORIENTATION)}
        try:
            folder = exif.get_ifd(EXIF_FOLDER)
        except Exception:
            folder = {}
        for tag in (EXPOSURE_TIME, F_NUMBER, ISO):
            tags[tag] = folder.get(tag, exif.get(tag))
    return {tag: value for tag, value in tags.items() if value is not None}


def _tiff_tags(path: str | Path) -> dict[int, Any]:
    import tifffile

    # Not by Pillow: it refuses to open the TIFF layouts that it cannot decode, and BigTIFF metadata.
    with tifffile.TiffFile(path) as file:
        page_tags: Any = file.pages.first
        page_tags = page_tags.tags
        folder = page_tags.valueof(EXIF_FOLDER)
        tags = {ORIENTATION: page_tags.valueof(ORIENTATION)}
        for tag, names in _TIFFFILE_NAMES.items():
            tags[tag] = page_tags.valueof(tag)  # TIFF/EP and raw converters put them beside the image tags
            for name in names:
                if isinstance(folder, Mapping) and name in folder:
                    tags[tag] = folder[name]
    return {tag: value for tag, value in tags.items() if value is not None}


def _positive(value: Any) -> float | None:
    """Return an EXIF value as a number, None unless it is positive and finite.

    A value is a number, Pillow's rational, tifffile's ``(numerator, denominator)``, or a list of ISO values
    whose first one counts.
    """
    try:
        if isinstance(value, tuple | list):
            value = value[0] / value[1] if len(value) == 2 else value[0]
        number = float(value)
    except (TypeError, ValueError, ArithmeticError, LookupError):
        return None
    return number if math.isfinite(number) and number > 0 else None
