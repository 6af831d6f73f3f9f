"""What a camera left in a photo (exposure, camera, colour profile), and exposure times as people write them."""

from __future__ import annotations

import io
import logging
import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from stereohdr.errors import ExposureError, FileFormatError

# What tifffile remarks on damaged files goes to whoever set up logging, and not to the terminal.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

ImageKind = Literal["PNG", "JPEG", "TIFF", "HEIF", "AVIF", "NPY", "RAW"]

MAKER = 271
MODEL = 272
ORIENTATION = 274
EXIF_FOLDER = 34665
COLOUR_PROFILE = 34675
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
    b"\x93NUMPY": "NPY",
}

_RAW_SIGNATURES = (
    b"II*\0\x10\0\0\0CR",  # Canon CR2
    b"FUJIFILMCCD-RAW",
    b"IIRO",  # Olympus
    b"IIRS",
    b"MMOR",
    b"IIU\0",  # Panasonic
    b"\0MRM",  # Minolta
    b"FOVb",  # Sigma
    b"II\x1a\0\0\0HEAPCCDR",  # Canon CRW
)

_RAW_SUFFIXES = {
    *(".dng", ".nef", ".nrw", ".arw", ".sr2", ".srf", ".pef", ".3fr", ".fff", ".iiq", ".erf"),
    *(".mef", ".mos", ".dcr", ".kdc", ".srw", ".rwl", ".cr2", ".cr3"),
}
"""Camera raw files that are, or pretend to be, TIFF."""

_HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")

_CFA, _LINEAR_RAW = 32803, 34892
"""TIFF photometric interpretations of sensor data."""

_DNG_VERSION = 50706

_BAYER_COMPRESSIONS = (1, 5, 8, 32773, 32946, 50000)
"""Mosaics packed like other TIFFs (none, LZW, Deflate, PackBits, Zstandard); others are some maker's own."""

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
    """Read exposure time, f-number and ISO from the EXIF data of a photo.

    What the file does not state, or states in a broken way (0/0, zero, not a number), is None.

    Raises
    ------
    FileFormatError
        The file cannot be read, or is no photo.
    """
    return exposure_from_tags(read_tags(path))


def exposure_from_tags(tags: Mapping[int, Any]) -> Exposure:
    """Return the exposure that `tags` (see `read_tags`) state, None for what is missing or broken."""
    sensitivities = tags.get(ISO)  # a whole number, or several: not a fraction
    iso = positive_number(sensitivities[:1] if isinstance(sensitivities, tuple | list) else sensitivities)
    return Exposure(
        time=positive_number(tags.get(EXPOSURE_TIME)),
        f_number=positive_number(tags.get(F_NUMBER)),
        iso=None if iso == ISO_OVERFLOW else iso,
    )


def camera_from_tags(tags: Mapping[int, Any]) -> str | None:
    """Return maker and model of the camera that `tags` (see `read_tags`) state, None when they do not.

    Makers repeat their name in the model ("NIKON CORPORATION", "NIKON D750"); it is then left out.
    """
    maker, model = (" ".join(str(tags.get(tag) or "").strip("\0 ").split()) for tag in (MAKER, MODEL))
    if not model:
        return maker or None
    first_word = maker.split(" ")[0].lower()
    return model if model.lower().startswith(first_word) else f"{maker} {model}"


def profile_name(profile: bytes) -> str | None:
    """Return the name of an ICC colour profile, None for profiles of grey pictures and damaged ones."""
    from PIL import ImageCms

    try:
        opened: Any = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        if opened.profile.xcolor_space.strip() != "RGB":
            return None
        return ImageCms.getProfileDescription(opened).strip() or "unnamed"
    except (ImageCms.PyCMSError, OSError, AttributeError):
        return None


def read_tags(path: str | Path) -> dict[int, Any]:
    """Read what a photo says about itself, as EXIF tags, those that exist.

    These are `MAKER`, `MODEL`, `ORIENTATION`, `EXPOSURE_TIME`, `F_NUMBER`, `ISO` and `COLOUR_PROFILE` (bytes).
    Damaged metadata counts as missing: a photo is usable without it.

    Raises
    ------
    FileFormatError
        The file cannot be read, or is no photo.
    """
    kind = image_kind(path)
    readers = {"TIFF": _tiff_tags, "RAW": _tiff_tags, "HEIF": _heif_tags, "NPY": lambda path: {}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow's remarks on odd EXIF data and on big images
        try:
            return readers.get(kind, _pillow_tags)(path)
        except Exception:  # the decoders raise many kinds of errors on damaged metadata
            return {}


def image_kind(path: str | Path) -> ImageKind:
    """Tell the formats of photos apart by their first bytes, whatever the file is called.

    Camera raw files that look like TIFF are told by what is in them, and where that is not enough by their suffix.

    Raises
    ------
    FileFormatError
        The file cannot be read, or is none of them.
    """
    head = first_bytes(path, 32)
    if head.startswith(_RAW_SIGNATURES) or head[4:12] == b"ftypcrx ":
        return "RAW"
    if head[4:8] == b"ftyp":
        brands = [head[at : at + 4] for at in (8, *range(16, 32, 4))]
        if b"avif" in brands or b"avis" in brands:
            return "AVIF"
        if any(brand in _HEIF_BRANDS for brand in brands):
            return "HEIF"
    for signature, kind in _SIGNATURES.items():
        if head.startswith(signature):
            is_raw = kind == "TIFF" and (Path(path).suffix.lower() in _RAW_SUFFIXES or _holds_raw(path))
            return "RAW" if is_raw else kind
    found = "the file is empty" if not head else "not a PNG, JPEG, TIFF, HEIC, AVIF, NumPy or camera raw file"
    raise FileFormatError(f"{path}: {found}; give a photo, for instance as PNG, JPEG or TIFF")


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


def _holds_raw(path: str | Path) -> bool:
    """Tell whether a TIFF is a camera raw file: DNG, sensor data beside a preview or in a maker's own packing."""
    import tifffile

    try:
        with tifffile.TiffFile(path) as file:
            first: Any = file.pages.first
            if _DNG_VERSION in first.tags:
                return True
            if int(first.photometric) == _CFA:
                return int(first.compression) not in _BAYER_COMPRESSIONS
            return any(int(page.photometric) in (_CFA, _LINEAR_RAW) for page in first.pages or ())
    except Exception:  # damaged: whoever decodes it will say so
        return False


def _pillow_tags(path: str | Path) -> dict[int, Any]:
    from PIL import Image

    with Image.open(path, formats=("PNG", "JPEG", "AVIF")) as image:
        return _exif_tags(image.getexif(), image.info.get("icc_profile"))


def _heif_tags(path: str | Path) -> dict[int, Any]:
    from PIL import Image

    from stereohdr.io.heif import heif_metadata

    block, profile = heif_metadata(path)
    exif = Image.Exif()
    if block:
        exif.load(block)
    tags = _exif_tags(exif, profile)
    tags.pop(ORIENTATION, None)  # the decoder turns the picture: the format has a property of its own for that
    return tags


def _exif_tags(exif: Any, profile: bytes | None) -> dict[int, Any]:
    # The pieces are parsed one by one, so that a broken EXIF folder leaves the orientation usable.
    tags: dict[int, Any] = {tag: exif.get(tag) for tag in (MAKER, MODEL, ORIENTATION)}
    try:
        folder = exif.get_ifd(EXIF_FOLDER)
    except Exception:
        folder = {}
    for tag in (EXPOSURE_TIME, F_NUMBER, ISO):
        tags[tag] = folder.get(tag, exif.get(tag))
    tags[COLOUR_PROFILE] = profile
    return {tag: value for tag, value in tags.items() if value is not None}


def _tiff_tags(path: str | Path) -> dict[int, Any]:
    import tifffile

    # Not by Pillow: it refuses to open the TIFF layouts that it cannot decode, and BigTIFF metadata.
    with tifffile.TiffFile(path) as file:
        page_tags: Any = file.pages.first
        page_tags = page_tags.tags
        folder = page_tags.valueof(EXIF_FOLDER)
        tags = {tag: page_tags.valueof(tag) for tag in (MAKER, MODEL, ORIENTATION, COLOUR_PROFILE)}
        for tag, names in _TIFFFILE_NAMES.items():
            tags[tag] = page_tags.valueof(tag)  # TIFF/EP and raw converters put them beside the image tags
            for name in names:
                if isinstance(folder, Mapping) and name in folder:
                    tags[tag] = folder[name]
    return {tag: value for tag, value in tags.items() if value is not None}


def positive_number(value: Any) -> float | None:
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
