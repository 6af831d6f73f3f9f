"""JPEG XL, ``.jxl``: linear floating-point RGB, lossless in half or full precision, or lossy.

References
----------
ISO/IEC 18181-1:2024 (the codestream), ISO/IEC 18181-2:2024 (the boxes around it).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import ConfigError, FileFormatError
from stereohdr.io.boxes import box, boxes
from stereohdr.io.display import checked_white, diffuse_white, relative_to_white
from stereohdr.io.images import check_size
from stereohdr.io.notes import WHITE, attributes_to_rdf, take_white, unpack_xmp, xmp_packet

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIGNATURE = box(b"JXL ", b"\r\n\x87\n")
"""The box that every JPEG XL file starts with."""

LARGEST_HALF = 65504.0
"""The largest number that a half float holds."""

LARGEST_FLOAT = 1e38
"""What 32-bit floats hold, nearly: a radiance divided by that of white must not become infinite."""

EFFORT = 5
"""libjxl's effort; larger numbers take much longer and save a few percent."""

_SIZE_BITS = (9, 13, 18, 30)
_RATIOS = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))


def encode_jpeg_xl(
    radiance: NDArray[np.float32],
    attributes: Mapping[str, Any] | None = None,
    *,
    white: float | None = None,
    half: bool = False,
    quality: int = 100,
    name: str = "JPEG XL image",
) -> bytes:
    """Encode radiance as a JPEG XL image, linear with BT.709 primaries; diffuse white is stored as 1.

    Nothing is clipped: values above 1 are the highlights. (Half floats end at 65,504 times diffuse white.)

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, finite, >= 0.
    attributes
        Kept as XMP.
    white
        Radiance of diffuse white; see `diffuse_white` for the default. Kept in the file, so that
        `decode_jpeg_xl` returns radiance in its original unit.
    half
        Store half floats (11 bits of precision) instead of full ones.
    quality
        1 to 99, or 100 for lossless.
    name
        What messages call the file.

    Raises
    ------
    ConfigError
        A parameter is out of range.
    """
    import imagecodecs

    if not 1 <= quality <= 100:
        raise ConfigError(f"JPEG XL: quality must be from 1 to 100 (lossless), got {quality}")
    white = diffuse_white(radiance) if white is None else checked_white(white)
    relative = relative_to_white(radiance, white, LARGEST_HALF if half else LARGEST_FLOAT, name=name)
    coded = imagecodecs.jpegxl_encode(
        relative.astype(np.float16) if half else relative,
        None if quality == 100 else quality,
        lossless=quality == 100,
        effort=EFFORT,
        usecontainer=True,
        numthreads=0,  # all; the bytes do not depend on it
    )
    return bytes(coded) + box(b"xml ", xmp_packet(attributes_to_rdf({**(attributes or {}), WHITE: white})))


def decode_jpeg_xl(data: bytes, name: str = "JPEG XL image") -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Decode what `encode_jpeg_xl` made.

    Parameters
    ----------
    data
        The whole file.
    name
        What messages call it.

    Returns
    -------
    image
        ``(H, W, C)`` float32, C 1 or 3; radiance in its original unit.
    attributes
        What `encode_jpeg_xl` was given.

    Raises
    ------
    FileFormatError
        Not a JPEG XL image, damaged, or made by another program: what its numbers mean is not known then.
    """
    import imagecodecs

    if not data.startswith(SIGNATURE) and not data.startswith(b"\xff\x0a"):
        raise FileFormatError(
            f"{name}: not a JPEG XL image; get the file again, or give it the suffix of its format"
        )
    content = dict(boxes(data, name)) if data.startswith(SIGNATURE) else {}
    attributes = unpack_xmp(content.get(b"xml ", b""))
    codestream = content.get(b"jxlc", b"")
    if WHITE not in attributes or not codestream:
        raise FileFormatError(
            f"{name}: damaged, or not written by stereohdr, so that what its numbers mean is not known; get the "
            f"file again, or an OpenEXR file of it"
        )
    width, height = _size(codestream, name)
    check_size(name, height, width, 4, len(data))
    try:
        image = imagecodecs.jpegxl_decode(data, numthreads=0)
    except Exception as error:  # JpegxlError, ValueError, MemoryError, ... on damaged files
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{name}: damaged JPEG XL image ({reason}); get the file again") from error
    image = image[..., None] if image.ndim == 2 else image
    if image.dtype.kind != "f" or image.ndim != 3 or image.shape[2] not in (1, 3):
        raise FileFormatError(f"{name}: damaged JPEG XL image: it holds {image.dtype} {image.shape}; get it again")
    # Lossy compression may leave values a little below zero.
    with np.errstate(over="ignore"):
        return np.maximum(image.astype(np.float32), 0) * np.float32(take_white(attributes)), attributes


def _size(codestream: bytes, name: str) -> tuple[int, int]:
    """Return width and height from the first bits of the codestream (18181-1, SizeHeader; lowest bit first)."""
    bits = int.from_bytes(codestream[2:14], "little")
    taken = 0

    def take(count: int) -> int:
        nonlocal taken
        value = bits >> taken & ((1 << count) - 1)
        taken += count
        return value

    def side(in_eights: bool) -> int:
        return 8 * (take(5) + 1) if in_eights else take(_SIZE_BITS[take(2)]) + 1

    if not codestream.startswith(b"\xff\x0a") or len(codestream) < 14:
        raise FileFormatError(f"{name}: damaged JPEG XL image: it has no header; get the file again")
    in_eights = bool(take(1))
    height = side(in_eights)
    ratio = take(3)
    width = height * _RATIOS[ratio - 1][0] // _RATIOS[ratio - 1][1] if ratio else side(in_eights)
    return width, height
