"""Camera raw files and DNG: LibRaw decodes the sensor's codes, everything after that is ours.

LibRaw could develop the picture as well, but its colour matrix mixes clipped samples into the other channels,
where nobody can tell them any more, and each photo would get a white balance of its own. Here the codes stay the
sensor's; a pair is balanced together, and colours are converted on linear radiance (`stereohdr.camera_colour`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.demosaicing import bayer_pattern, demosaic
from stereohdr.errors import ConfigError, FileFormatError, MissingDependencyError
from stereohdr.io.metadata import Exposure, positive_number
from stereohdr.quiet import quiet_stderr

PILE_UP_SHARE = 1e-4
"""So many of all samples at the highest code, and `PILE_UP_FACTOR` times more than at the codes below it, are no
chance: the sensor clips there, whatever white level the file states."""

PILE_UP_FACTOR = 20.0
"""See `PILE_UP_SHARE`."""

PILE_UP_LEVEL = 0.75
"""No sensor clips below this share of its stated white level (LibRaw's own threshold)."""

PILE_UP_CODES = 32
"""Codes below the highest one that it is compared with."""

INTERPOLATION_REACH = 3
"""Pixels around a clipped sample that count as clipped, too, where LibRaw interpolates (X-Trans)."""

LINEAR_SRGB_FROM_XYZ = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
"""XYZ (D65) to linear BT.709, which has the primaries of sRGB (IEC 61966-2-1)."""

_FLIP_AS_ORIENTATION = {3: 3, 5: 8, 6: 6}
"""LibRaw's flip codes as EXIF orientations."""


@dataclass(frozen=True, eq=False)
class RawImage:
    """What a camera raw file holds, ready to become a photo."""

    codes: NDArray[np.uint16]
    """``(H, W, C)``, linear, without pedestal, one white level for all channels, not upright yet; C is 3 or 1."""
    white_level: int
    """Code at which the first of the channels clips."""
    gains: tuple[float, ...]
    """White balance as shot, one factor per channel, 1 for green."""
    colour_matrix: NDArray[np.float64] | None
    """``(3, 3)`` from white-balanced linear camera RGB to linear BT.709, None when unknown."""
    exposure: Exposure
    """As LibRaw found it."""
    orientation: int
    """EXIF orientation."""


def read_raw(path: str | Path) -> RawImage:
    """Decode a camera raw or DNG file.

    Bayer mosaics are interpolated by `stereohdr.demosaicing.demosaic`, which keeps clipping recognisable. Other
    mosaics (X-Trans) are interpolated by LibRaw, and everything within `INTERPOLATION_REACH` pixels of a clipped
    sample of the same colour counts as clipped. Linear DNG and monochrome sensors are taken as they are.

    Raises
    ------
    MissingDependencyError
        rawpy is not installed.
    FileFormatError
        LibRaw cannot decode the file, or the sensor's colours are not red, green and blue.
    """
    rawpy = _rawpy()
    try:
        with quiet_stderr(), rawpy.imread(str(path)) as raw:
            return _decoded(raw, rawpy, str(path))
    except (FileFormatError, MemoryError):
        raise
    except Exception as error:  # LibRaw's own family, and whatever its wrapper stumbles over
        reason = error.args[0] if error.args else type(error).__name__
        text = reason.decode("utf-8", "replace") if isinstance(reason, bytes) else str(reason)
        raise FileFormatError(
            f"{path}: damaged or unsupported camera raw file ({' '.join(text.split())}); copy it from the camera "
            f"again, or convert it to DNG"
        ) from error


def clip_level(codes: NDArray[np.integer[Any]], white_level: int) -> int:
    """Return the code at which a sensor really clips: the highest one that occurs, if samples pile up there.

    Parameters
    ----------
    codes
        Any shape.
    white_level
        What the file or the user states; returned when nothing speaks against it.
    """
    highest = int(codes.max())
    if not max(PILE_UP_CODES, PILE_UP_LEVEL * white_level) < highest < white_level:
        return white_level
    counts = np.bincount(codes[codes >= highest - PILE_UP_CODES] - (highest - PILE_UP_CODES))
    below = counts[:-1].mean()
    piled_up = counts[-1] > PILE_UP_SHARE * codes.size and counts[-1] > PILE_UP_FACTOR * below
    return highest if piled_up else white_level


def _rawpy() -> ModuleType:
    try:
        import rawpy
    except ImportError as error:
        raise MissingDependencyError(
            "camera raw files need rawpy; install stereohdr[raw], or convert the photos to 16-bit TIFF"
        ) from error
    return rawpy


def _decoded(raw: Any, rawpy: ModuleType, name: str) -> RawImage:
    mosaic: NDArray[Any] = raw.raw_image_visible
    black = np.array(raw.black_level_per_channel, dtype=np.int32)
    limits = [level for level in raw.camera_white_level_per_channel or () if level > 0]
    # Above the limits the sensor is not linear any more; most files state none.
    stated = min([int(raw.white_level), *limits])
    if raw.raw_type == rawpy.RawType.Stack:
        samples = mosaic[..., :3]
        codes, white = _without_pedestal(samples, black[:3], clip_level(samples, stated), name)
    elif raw.num_colors == 1:
        codes, white = _without_pedestal(mosaic, black[:1], clip_level(mosaic, stated), name)
        codes = codes[..., None]
    else:
        colours = raw.raw_colors_visible
        pattern = _pattern(raw, colours, name)
        samples, white = _without_pedestal(mosaic, black[colours], clip_level(mosaic, stated), name)
        if pattern is None:
            codes, white = _interpolated_by_libraw(raw, rawpy, samples >= white, colours)
        else:
            codes = demosaic(samples, bayer_pattern(pattern), white_level=white, name=name)
    return RawImage(
        codes=codes,
        white_level=white,
        gains=_gains(raw) if codes.shape[2] == 3 else (1.0,),
        colour_matrix=_colour_matrix(raw) if codes.shape[2] == 3 else None,
        exposure=_exposure(raw),
        orientation=_FLIP_AS_ORIENTATION.get(raw.sizes.flip, 1),
    )


def _pattern(raw: Any, colours: NDArray[np.uint8], name: str) -> str | None:
    """Return the Bayer pattern, None for another arrangement of red, green and blue."""
    letters = raw.color_desc.decode("ascii", "replace")
    if raw.num_colors != 3 or set(letters) != set("RGB"):
        raise FileFormatError(
            f"{name}: the sensor's colours are {letters}, not red, green and blue; develop the file to a 16-bit "
            f"TIFF"
        )
    cell = "".join(letters[colours[y, x]] for y in range(2) for x in range(2))
    try:
        bayer_pattern(cell)
    except ConfigError:
        return None
    period = np.array_equal(colours[:2, :6], np.tile(colours[:2, :2], (1, 3)))
    return cell if period and raw.raw_pattern.shape == (2, 2) else None


def _without_pedestal(
    samples: NDArray[Any], black: NDArray[np.int32], white: int, name: str
) -> tuple[NDArray[np.uint16], int]:
    """Return codes from 0 to the white level that all colours reach."""
    white_level = int(white - np.max(black))
    if white_level < 3:
        raise FileFormatError(
            f"{name}: damaged camera raw file: its white level {white} is not above its black level "
            f"{int(np.max(black))}; copy it from the camera again"
        )
    codes = np.clip(samples.astype(np.int32) - black, 0, white_level).astype(np.uint16)
    codes[samples >= white] = white_level
    return codes, white_level


def _interpolated_by_libraw(
    raw: Any, rawpy: ModuleType, clipped: NDArray[np.bool_], colours: NDArray[np.uint8]
) -> tuple[NDArray[np.uint16], int]:
    """Return ``(H, W, 3)`` codes of a mosaic that is not Bayer, and their white level."""
    from scipy import ndimage

    rgb = raw.postprocess(
        gamma=(1, 1),
        no_auto_bright=True,
        adjust_maximum_thr=0.0,
        user_wb=[1.0, 1.0, 1.0, 1.0],
        output_color=rawpy.ColorSpace.raw,
        output_bps=16,
        user_flip=0,
    )
    highest = 65535
    rgb = np.minimum(rgb, highest - 1)
    side = 2 * INTERPOLATION_REACH + 1
    for channel in range(3):
        near_clipped = ndimage.maximum_filter(clipped & (colours == channel), side)
        rgb[..., channel][near_clipped] = highest
    return rgb, highest


def _gains(raw: Any) -> tuple[float, ...]:
    """Return the white balance as shot, else that of daylight, else none."""
    for stated in (raw.camera_whitebalance, raw.daylight_whitebalance):
        gains = np.array(stated[:3], dtype=np.float64)
        if np.isfinite(gains).all() and (gains > 0).all():
            return tuple((gains / gains[1]).tolist())
    return (1.0, 1.0, 1.0)


def _colour_matrix(raw: Any) -> NDArray[np.float64] | None:
    """Return the matrix from white-balanced camera RGB to BT.709; its rows add up to 1: grey stays grey."""
    matrix = np.array(raw.color_matrix[:3, :3], dtype=np.float64)
    if not matrix.any():  # the file states none: LibRaw's table of cameras, which goes from XYZ to camera RGB
        camera_from_xyz = np.array(raw.rgb_xyz_matrix[:3], dtype=np.float64)
        with suppress(np.linalg.LinAlgError):
            camera_from_srgb = camera_from_xyz @ np.linalg.inv(LINEAR_SRGB_FROM_XYZ)
            camera_from_srgb /= camera_from_srgb.sum(axis=1, keepdims=True)
            matrix = np.linalg.inv(camera_from_srgb)
    usable = np.isfinite(matrix).all() and np.allclose(matrix.sum(axis=1), 1, atol=0.01)
    return matrix if usable else None


def _exposure(raw: Any) -> Exposure:
    try:
        other = raw.other
    except (AttributeError, ValueError, OverflowError, OSError):  # an older rawpy, or an impossible time stamp
        return Exposure()
    return Exposure(
        positive_number(other.shutter_speed), positive_number(other.aperture), positive_number(other.iso_speed)
    )
