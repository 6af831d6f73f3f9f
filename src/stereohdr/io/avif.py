"""AVIF, ``.avif``: an AV1 still image with PQ codes and BT.2020 colours, which browsers and phones show as HDR.

References
----------
AV1 Image File Format 1.1 (AOMedia); ITU-T H.273 for the numbers of primaries, transfer and matrix.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import ConfigError, FileFormatError, InputError
from stereohdr.io.boxes import box, boxes, first_box
from stereohdr.io.display import (
    BT709_TO_BT2020,
    DIFFUSE_WHITE,
    PQ_PEAK,
    checked_white,
    diffuse_white,
    pq_decode,
    pq_encode,
    relative_to_white,
)
from stereohdr.io.images import check_size
from stereohdr.io.notes import WHITE, attributes_to_rdf, take_white, unpack_xmp, xmp_packet

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_SIDE = 65_535
"""Pixels a side that encoders and decoders agree on."""

BT709, BT2020 = 1, 9
"""Primaries in H.273; BT2020 is the number of the YCbCr matrix, too."""

PQ = 16
"""Transfer characteristics of SMPTE ST 2084 in H.273."""

RGB_MATRIX = 0
"""Matrix number of plain RGB, for lossless files."""

XMP_UUID = bytes.fromhex("be7acfcb97a942e89c71999491e3afac")
"""The ``uuid`` box that holds XMP in ISO base media files (XMP specification, part 3)."""

SPEED, THREADS = 8, 4
"""libaom's settings. Slower speeds save a few percent and take many times longer; the bytes depend on both, so
that neither is left to the machine."""

_ROWS = 256
"""Rows that are converted at a time, to keep the float64 copies of large images small."""


def encode_avif(
    radiance: NDArray[np.float32],
    attributes: Mapping[str, Any] | None = None,
    *,
    white: float | None = None,
    bits: int = 10,
    quality: int = 95,
    name: str = "AVIF image",
) -> bytes:
    """Encode radiance as an AVIF image with BT.2020 primaries and the PQ transfer function.

    Diffuse white becomes 203 cd/m² (BT.2408). The luminances that PQ leaves, up to 10,000 cd/m², are 5.6 stops
    above it; brighter pixels are darkened to that, keeping their hue.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, finite, >= 0, BT.709 primaries; grey is stored as three equal channels.
    attributes
        Kept as XMP.
    white
        Radiance of diffuse white; see `diffuse_white` for the default. Kept in the file, so that `decode_avif`
        returns radiance in its original unit.
    bits
        10 or 12 bits per channel.
    quality
        1 to 99, or 100 for a file that keeps every code (about four times as large).
    name
        What messages call the file.

    Raises
    ------
    ConfigError
        A parameter is out of range.
    InputError
        The image is too large for AVIF.
    """
    import imagecodecs

    height, width, _ = radiance.shape
    if max(height, width) > LARGEST_SIDE:
        raise InputError(
            f"{name}: AVIF images have at most {LARGEST_SIDE} pixels a side, this one is {width}x{height}"
        )
    if bits not in (10, 12):
        raise ConfigError(f"AVIF: bits must be 10 or 12, got {bits}")
    if not 1 <= quality <= 100:
        raise ConfigError(f"AVIF: quality must be from 1 to 100 (lossless), got {quality}")
    white = diffuse_white(radiance) if white is None else checked_white(white)
    relative = relative_to_white(radiance, white, PQ_PEAK / DIFFUSE_WHITE, name=name)
    codes = np.empty((height, width, 3), np.uint16)
    for top in range(0, height, _ROWS):
        rows = slice(top, top + _ROWS)
        light = np.broadcast_to(relative[rows], (*relative[rows].shape[:2], 3)) @ BT709_TO_BT2020.T
        codes[rows] = np.rint((2**bits - 1) * pq_encode(DIFFUSE_WHITE * light))
    lossless = quality == 100
    coded = imagecodecs.avif_encode(
        codes,
        None if lossless else quality,
        bitspersample=bits,
        pixelformat="yuv444",
        primaries=BT2020,
        transfer=PQ,
        matrix=RGB_MATRIX if lossless else BT2020,
        speed=SPEED,
        numthreads=THREADS,
    )
    xmp = xmp_packet(attributes_to_rdf({**(attributes or {}), WHITE: white}))
    return bytes(coded) + box(b"uuid", XMP_UUID + xmp)


def decode_avif(data: bytes, name: str = "AVIF image") -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Decode an AVIF image with the PQ transfer function.

    Parameters
    ----------
    data
        The whole file.
    name
        What messages call it.

    Returns
    -------
    image
        ``(H, W, C)`` float32 with BT.709 primaries (colours outside of them are clipped), C 1 or 3; radiance in
        its original unit if `encode_avif` made the file, else relative to diffuse white (203 cd/m²).
    attributes
        What `encode_avif` was given; empty for files of other programs.

    Raises
    ------
    FileFormatError
        Not an AVIF image, damaged, or not with PQ and BT.709 or BT.2020 primaries.
    """
    import imagecodecs

    attributes: dict[str, Any] = {}
    properties = b""
    for kind, content in boxes(data, name) if data[4:8] == b"ftyp" else ():
        if kind == b"uuid" and content.startswith(XMP_UUID):
            attributes = unpack_xmp(content)
        elif kind == b"meta":
            properties = first_box(first_box(content[4:], b"iprp", name) or b"", b"ipco", name) or b""
    if not properties:
        raise FileFormatError(
            f"{name}: not an AVIF image; get the file again, or give it the suffix of its format"
        )
    bits, primaries = _check_properties(properties, len(data), name)
    try:
        codes = imagecodecs.avif_decode(data, numthreads=THREADS)
    except Exception as error:  # AvifError, ValueError, MemoryError, ... on damaged files
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{name}: damaged AVIF image ({reason}); get the file again") from error
    if codes.ndim not in (2, 3):
        raise FileFormatError(f"{name}: an AVIF sequence is not supported; save one image of it")
    height, width = codes.shape[:2]
    colours = codes.reshape(height, width, -1)
    channels = 1 if colours.shape[2] < 3 else 3  # others are alpha
    scale = take_white(attributes) / DIFFUSE_WHITE
    to_bt709 = np.eye(channels)
    if primaries == BT2020 and channels == 3:
        to_bt709 = np.linalg.inv(BT709_TO_BT2020).T
    image = np.empty((height, width, channels), np.float32)
    for top in range(0, height, _ROWS):
        rows = slice(top, top + _ROWS)
        light = pq_decode(colours[rows, :, :channels] / (2**bits - 1)) @ to_bt709
        image[rows] = scale * np.maximum(light, 0)
    return image, attributes


def _check_properties(properties: bytes, file_length: int, name: str) -> tuple[int, int]:
    """Return bits per channel and primaries of the image; check size and transfer function."""
    bits, primaries, transfer = 0, 0, 0
    for kind, content in boxes(properties, name):
        if kind == b"ispe" and len(content) >= 12:
            width, height = struct.unpack(">II", content[4:12])
            check_size(name, height, width, 6, file_length)
        elif kind == b"av1C" and len(content) >= 4 and not bits:
            bits = (12 if content[2] & 0x20 else 10) if content[2] & 0x40 else 8
        elif kind == b"colr" and content[:4] == b"nclx" and len(content) >= 8:
            primaries, transfer = struct.unpack(">HH", content[4:8])
    if not bits:
        raise FileFormatError(f"{name}: damaged AVIF image: it does not say how it is coded; get the file again")
    if transfer != PQ or primaries not in (BT709, BT2020):
        raise FileFormatError(
            f"{name}: only AVIF images with the PQ transfer function and BT.709 or BT.2020 primaries are read, "
            f"this one has transfer {transfer} and primaries {primaries} of H.273; get an OpenEXR file of it"
        )
    return bits, primaries
