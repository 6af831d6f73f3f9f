"""Decoding images of 8 to 16 bits with every bit that the file holds, and writing 8-bit PNG."""

from __future__ import annotations

import math
import struct
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.demosaicing import BayerPattern, bayer_pattern
from stereohdr.errors import ConfigError, FileFormatError, InputError, StereoHdrError
from stereohdr.io.files import atomic_path
from stereohdr.io.heif import read_avif, read_heif
from stereohdr.io.metadata import ImageKind, first_bytes

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_PIXELS = 178_956_970
"""Images of more pixels are refused; this is where Pillow, too, suspects a decompression bomb."""

LARGEST_COMPRESSION = 100_000
"""No format packs pixels tighter than this, in bytes of pixels per byte of file; a header that promises more
is lying, and memory is not spent on it."""

CFA_REPEAT, CFA_PATTERN = 33421, 33422
"""TIFF tags of a colour filter mosaic: size of the cell, and its colours (0 red, 1 green, 2 blue) row by row."""


@dataclass
class StoredImage:
    """An image as its file stores it."""

    codes: NDArray[Any]
    """``(H, W)`` or ``(H, W, S)``; not upright yet."""
    white_level: int | None = None
    """Code of white, where the file states its bit depth."""
    mosaic: bool = False
    """Whether the file calls it a colour filter mosaic."""
    bayer: BayerPattern | None = None
    """Its pattern, where the file states one that is red, green and blue in 2x2."""
    notices: list[str] = field(default_factory=list)
    """What was left out of the file."""


def decode_image(path: str | Path, kind: ImageKind) -> StoredImage:
    """Decode a photo of 8 to 16 bits; `kind` is what `stereohdr.io.metadata.image_kind` says, but not camera raw.

    Raises
    ------
    FileFormatError
        The file is damaged, or holds a kind of image that is not supported (CMYK, floating point, ...).
    MissingDependencyError
        A HEIC file, and pillow-heif is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of "bombs" at 90 Mpx, which cameras do reach
            if kind == "TIFF":
                return _read_tiff(path)
            if kind == "HEIF":
                return StoredImage(*read_heif(path))
            if kind == "AVIF":
                return StoredImage(*read_avif(path))
            if kind == "NPY":
                return StoredImage(np.load(path, allow_pickle=False))
            if kind == "PNG" and _png_bit_depth(path) == 16:
                return StoredImage(_read_deep_png(path))
            return StoredImage(_read_with_pillow(path, kind))
    except StereoHdrError:
        raise
    except Exception as error:  # several decoders, each with its own kinds of errors
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(
            f"{path}: damaged or unsupported {kind} file ({reason}); save it again as 8- or 16-bit PNG or TIFF"
        ) from error


def write_png(path: str | Path, array: NDArray[np.uint8]) -> None:
    """Write an 8-bit PNG, whole or not at all.

    Parameters
    ----------
    path
        Ends in ``.png``.
    array
        ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)``, uint8.

    Raises
    ------
    InputError
        Wrong dtype or shape.
    FileFormatError
        Another suffix, or the file cannot be written.
    """
    from PIL import Image

    array = np.asarray(array)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[..., 0]
    is_image = array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)
    if array.dtype != np.uint8 or not is_image or array.size == 0:
        raise InputError(
            f"{path}: a PNG takes uint8 of shape (H, W) or (H, W, 3), got {array.dtype} {array.shape}"
        )
    if Path(path).suffix.lower() != ".png":
        raise FileFormatError(f"{path}: this image is written as PNG; give a name that ends in .png")
    with atomic_path(path) as temporary:
        Image.fromarray(np.ascontiguousarray(array)).save(temporary, format="PNG")


def check_size(name: str | Path, height: int, width: int, bytes_per_pixel: float, file_length: int) -> None:
    """Refuse an image that is absurdly large, or larger than a file of `file_length` bytes can possibly hold.

    Decoders allocate what the header promises; this is called before them.

    Raises
    ------
    FileFormatError
        The image is empty, has more than `LARGEST_PIXELS`, or more than fits into the file.
    """
    if height < 1 or width < 1:
        raise FileFormatError(f"{name}: damaged file: the image is {width}x{height} pixels; get it again")
    if height * width > LARGEST_PIXELS:
        raise FileFormatError(
            f"{name}: the image is {width}x{height} pixels, more than the {LARGEST_PIXELS // 10**6} million "
            f"that are accepted; crop or scale it, or replace the file if it is not that large"
        )
    if height * width * bytes_per_pixel > LARGEST_COMPRESSION * file_length:
        raise FileFormatError(
            f"{name}: damaged file: it claims {width}x{height} pixels in {file_length} bytes; get it again"
        )


def _png_bit_depth(path: str | Path) -> int:
    """Return bits per sample of a PNG, and check its size (the IHDR chunk is always the first)."""
    head = first_bytes(path, 26)
    if len(head) < 26 or head[12:16] != b"IHDR":
        raise FileFormatError(f"{path}: damaged PNG file: it has no header; get it again")
    width, height, bit_depth, colour_type = struct.unpack(">IIBB", head[16:26])
    samples = {0: 1, 3: 1, 4: 2, 6: 4}.get(colour_type, 3)
    check_size(path, height, width, samples * bit_depth / 8, Path(path).stat().st_size)
    return bit_depth


def _read_deep_png(path: str | Path) -> NDArray[Any]:
    """Decode a 16-bit PNG; Pillow would silently reduce its colours to 8 bits."""
    import imagecodecs

    return imagecodecs.png_decode(Path(path).read_bytes())


def _read_with_pillow(path: str | Path, kind: str) -> NDArray[Any]:
    """Decode a PNG of up to 8 bits, or a JPEG."""
    from PIL import Image

    with Image.open(path, formats=("JPEG", "MPO") if kind == "JPEG" else ("PNG",)) as image:
        check_size(path, image.height, image.width, len(image.getbands()), Path(path).stat().st_size)
        if image.mode == "P":
            image = image.convert("RGB")
        elif image.mode == "1":
            image = image.convert("L")
        if image.mode not in ("L", "LA", "RGB", "RGBA"):
            raise FileFormatError(
                f"{path}: {image.mode} images are not supported; convert it to RGB or grey first"
            )
        return np.asarray(image)


def _read_tiff(path: str | Path) -> StoredImage:
    """Decode the first page of a TIFF."""
    import tifffile

    notices: list[str] = []
    with tifffile.TiffFile(path) as file:
        page: Any = file.pages.first
        if page.is_reduced:
            raise FileFormatError(f"{path}: the first picture is a preview; save the full picture as TIFF")
        if page.axes not in ("YX", "YXS", "SYX"):
            raise FileFormatError(f"{path}: a TIFF of shape {page.shape} is not a photo; save it as 2-D image")
        kind = tifffile.PHOTOMETRIC(page.photometric)
        mosaic = kind == tifffile.PHOTOMETRIC.CFA
        grey = mosaic or kind in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.MINISWHITE)
        palette = kind == tifffile.PHOTOMETRIC.PALETTE
        # YCbCr is converted by the JPEG decoder; outside of JPEG nobody would convert it.
        rgb = kind == tifffile.PHOTOMETRIC.RGB or (
            kind == tifffile.PHOTOMETRIC.YCBCR
            and page.compression in (tifffile.COMPRESSION.JPEG, tifffile.COMPRESSION.OJPEG)
        )
        samples, bits = page.samplesperpixel, page.bitspersample
        if not ((grey and samples in (1, 2)) or (palette and samples == 1) or (rgb and samples >= 3)):
            raise FileFormatError(
                f"{path}: a TIFF of kind {kind.name} with {samples} channel(s) is not supported; convert it to "
                f"RGB or grey first"
            )
        file_length = Path(path).stat().st_size
        check_size(path, page.imagelength, page.imagewidth, samples * bits / 8, file_length)
        if page.is_tiled:  # whole tiles are allocated, too
            check_size(path, page.tilelength, page.tilewidth, samples * bits / 8, file_length)
        if len(file.pages) > 1 and not getattr(file.pages[1], "is_reduced", False):
            notices.append(f"only the first of its {len(file.pages)} pages was read")
        if page.dtype is not None and page.dtype.kind == "f":
            holds = ", and this one holds NaN" if np.isnan(page.asarray()).any() else ""
            raise FileFormatError(
                f"{path}: a floating-point TIFF is not a photo in camera codes{holds}; save it as 8 or 16 bits"
            )
        if page.dtype not in (np.bool_, np.uint8, np.uint16):
            raise FileFormatError(
                f"{path}: a TIFF of type {page.dtype} is not supported; save it as unsigned 8 or 16 bits"
            )
        missing = math.prod(page.chunked) - sum(count > 0 for count in page.databytecounts)
        if missing > 0:  # tifffile would fill them with zeros
            raise FileFormatError(
                f"{path}: damaged TIFF file: {missing} of its strips or tiles are missing; get it again"
            )
        codes = page.asarray()
        colour_map = page.colormap
        bayer = _stated_pattern(page.tags.valueof(CFA_REPEAT), page.tags.valueof(CFA_PATTERN)) if mosaic else None

    if page.axes == "SYX":
        codes = np.moveaxis(codes, 0, -1)
    if palette:  # 16-bit entries, which hold 8-bit colours times 257 by convention
        return StoredImage((colour_map >> 8).astype(np.uint8).T[codes], notices=notices)
    if codes.dtype == np.bool_:
        codes, bits = codes.astype(np.uint8) * np.uint8(255), 8
    white = 2**bits - 1  # 10, 12 and 14 bits are unpacked into uint16
    if kind == tifffile.PHOTOMETRIC.MINISWHITE:
        codes = codes.dtype.type(white) - codes
    return StoredImage(codes, white, mosaic, bayer, notices)


def _stated_pattern(repeat: Any, colours: Any) -> BayerPattern | None:
    """Return the Bayer pattern that TIFF tags state, None when they state none or another kind of mosaic."""
    try:
        if tuple(repeat) != (2, 2):
            return None
        return bayer_pattern("".join("RGB"[colour] for colour in colours))
    except (TypeError, IndexError, ConfigError):
        return None
