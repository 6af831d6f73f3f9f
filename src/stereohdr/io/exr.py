"""OpenEXR, ``.exr``: float or half channels with lossless compression, layers, and named attributes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import FileFormatError, InputError, StereoHdrWarning
from stereohdr.io.files import atomic_path
from stereohdr.io.images import check_size
from stereohdr.io.metadata import first_bytes
from stereohdr.quiet import quiet_stderr, quiet_stdout

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

LARGEST_HALF = 65504.0
"""The largest number that a half float holds; larger ones would become infinite."""

SMALLEST_NORMAL_HALF = 2.0**-14
"""Half floats below have fewer than their 11 bits of precision."""

BT709_CHROMATICITIES = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
"""x and y of red, green, blue and white (BT.709 and D65)."""

_TUPLES = {"chromaticities": 8, "whitePoint": 2, "adoptedNeutral": 2}
"""Standard attributes whose type is a tuple of this many floats, not a list."""


def read_exr(path: str | Path) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Read the data window of an OpenEXR file with channels R, G, B or one channel such as Y, and maybe layers.

    Parameters
    ----------
    path
        The file. Of several parts the first is read; alpha is dropped; both with a notice. Layers, whose
        channels have a dot in their names, are left alone: see `read_exr_layers`.

    Returns
    -------
    image
        ``(H, W, C)`` float32, C 1 or 3; half floats are widened.
    attributes
        What `write_exr` stored, and other programs' attributes: strings, numbers, and tuples of floats, as
        far as they can be represented so. OpenEXR keeps numbers as 32-bit floats. The chromaticities are
        left out where they are those of BT.709.

    Raises
    ------
    FileFormatError
        The file cannot be read, is damaged, or holds other channels or deep data.

    Warns
    -----
    StereoHdrWarning
        Something was left out, or the primaries are not those of BT.709: the numbers are taken as they are.
    """
    notices: list[str] = []
    with _damage_as_sentence(path):
        header, pixels = _read_channels(path, lambda header: _image_channels(path, header, notices), notices)
        image = np.stack([plane.astype(np.float32) for plane in pixels.values()], axis=-1)
        if np.allclose(header.get("chromaticities", ()) or BT709_CHROMATICITIES, BT709_CHROMATICITIES, atol=0.002):
            header.pop("chromaticities", None)  # what every image here has
        elif image.shape[2] == 3:
            notices.append("its primaries are not those of BT.709; its numbers were taken as they are")
    for notice in notices:
        warnings.warn(f"{path}: {notice}", StereoHdrWarning, stacklevel=2)
    attributes = {key: _plain(value) for key, value in header.items() if key not in STRUCTURE}
    return image, {key: value for key, value in attributes.items() if value is not None}


def read_exr_layers(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read the channels of an OpenEXR file whose names have a dot, such as ``disparity.Z``.

    Returns
    -------
    Name to ``(H, W)``: float32 (half floats are widened) or uint32, as stored; empty if there are none.

    Raises
    ------
    FileFormatError
        The file cannot be read or is damaged.
    """
    with _damage_as_sentence(path):
        _, pixels = _read_channels(path, lambda header: _layer_channels(path, header), [])
    return {name: plane.astype(np.float32) if plane.dtype.kind == "f" else plane for name, plane in pixels.items()}


def write_exr(
    path: str | Path,
    radiance: NDArray[np.float32],
    attributes: Mapping[str, Any] | None = None,
    *,
    half: bool = False,
    layers: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write channels R, G, B, or Y for grey, with ZIP compression, whole or not at all.

    The same input gives the same bytes. Colour images get the chromaticities of BT.709 unless `attributes`
    have others.

    Parameters
    ----------
    path
        The file.
    radiance
        ``(H, W, C)`` float32, C 1 or 3.
    attributes
        Names to strings, numbers, or sequences of numbers or of strings. OpenEXR keeps numbers as 32-bit
        floats (integers as 32-bit integers, where they fit).
    half
        Store the image in half floats (16 bits, relative error at most 2^-11 from 6.1e-5 to 65,504) instead of
        32-bit floats. Larger values are stored as 65,504.
    layers
        Further channels, name to ``(H, W)`` float32 or unsigned integers; a name is ``layer.channel``, such as
        ``disparity.Z``. They are stored in 32 bits.

    Raises
    ------
    InputError
        An attribute has another type, or a name that OpenEXR reserves or cannot hold; a layer has another shape
        or type, or a name without a dot.
    OutputError
        The file cannot be written.

    Warns
    -----
    StereoHdrWarning
        Half floats lost values that are too large, or the precision of small ones.
    """
    import OpenEXR

    planes = np.ascontiguousarray(np.moveaxis(np.asarray(radiance, np.float32), -1, 0))
    names = ("Y",) if len(planes) == 1 else ("R", "G", "B")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if len(planes) == 3:
        header["chromaticities"] = BT709_CHROMATICITIES
    header |= _checked_attributes(attributes or {})
    channels = dict(zip(names, _halved(planes, path) if half else planes, strict=True))
    channels |= _checked_layers(layers or {}, planes.shape[1:])
    with atomic_path(path) as temporary:
        try:
            with OpenEXR.File(header, channels) as file:
                file.write(str(temporary))
        except RuntimeError as error:  # what OpenEXR makes of a full disk, for example
            reason = str(error).partition(str(temporary))[2].strip('". ')  # it names the temporary file first
            raise OSError(reason or str(error)) from error


@contextmanager
def _damage_as_sentence(path: str | Path) -> Iterator[None]:
    try:
        with quiet_stderr():
            yield
    except (FileFormatError, MemoryError):
        raise
    except Exception as error:  # OpenEXR raises RuntimeError, ValueError, ... on damaged files
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{path}: damaged OpenEXR file ({reason}); get it again") from error


def _read_channels(
    path: str | Path, choose: Callable[[Mapping[str, Any]], tuple[str, ...]], notices: list[str]
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the header of the first part, and the channels that `choose` names after a look at the header."""
    import OpenEXR

    if first_bytes(path, 4) != MAGIC:
        raise FileFormatError(f"{path}: not an OpenEXR file; get it again, or give it the suffix of its format")
    # The header first: reading the pixels allocates whatever it promises.
    with OpenEXR.File(str(path), header_only=True) as file:
        header = dict(file.parts[0].header)
        if len(file.parts) > 1:
            notices.append(f"only the first of its {len(file.parts)} parts was read")
    names = choose(header)
    # Of parts that it cannot decode it prints a remark instead of raising an error, and leaves them out.
    with quiet_stdout(), OpenEXR.File(str(path), separate_channels=True) as file:
        if not file.parts:
            raise FileFormatError(f"{path}: damaged OpenEXR file (its pixels cannot be decoded); get it again")
        channels = file.parts[0].channels
        return header, {name: np.asarray(channels[name].pixels) for name in names}


def _halved(planes: NDArray[np.float32], path: str | Path) -> NDArray[np.float16]:
    """Return half floats, without infinities, and say what they lose."""
    too_large = np.count_nonzero(planes > LARGEST_HALF) / planes.size
    too_small = np.count_nonzero((planes > 0) & (planes < SMALLEST_NORMAL_HALF)) / planes.size
    for share, bearable, what in (
        (too_large, 0.0, f"are above {LARGEST_HALF:g} and were stored as that"),
        (too_small, 0.01, f"are below {SMALLEST_NORMAL_HALF:.1g} and lost precision"),
    ):
        if share > bearable:
            warnings.warn(
                f"{path}: {100 * share:.3g} % of the values {what} in half floats; 32-bit floats keep them",
                StereoHdrWarning,
                stacklevel=2,
            )
    return np.minimum(planes, LARGEST_HALF).astype(np.float16)


def _checked_layers(layers: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Return `layers` as OpenEXR stores them."""
    stored = {}
    for name, plane in layers.items():
        layer, _, channel = name.rpartition(".")
        if not (layer and channel and name.isascii() and name.isprintable() and len(name) <= LONGEST_NAME):
            raise InputError(f"EXR layer {name!r}: the name must be layer.channel, such as disparity.Z")
        array = np.asarray(plane)
        if array.shape != shape or array.dtype.kind not in "fu":
            raise InputError(
                f"EXR layer {name!r} must be floats or unsigned integers of the image's shape {shape}, got "
                f"{array.dtype} {array.shape}"
            )
        stored[name] = np.ascontiguousarray(array, np.float32 if array.dtype.kind == "f" else np.uint32)
    return stored


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
    channels = _checked_channels(path, header)
    plain = [name for name in channels if "." not in name] or list(channels)
    colours = [name for name in plain if name != "A"]
    if set(colours) == {"R", "G", "B"}:
        names = ("R", "G", "B")
    elif len(colours) == 1:
        names = (colours[0],)
    else:
        found = ", ".join(sorted(channels)) or "none"
        raise FileFormatError(
            f"{path}: expected the channels R, G, B or a single one, found {found}; save one layer as RGB"
        )
    if "A" in channels:
        notices.append("its alpha channel was dropped")
    return names


def _layer_channels(path: str | Path, header: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(name for name in _checked_channels(path, header) if "." in name)


def _checked_channels(path: str | Path, header: Mapping[str, Any]) -> dict[str, Any]:
    """Return the channels by name; refuse what cannot be read, or is larger than the file can hold."""
    if "deep" in str(header.get("type")):
        raise FileFormatError(f"{path}: deep OpenEXR files are not supported; flatten it first")
    channels = {channel.name: channel for channel in header["channels"]}
    if any((channel.xSampling, channel.ySampling) != (1, 1) for channel in channels.values()):
        raise FileFormatError(f"{path}: subsampled channels are not supported; save it as plain RGB")
    (left, top), (right, bottom) = header["dataWindow"]
    height, width = int(bottom) - int(top) + 1, int(right) - int(left) + 1
    check_size(path, height, width, 4 * len(channels), Path(path).stat().st_size)
    if "tiles" in header:  # whole tiles are allocated, too
        tiles = header["tiles"]
        check_size(path, tiles.ySize, tiles.xSize, 4 * len(channels), Path(path).stat().st_size)
    return channels


def _plain(value: Any) -> str | int | float | tuple[Any, ...] | None:
    """Return an attribute in Python's own types, None for matrices, previews and the like."""
    if isinstance(value, str | int | float):
        return value
    if isinstance(value, list | tuple | np.ndarray) and all(
        isinstance(item, str | int | float | np.number) for item in value
    ):
        return tuple(item.item() if isinstance(item, np.number) else item for item in value)
    return None
