"""OpenEXR, ``.exr``: 32-bit float channels with lossless compression and named attributes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import FileFormatError, InputError, StereoHdrWarning
from stereohdr.io.files import atomic_path
from stereohdr.io.images import check_size
from stereohdr.io.metadata import first_bytes

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAGIC = b"v/1\x01"

LONGEST_NAME = 255
"""Bytes in an attribute's name; OpenEXR drops longer ones without a word."""

STRUCTURE = frozenset(
    {
        "channels",
        "chunkCount",
        "compression",
        "dataWindow",
        "displayWindow",
        "lineOrder",
        "maxSamplesPerPixel",
        "name",
        "pixelAspectRatio",
        "screenWindowCenter",
        "screenWindowWidth",
        "tiles",
        "type",
        "version",
        "view",
    }
)
"""Attributes that describe the file itself: never given to `write_exr`, never returned by `read_exr`."""

_TUPLES = {"chromaticities": 8, "whitePoint": 2, "adoptedNeutral": 2}
"""Standard attributes whose type is a tuple of this many floats, not a list."""


def read_exr(path: str | Path) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Read the data window of an OpenEXR file with channels R, G, B or one channel such as Y.

    Parameters
    ----------
    path
        The file. Of several parts the first is read; alpha is dropped; both with a notice.

    Returns
    -------
    image
        ``(H, W, C)`` float32, C 1 or 3; half floats are widened.
    attributes
        What `write_exr` stored, and other programs' attributes: strings, numbers, and tuples of floats, as
        far as they can be represented so. OpenEXR keeps numbers as 32-bit floats.

    Raises
    ------
    FileFormatError
        The file cannot be read, is damaged, or holds other channels, layers or deep data.
    """
    import OpenEXR

    if first_bytes(path, 4) != MAGIC:
        raise FileFormatError(f"{path}: not an OpenEXR file; get it again, or give it the suffix of its format")
    notices: list[str] = []
    try:
        # The header first: reading the pixels allocates whatever it promises.
        with OpenEXR.File(str(path), header_only=True) as file:
            header = dict(file.parts[0].header)
            if len(file.parts) > 1:
                notices.append(f"only the first of its {len(file.parts)} parts was read")
        names = _image_channels(path, header, notices)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.parts[0].channels
            image = np.stack([np.asarray(channels[name].pixels, np.float32) for name in names], axis=-1)
    except FileFormatError:
        raise
    except Exception as error:  # OpenEXR raises RuntimeError, ValueError, ... on damaged files
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{path}: damaged OpenEXR file ({reason}); get it again") from error
    for notice in notices:
        warnings.warn(f"{path}: {notice}", StereoHdrWarning, stacklevel=2)
    attributes = {key: _plain(value) for key, value in header.items() if key not in STRUCTURE}
    return image, {key: value for key, value in attributes.items() if value is not None}


def write_exr(
    path: str | Path, radiance: NDArray[np.float32], attributes: Mapping[str, Any] | None = None
) -> None:
    """Write 32-bit float channels R, G, B, or Y for grey, with ZIP compression, whole or not at all.

    The same input gives the same bytes.

    Parameters
    ----------
    path
        The file.
    radiance
        ``(H, W, C)`` float32, C 1 or 3.
    attributes
        Names to strings, numbers, or sequences of numbers or of strings. OpenEXR keeps numbers as 32-bit
        floats (integers as 32-bit integers, where they fit).

    Raises
    ------
    InputError
        An attribute has another type, or a name that OpenEXR reserves or cannot hold.
    FileFormatError
        The file cannot be written.
    """
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= _checked_attributes(attributes or {})
    planes = np.ascontiguousarray(np.moveaxis(np.asarray(radiance, np.float32), -1, 0))
    names = ("Y",) if len(planes) == 1 else ("R", "G", "B")
    with atomic_path(path) as temporary:
        try:
            with OpenEXR.File(header, dict(zip(names, planes, strict=True))) as file:
                file.write(str(temporary))
        except RuntimeError as error:  # what OpenEXR makes of a full disk, for example
            raise OSError(f"OpenEXR: {error}") from error


def _checked_attributes(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return `attributes` with values as OpenEXR stores them."""
    stored: dict[str, Any] = {}
    for name, value in attributes.items():
        if not name.isprintable() or not 0 < len(name.encode()) <= LONGEST_NAME or name in STRUCTURE:
            raise InputError(f"EXR attribute {name!r}: the name is reserved, empty, or too long; choose another")
        stored[name] = _storable(name, value)
    return stored


def _storable(name: str, value: Any) -> Any:
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()  # a lone surrogate is not storable
    if isinstance(value, bool | int | np.integer | np.bool_):
        return int(value) if -(2**31) <= value < 2**31 else str(value)
    if isinstance(value, float | np.floating):
        return float(value)
    if isinstance(value, Sequence | np.ndarray) and len(value) > 0:
        items = list(value)
        if all(isinstance(item, str) for item in items):
            return items
        if all(isinstance(item, int | float | np.number) for item in items):
            numbers = [float(item) for item in items]
            # A list, because the binding knows tuples of certain lengths only and turns those into vectors.
            return tuple(numbers) if _TUPLES.get(name) == len(numbers) else numbers
    raise InputError(
        f"EXR attribute {name!r} must be a string, a number, or a sequence of numbers or of strings, got {value!r}"
    )


def _image_channels(path: str | Path, header: Mapping[str, Any], notices: list[str]) -> tuple[str, ...]:
    """Return the names of the channels that make up the image, and check that they can be read."""
    if "deep" in str(header.get("type")):
        raise FileFormatError(f"{path}: deep OpenEXR files are not supported; flatten it first")
    channels = {channel.name: channel for channel in header["channels"]}
    colours = [name for name in channels if name != "A"]
    if set(colours) == {"R", "G", "B"}:
        names = ("R", "G", "B")
    elif len(colours) == 1:
        names = (colours[0],)
    else:
        found = ", ".join(sorted(channels)) or "none"
        raise FileFormatError(
            f"{path}: expected the channels R, G, B or a single one, found {found}; save one layer as RGB"
        )
    if any((channels[name].xSampling, channels[name].ySampling) != (1, 1) for name in names):
        raise FileFormatError(f"{path}: subsampled channels are not supported; save it as plain RGB")
    if "A" in channels:
        notices.append("its alpha channel was dropped")
    (left, top), (right, bottom) = header["dataWindow"]
    height, width = int(bottom) - int(top) + 1, int(right) - int(left) + 1
    check_size(path, height, width, 4 * len(channels), Path(path).stat().st_size)
    if "tiles" in header:  # whole tiles are allocated, too
        tiles = header["tiles"]
        check_size(path, tiles.ySize, tiles.xSize, 4 * len(channels), Path(path).stat().st_size)
    return names


def _plain(value: Any) -> str | int | float | tuple[Any, ...] | None:
    """Return an attribute in Python's own types, None for matrices, previews and the like."""
    if isinstance(value, str | int | float):
        return value
    if isinstance(value, list | tuple | np.ndarray) and all(
        isinstance(item, str | int | float | np.number) for item in value
    ):
        return tuple(item.item() if isinstance(item, np.number) else item for item in value)
    return None
