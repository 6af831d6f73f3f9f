"""Reading and writing HDR images; the suffix of the name says the format. `FORMATS` lists them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import ConfigError, FileFormatError, InputError, MissingDependencyError
from stereohdr.io.avif import decode_avif, encode_avif
from stereohdr.io.exr import read_exr, write_exr
from stereohdr.io.files import atomic_path, check_output
from stereohdr.io.jpeg_xl import decode_jpeg_xl, encode_jpeg_xl
from stereohdr.io.metadata import first_bytes
from stereohdr.io.pfm import decode_pfm, encode_pfm
from stereohdr.io.radiance_hdr import decode_radiance_hdr, encode_radiance_hdr
from stereohdr.io.tiff import encode_tiff, read_tiff
from stereohdr.io.ultra_hdr import decode_ultra_hdr, encode_ultra_hdr

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stereohdr.tone_mapping import Operator

    Image = NDArray[np.float32]


@dataclass(frozen=True)
class HdrFormat:
    """A file format for HDR images."""

    name: str
    """What people call it."""
    write: Callable[..., None]
    """``write(path, image, attributes, **options)``; whole or not at all."""
    read: Callable[[Path], tuple[Image, dict[str, Any]]]
    """Return image and attributes."""
    options: frozenset[str] = frozenset()
    """The options of `write_hdr` that it takes."""
    codec: str = ""
    """What imagecodecs must have been built with."""


def read_hdr(path: str | Path) -> Image:
    """Read an HDR image in any of `FORMATS`; the suffix of the name says which.

    Files that `write_hdr` scaled for display (Ultra HDR, AVIF, JPEG XL) come back in their original unit, Ultra
    HDR and AVIF files of other programs relative to diffuse white.

    Parameters
    ----------
    path
        Ends in one of `HDR_SUFFIXES`.

    Returns
    -------
    ``(H, W, C)`` float32, C 1 or 3. Radiance pictures and Ultra HDR always have three channels.

    Raises
    ------
    FileFormatError
        Unknown suffix; the file cannot be read, is damaged, has another shape, or holds NaN or infinity.
    """
    return read_hdr_with_attributes(path)[0]


def read_hdr_with_attributes(path: str | Path) -> tuple[Image, dict[str, Any]]:
    """Read an HDR image like `read_hdr`, and what the file says about it, ready for `write_hdr`."""
    suffix = _suffix(path)
    first_bytes(path, 1)  # a missing file or a folder gets its own sentence
    _check_codec(suffix)
    image, attributes = FORMATS[suffix].read(Path(path))
    wrong = _first_and_count(~np.isfinite(image))
    if wrong:
        raise FileFormatError(f"{path}: holds {wrong} that are NaN or infinite; repair the file first")
    return image, attributes


def write_hdr(
    path: str | Path,
    radiance: NDArray[Any],
    *,
    attributes: Mapping[str, Any] | None = None,
    layers: Mapping[str, NDArray[Any]] | None = None,
    half: bool | None = None,
    white: float | None = None,
    headroom: float | None = None,
    operator: Operator | None = None,
    quality: int | None = None,
    bits: int | None = None,
) -> None:
    """Write an HDR image in any of `FORMATS`, whole or not at all; the suffix of the name says which.

    OpenEXR, TIFF, PFM and NumPy keep every bit, JPEG XL seven digits; Radiance keeps 8 bits per channel. Ultra HDR
    and AVIF are pictures for displays: lossy, and bright pixels that they cannot hold are darkened, with a notice.
    docs/formats.md says more. The same input gives the same bytes.

    Parameters
    ----------
    path
        Ends in one of `HDR_SUFFIXES`.
    radiance
        ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)``, finite, >= 0; stored as float32. RGB with BT.709 primaries.
    attributes
        Names to strings, numbers or sequences of them. OpenEXR keeps them (see `write_exr`); TIFF, Ultra HDR, AVIF
        and JPEG XL hold them as JSON, Radiance as comment lines; PFM and NumPy cannot.
    layers
        OpenEXR: further channels, see `write_exr`.
    half
        OpenEXR and JPEG XL: half floats instead of 32-bit floats.
    white
        Ultra HDR, AVIF and JPEG XL: the radiance that is shown as diffuse white (203 cd/m², BT.2408). By default
        such that the log-average of the luminance is 18 % of it. Kept in the file, so that `read_hdr` undoes it.
    headroom
        Ultra HDR: stops above diffuse white that are kept, 4 by default.
    operator
        Ultra HDR: tone mapping of the picture for ordinary displays, ``"reinhard"`` by default.
    quality
        Ultra HDR and AVIF, 1 to 100, by default 95; JPEG XL, by default 100. AVIF and JPEG XL are lossless at 100.
    bits
        AVIF: 10 (default) or 12.

    Raises
    ------
    InputError
        Wrong shape or type, a value that is negative or not finite in float32, an option that the format does not
        take or that is out of range, or attributes or layers that it cannot hold; nothing was written.
    FileFormatError
        Unknown suffix, or no name for a file.
    OutputError
        The file cannot be written.
    """
    given = {
        "layers": layers or None,
        "half": half or None,
        "white": white,
        "headroom": headroom,
        "operator": operator,
        "quality": quality,
        "bits": bits,
    }
    options = {name: value for name, value in given.items() if value is not None}
    suffix = check_hdr_path(path, *options)
    FORMATS[suffix].write(path, _checked(path, radiance), attributes, **options)


def check_hdr_path(path: str | Path, *options: str) -> str:
    """Return the suffix, in lower case, of a name that `write_hdr` can write to with these options.

    Called before anything is computed, so that a typing error does not cost a result.

    Raises
    ------
    FileFormatError
        The suffix is unknown, or `path` is no name for a file, see `check_output`.
    ConfigError
        The format does not take one of the options.
    OutputError
        The folder cannot be written to.
    MissingDependencyError
        imagecodecs was built without the format.
    """
    suffix = _suffix(path)
    for option in options:
        if option not in FORMATS[suffix].options:
            takers = [other for other, file_format in FORMATS.items() if option in file_format.options]
            raise ConfigError(
                f"{path}: {FORMATS[suffix].name} files have no option {option!r}; leave it out, or write "
                f"{' or '.join(takers)}"
            )
    check_output(path)
    _check_codec(suffix)
    return suffix


def _check_codec(suffix: str) -> None:
    codec = FORMATS[suffix].codec
    if codec:
        import imagecodecs

        if not getattr(imagecodecs, codec).available:
            raise MissingDependencyError(
                f"this build of imagecodecs has no {FORMATS[suffix].name}; install a wheel of PyPI, or use .exr"
            )


def _suffix(path: str | Path) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise FileFormatError(f"{path}: {suffix or 'no suffix'} is not an HDR format; use {', '.join(FORMATS)}")
    return suffix


def _checked(path: str | Path, radiance: NDArray[Any]) -> NDArray[np.float32]:
    given = np.asarray(radiance)
    if given.dtype.kind not in "fiu" or not _is_image_shape(given.shape):
        raise InputError(
            f"{path}: radiance must be real numbers of shape (H, W), (H, W, 1) or (H, W, 3), got {given.dtype} "
            f"{given.shape}"
        )
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite and is reported as such
        image = given.astype(np.float32, copy=False)
    image = image if image.ndim == 3 else image[..., None]
    wrong = _first_and_count(~(np.isfinite(image) & (image >= 0)))
    if wrong:
        raise InputError(f"{path}: not written: {wrong} that are NaN, infinite in float32, or negative")
    return image


def _read_npy(path: str | Path) -> NDArray[np.float32]:
    try:
        # Mapped, because np.load would otherwise allocate whatever the header promises.
        mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a damaged header raises nearly anything, even SyntaxError
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{path}: not a readable NumPy file ({reason}); get it again") from error
    if not isinstance(mapped, np.ndarray) or mapped.dtype.kind not in "fiu" or not _is_image_shape(mapped.shape):
        found = f"{mapped.dtype} {mapped.shape}" if isinstance(mapped, np.ndarray) else "an archive"
        raise FileFormatError(
            f"{path}: expected numbers of shape (H, W), (H, W, 1) or (H, W, 3), found {found}; save it so"
        )
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and `read_hdr` refuses it
        image = np.array(mapped, dtype=np.float32, order="C")
    return image if image.ndim == 3 else image[..., None]


def _is_image_shape(shape: tuple[int, ...]) -> bool:
    return 0 not in shape and (len(shape) == 2 or (len(shape) == 3 and shape[2] in (1, 3)))


def _first_and_count(wrong: NDArray[np.bool_]) -> str:
    """Return ``"n of m values (first at row y, column x, channel c)"``, empty when nothing is wrong."""
    count = int(np.count_nonzero(wrong))
    if count == 0:
        return ""
    y, x, channel = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
    return f"{count} of {wrong.size} values (first at row {y}, column {x}, channel {channel})"


# --- the formats ------------------------------------------------------------------------------------------------


def _writer(encode: Callable[..., bytes]) -> Callable[..., None]:
    """Return the function that writes what ``encode(image, attributes, **options)`` returns."""

    def write(path: Path, image: Image, attributes: Mapping[str, Any] | None, **options: Any) -> None:
        content = encode(image, attributes, **options)
        with atomic_path(path) as temporary:
            temporary.write_bytes(content)

    return write


def _named_writer(encode: Callable[..., bytes]) -> Callable[..., None]:
    """Return the same for encoders that want to know the name of the file for their messages."""

    def write(path: Path, image: Image, attributes: Mapping[str, Any] | None, **options: Any) -> None:
        _writer(encode)(path, image, attributes, **options, name=str(path))

    return write


def _reader(decode: Callable[[bytes, str], tuple[Image, dict[str, Any]]]) -> Callable[[Path], Any]:
    """Return the function that reads a file with ``decode(data, name)``."""
    return lambda path: decode(path.read_bytes(), str(path))


def _encode_npy(image: Image, attributes: Mapping[str, Any] | None) -> bytes:
    file = BytesIO()  # given a name, np.save would add another suffix to .NPY
    np.save(file, image, allow_pickle=False)
    return file.getvalue()


_TIFF = HdrFormat("TIFF", _writer(encode_tiff), read_tiff)
_ULTRA_HDR = HdrFormat(
    "Ultra HDR",
    _named_writer(encode_ultra_hdr),
    _reader(decode_ultra_hdr),
    frozenset({"white", "headroom", "operator", "quality"}),
)

FORMATS: Mapping[str, HdrFormat] = {
    ".exr": HdrFormat("OpenEXR", write_exr, read_exr, frozenset({"half", "layers"})),
    ".hdr": HdrFormat(
        "Radiance",
        _writer(encode_radiance_hdr),
        _reader(lambda data, name: (decode_radiance_hdr(data, name), {})),
    ),
    ".pfm": HdrFormat(
        "PFM",
        _writer(lambda image, attributes: encode_pfm(image)),
        _reader(lambda data, name: (decode_pfm(data, name), {})),
    ),
    ".npy": HdrFormat("NumPy", _writer(_encode_npy), lambda path: (_read_npy(path), {})),
    ".tif": _TIFF,
    ".tiff": _TIFF,
    ".jpg": _ULTRA_HDR,
    ".jpeg": _ULTRA_HDR,
    ".avif": HdrFormat(
        "AVIF", _named_writer(encode_avif), _reader(decode_avif), frozenset({"white", "quality", "bits"}), "AVIF"
    ),
    ".jxl": HdrFormat(
        "JPEG XL",
        _named_writer(encode_jpeg_xl),
        _reader(decode_jpeg_xl),
        frozenset({"white", "half", "quality"}),
        "JPEGXL",
    ),
}
"""What each suffix writes and reads."""

HDR_SUFFIXES = tuple(FORMATS)
"""Suffixes of the formats that can be read and written."""
