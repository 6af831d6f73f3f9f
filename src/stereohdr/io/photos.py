"""`read_photo`: whatever a camera wrote becomes a `Photo`."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.demosaicing import BayerPattern, bayer_pattern, demosaic
from stereohdr.errors import FileFormatError, InputError, StereoHdrWarning
from stereohdr.io.images import StoredImage, decode_image
from stereohdr.io.metadata import (
    COLOUR_PROFILE,
    ORIENTATION,
    Exposure,
    camera_from_tags,
    exposure_from_tags,
    image_kind,
    profile_name,
    read_tags,
)
from stereohdr.model import ExposureSource, Photo, ResponseCurve

CONFLICT = 0.1
"""Relative difference between a given exposure and the file's from which on a user wants to know. EXIF rounds
times to the names on the dial: 1/60 stands for 1/64."""


def read_photo(
    source: str | Path | NDArray[Any],
    *,
    exposure_time: float | None = None,
    white_level: int | None = None,
    black_level: int = 0,
    bayer: str | None = None,
    f_number: float | None = None,
    iso: float | None = None,
    name: str | None = None,
) -> Photo:
    """Read a photo: PNG, JPEG, TIFF, HEIC, AVIF, camera raw, or an array.

    The format is recognised by content. The orientation is applied. Palette images become RGB, 1-bit images become
    8-bit grey, and alpha channels are dropped with a notice. Of a TIFF with several pages, and of a multi-picture
    JPEG, the first picture is read. Colour profiles are not applied: the response curve takes their place; a
    notice tells of profiles other than sRGB, whose primaries would differ.

    Camera raw files and DNG (extra ``raw``) become linear RGB codes of the sensor without pedestal; the photo
    brings its response, the white balance as shot, and the matrix from camera colours to BT.709.

    Parameters
    ----------
    source
        A file; or codes ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)``, uint8 or uint16, also as ``.npy`` file.
    exposure_time, f_number, iso
        Seconds, aperture and sensitivity; what is not given is taken from EXIF, if it is there.
    white_level
        Code at which the sensor clips, for example 4095 for 12-bit codes stored in 16 bits. By default the
        largest code of the file's bit depth.
    black_level
        Code without light; it is subtracted, also from the white level.
    bayer
        Pattern of a Bayer mosaic (``RGGB``, ``BGGR``, ``GRBG``, ``GBRG``), which then becomes RGB. TIFF files may
        state it themselves.
    name
        What messages call the photo; the file's name by default.

    Returns
    -------
    `Photo` with codes ``(H, W, C)``, uint8 or uint16, C 1 or 3.

    Raises
    ------
    FileFormatError
        The file cannot be read, is damaged, or holds a kind of image that is not supported (CMYK, floating
        point, a mosaic of unknown pattern, ...).
    InputError
        White or black level do not fit the bit depth or are given for a camera raw file; a pattern is given for a
        colour image.
    ConfigError
        `bayer` is no Bayer pattern.
    ExposureError
        A given exposure time, f-number or ISO is not a positive number.
    MissingDependencyError
        The format needs an extra that is not installed.

    Warns
    -----
    StereoHdrWarning
        Something in the file was left out (alpha, extra channels, further pages, a colour profile), or
        contradicts what is given.
    """
    pattern = None if bayer is None else bayer_pattern(bayer)
    if isinstance(source, np.ndarray):
        label, kind, tags = name or "array", None, {}
    else:
        label, kind, tags = name or str(source), image_kind(source), read_tags(source)
    notices: list[str] = []
    recorded = exposure_from_tags(tags)
    if kind == "RAW":
        if pattern or black_level or white_level is not None:
            raise InputError(
                f"{label}: a camera raw file states its own Bayer pattern, black and white level; leave them out"
            )
        settings, recorded = _raw_settings(str(source), recorded)
    else:
        image = StoredImage(source) if isinstance(source, np.ndarray) else decode_image(source, kind or "PNG")
        settings = _image_settings(image, label, pattern, white_level, black_level)
        settings["codes"] = upright(settings["codes"], tags.get(ORIENTATION))
        notices += image.notices + _profile_notices(tags.get(COLOUR_PROFILE))
    notices += _conflicts(Exposure(exposure_time, f_number, iso), recorded)
    origin: ExposureSource | None = "given" if exposure_time is not None else "file" if recorded.time else None
    photo = Photo(
        **settings,
        exposure_time=recorded.time if exposure_time is None else exposure_time,
        f_number=recorded.f_number if f_number is None else f_number,
        iso=recorded.iso if iso is None else iso,
        name=label,
        camera=camera_from_tags(tags),
        exposure_source=origin,
    )
    for notice in notices:
        warnings.warn(f"{label}: {notice}", StereoHdrWarning, stacklevel=2)
    return photo


def upright(codes: NDArray[Any], orientation: Any) -> NDArray[Any]:
    """Apply the EXIF orientation, 1 to 8; anything else changes nothing."""
    if orientation in (5, 6, 7, 8):
        codes = codes.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        codes = codes[:, ::-1]
    if orientation in (3, 4, 7, 8):
        codes = codes[::-1]
    return codes


def _raw_settings(path: str, recorded: Exposure) -> tuple[dict[str, Any], Exposure]:
    """Return what a camera raw file makes of a `Photo`, and its exposure."""
    from stereohdr.io.raw import read_raw

    raw = read_raw(path)
    channels = raw.codes.shape[2]
    settings = {
        "codes": upright(raw.codes, raw.orientation),
        "white_level": raw.white_level,
        "response": ResponseCurve.linear(channels, white_level=raw.white_level),
        "full_scale": raw.white_level,
        "white_balance": raw.gains,
        "colour_matrix": raw.colour_matrix,
    }
    exposure = Exposure(
        time=recorded.time or raw.exposure.time,
        f_number=recorded.f_number or raw.exposure.f_number,
        iso=recorded.iso or raw.exposure.iso,
    )
    return settings, exposure


def _image_settings(
    image: StoredImage, name: str, pattern: BayerPattern | None, white_level: int | None, black_level: int
) -> dict[str, Any]:
    """Return codes ``(H, W, C)`` without pedestal, demosaiced, and their white level."""
    codes = image.codes
    if codes.dtype.kind == "u":
        codes = codes.astype(codes.dtype.newbyteorder("="), copy=False)
    if codes.dtype not in (np.uint8, np.uint16) or codes.ndim not in (2, 3) or codes.size == 0:
        raise InputError(
            f"{name}: codes must be uint8 or uint16 of shape (H, W), (H, W, 1) or (H, W, 3), got {codes.dtype} "
            f"{codes.shape}; convert the image first"
        )
    if codes.ndim == 2:
        codes = codes[..., None]
    colours = 1 if codes.shape[2] < 3 else 3
    if codes.shape[2] > colours:
        dropped = "its alpha channel was dropped" if codes.shape[2] in (2, 4) else "extra channels dropped"
        image.notices.append(dropped)
        codes = codes[..., :colours]
    white = image.white_level if white_level is None else white_level
    if black_level:
        codes, white = _without_pedestal(codes, black_level, white, name)
    stated = image.bayer
    if pattern is not None and stated is not None and pattern != stated:
        image.notices.append(f"the Bayer pattern {pattern} is given, the file states {stated}; {pattern} is used")
    pattern = pattern or stated
    if image.mosaic and pattern is None:
        raise FileFormatError(
            f"{name}: holds a sensor mosaic of unknown pattern; give it as RGGB, BGGR, GRBG or GBRG (command "
            f"line: --bayer RGGB)"
        )
    if pattern is not None:
        if colours == 3:
            raise InputError(f"{name}: is in colour already; leave the Bayer pattern out, or give the raw mosaic")
        highest = int(np.iinfo(codes.dtype).max)
        clip = highest if white is None else white
        codes = demosaic(np.minimum(codes[..., 0], clip), pattern, white_level=clip, name=name)
    return {"codes": codes, "white_level": white}


def _without_pedestal(
    codes: NDArray[Any], black_level: int, white_level: int | None, name: str
) -> tuple[NDArray[Any], int]:
    highest = int(np.iinfo(codes.dtype).max) if white_level is None else white_level
    if not 0 <= black_level <= highest - 3:
        raise InputError(
            f"{name}: the black level must be 0 to {highest - 3} for a white level of {highest}, got {black_level}"
        )
    return np.maximum(codes, black_level) - codes.dtype.type(black_level), highest - black_level


def _profile_notices(profile: Any) -> list[str]:
    found = profile_name(profile) if isinstance(profile, bytes) else None
    if found is None or "srgb" in found.lower():
        return []
    return [f"its colour profile ({found}) is not applied; its colours are taken as those of sRGB"]


def _conflicts(given: Exposure, recorded: Exposure) -> list[str]:
    """Return a sentence for each exposure setting that is given and contradicts the file."""
    sentences = []
    for label, one, other in (
        ("exposure time", given.time, recorded.time),
        ("f-number", given.f_number, recorded.f_number),
        ("ISO", given.iso, recorded.iso),
    ):
        if one is None or other is None or not isinstance(one, int | float) or not one > 0:
            continue
        if abs(one - other) > CONFLICT * max(one, other):
            unit = " s" if label == "exposure time" else ""
            sentences.append(
                f"the {label} {one:g}{unit} is given, EXIF says {other:g}{unit}; the given one is used"
            )
    return sentences
