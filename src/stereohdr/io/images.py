"""Reading photos of 8 and 16 bits with every bit that the file holds, and writing 8-bit PNG."""

from __future__ import annotations

import math
import struct
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import FileFormatError, InputError, StereoHdrWarning
from stereohdr.io.files import atomic_path
from stereohdr.io.metadata import ORIENTATION, exposure_from_tags, first_bytes, image_kind, read_tags
from stereohdr.model import Photo

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_PIXELS = 178_956_970
"""Images of more pixels are refused; this is where Pillow, too, suspects a decompression bomb."""

LARGEST_COMPRESSION = 100_000
"""No format packs pixels tighter than this, in bytes of pixels per byte of file; a header that promises more
is lying, and memory is not spent on it."""


def read_photo(
    path: str | Path,
    *,
    exposure_time: float | None = None,
    white_level: int | None = None,
    f_number: float | None = None,
    iso: float | None = None,
) -> Photo:
    """Read a photo from a PNG, JPEG or TIFF file of 8 or 16 bits, grey or RGB.

    The format is recognised by content, not by suffix. The EXIF orientation is applied. Palette images
    become RGB, 1-bit images become 8-bit grey, and alpha channels are dropped with a notice. Of a TIFF with
    several pages, and of a multi-picture JPEG, the first picture is read. Colour profiles are not applied.

    Parameters
    ----------
    path
        The file; becomes `Photo.name`.
    exposure_time, f_number, iso
        Seconds, aperture and sensitivity; what is not given is taken from EXIF, if it is there.
    white_level
        Code at which the sensor clips, for example 4095 for 12-bit codes stored in 16 bits. By default the
        largest code of the file's bit depth.

    Returns
    -------
    `Photo` with codes ``(H, W, C)``, uint8 or uint16, C 1 or 3.

    Raises
    ------
    FileFormatError
        The file cannot be read, is damaged, or holds a kind of image that is not supported (CMYK, floating
        point, ...).
    InputError
        The white level does not fit the bit depth.
    ExposureError
        A given exposure time, f-number or ISO is not a positive number.

    Warns
    -----
    StereoHdrWarning
        Something in the file was left out: alpha, extra channels, further pages.
    """
    kind = image_kind(path)
    notices: list[str] = []
    file_white: int | None = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of "bombs" at 90 Mpx, which cameras do reach
            if kind == "TIFF":
                codes, file_white = _read_tiff(path, notices)
            elif kind == "PNG" and _png_bit_depth(path) == 16:
                codes = _read_deep_png(path)
            else:
                codes = _read_with_pillow(path, kind)
    except FileFormatError:
        raise
    except Exception as error:  # three decoders, each with its own kinds of errors
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(
            f"{path}: damaged or unsupported {kind} file ({reason}); save it again as 8- or 16-bit PNG or TIFF"
        ) from error

    if codes.ndim == 2:
        codes = codes[..., None]
    colours = 1 if codes.shape[2] < 3 else 3
    if codes.shape[2] > colours:
        notices.append("its alpha channel was dropped" if codes.shape[2] in (2, 4) else "extra channels dropped")
    tags = read_tags(path)
    exif = exposure_from_tags(tags)
    photo = Photo(
        codes=_upright(codes[..., :colours], tags.get(ORIENTATION)),
        exposure_time=exif.time if exposure_time is None else exposure_time,
        white_level=file_white if white_level is None else white_level,
        f_number=exif.f_number if f_number is None else f_number,
        iso=exif.iso if iso is None else iso,
        name=str(path),
    )
    for notice in notices:
        warnings.warn(f"{path}: {notice}", StereoHdrWarning, stacklevel=2)
    return photo


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


def _read_tiff(path: str | Path, notices: list[str]) -> tuple[NDArray[Any], int | None]:
    """Decode the first page of a TIFF; return ``(H, W)`` or ``(H, W, S)`` codes and their white level."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        page: Any = file.pages.first
        if page.is_reduced or "DNGVersion" in page.tags:
            raise FileFormatError(
                f"{path}: the first picture is a preview (camera raw file?); develop it to a TIFF first"
            )
        if page.axes not in ("YX", "YXS", "SYX"):
            raise FileFormatError(f"{path}: a TIFF of shape {page.shape} is not a photo; save it as 2-D image")
        kind = tifffile.PHOTOMETRIC(page.photometric)
        grey = kind in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.MINISWHITE)
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

    if page.axes == "SYX":
        codes = np.moveaxis(codes, 0, -1)
    if palette:  # 16-bit entries, which hold 8-bit colours times 257 by convention
        return (colour_map >> 8).astype(np.uint8).T[codes], None
    if codes.dtype == np.bool_:
        codes, bits = codes.astype(np.uint8) * np.uint8(255), 8
    white = 2**bits - 1  # 10, 12 and 14 bits are unpacked into uint16
    if kind == tifffile.PHOTOMETRIC.MINISWHITE:
        codes = codes.dtype.type(white) - codes
    return codes, white


def _upright(codes: NDArray[Any], orientation: Any) -> NDArray[Any]:
    """Apply the EXIF orientation, 1 to 8; anything else changes nothing."""
    if orientation in (5, 6, 7, 8):
        codes = codes.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        codes = codes[:, ::-1]
    if orientation in (3, 4, 7, 8):
        codes = codes[::-1]
    return codes
