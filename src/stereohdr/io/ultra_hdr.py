"""Ultra HDR, ``.jpg``: a JPEG that every program shows, with a gain map that makes it HDR where that is known.

A file holds two JPEG images, one behind the other: the tone-mapped base and the map of the gain, in log2, from
base to HDR image. The gain map is described twice, in ISO 21496-1 and in XMP: some readers know only one of them.

References
----------
ISO 21496-1:2025, "Gain map metadata for image conversion"; Google, "Ultra HDR image format v1.1" (XMP, container);
CIPA DC-007-2009, "Multi-picture format".
"""

from __future__ import annotations

import math
import struct
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import ConfigError, FileFormatError, InputError, StereoHdrWarning
from stereohdr.io.display import checked_white, diffuse_white, relative_to_white
from stereohdr.io.images import check_size
from stereohdr.io.notes import WHITE, attributes_to_rdf, take_white, unpack_xmp, xmp_packet
from stereohdr.tone_mapping import Operator, srgb_decode, tonemap

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEADROOM = 4.0
"""Stops above diffuse white that are stored by default; displays have 1 to 4."""

SMALLEST_HEADROOM = 1.0
"""Stops that a file states even if its image has fewer: displays divide by it."""

LARGEST_HEADROOM = 16.0
"""Stops up to which the headroom may be set."""

OFFSET = 1 / 64
"""Added to base and HDR image before the gain is taken, so that black has one; the usual value."""

SMALLEST_GAIN = -4.0
"""Gains below, which only coding errors in black have, are clipped: they would cost precision everywhere."""

LARGEST_SIDE = 65_535
"""Pixels a side that a JPEG can have."""

DENOMINATOR = 2**20
"""Gains and headroom are stored as fractions with this denominator."""

ISO_NAME = b"urn:iso:std:iso:ts:21496:-1\0"
XMP_NAME = b"http://ns.adobe.com/xap/1.0/\0"
MPF_NAME = b"MPF\0"
ICC_NAME = b"ICC_PROFILE\0"

_APP1, _APP2 = 0xE1, 0xE2
_START, _END = b"\xff\xd8", b"\xff\xd9"
_SCAN = 0xDA
_LARGEST_SEGMENT = 65_533

_ROWS = 256
"""Rows that are converted at a time, to keep the float64 copies of large images small."""


@dataclass(frozen=True)
class GainMap:
    """How the codes of a gain map become gains (ISO 21496-1); each field holds one number, or one per channel."""

    low: tuple[float, ...]
    """log2 of the gain at code 0."""
    high: tuple[float, ...]
    """log2 of the gain at code 255."""
    gamma: tuple[float, ...]
    """Exponent with which the codes were compressed."""
    base_offset: tuple[float, ...]
    """Added to the base image."""
    alternate_offset: tuple[float, ...]
    """Subtracted from the HDR image."""
    headroom: float
    """log2 of the display's peak over white from which on the whole gain is applied."""


def encode_ultra_hdr(
    radiance: NDArray[np.float32],
    attributes: Mapping[str, Any] | None = None,
    *,
    white: float | None = None,
    headroom: float = HEADROOM,
    operator: Operator = "reinhard",
    quality: int = 95,
    name: str = "Ultra HDR image",
) -> bytes:
    """Encode radiance as a JPEG with a gain map.

    The base is what `tonemap` returns. The gain map has full size and three channels; it is computed from the base
    as it comes out of its JPEG, so that it corrects the base's coding errors, too.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, finite, >= 0, BT.709 primaries; grey is stored as three equal channels.
    attributes
        Kept as XMP.
    white
        Radiance of diffuse white, on whose level the display puts the white of SDR pictures; see
        `diffuse_white` for the default. Kept in the file, so that `decode_ultra_hdr` returns radiance in its
        original unit.
    headroom
        Stops above diffuse white, 1 to 16: brighter pixels are darkened to that, keeping their hue. The file
        states fewer if the image needs fewer.
    operator
        Tone mapping of the base.
    quality
        JPEG quality of base and gain map, 1 to 100.
    name
        What messages call the file.

    Raises
    ------
    ConfigError
        A parameter is out of range.
    InputError
        The image is too large for JPEG, or the attributes for XMP.
    """
    height, width, _ = radiance.shape
    if max(height, width) > LARGEST_SIDE:
        raise InputError(
            f"{name}: JPEG images have at most {LARGEST_SIDE} pixels a side, this one is {width}x{height}"
        )
    if not SMALLEST_HEADROOM <= headroom <= LARGEST_HEADROOM:
        raise ConfigError(
            f"Ultra HDR: headroom is in stops, from {SMALLEST_HEADROOM:g} to {LARGEST_HEADROOM:g}, got {headroom}"
        )
    if not 1 <= quality <= 100:
        raise ConfigError(f"Ultra HDR: quality must be from 1 to 100, got {quality}")
    white = diffuse_white(radiance) if white is None else checked_white(white)
    colour = np.broadcast_to(radiance, (height, width, 3))
    hdr = relative_to_white(colour, white, 2.0**headroom, name=name)

    base = _encode_jpeg(tonemap(colour, operator), quality)
    gain = _log_gain(_decode_jpeg(base, name), hdr)
    low, high = _rounded(gain.min()), _rounded(max(gain.max(), gain.min() + 0.01))
    codes = np.rint(np.clip((gain - low) * (255.0 / (high - low)), 0, 255)).astype(np.uint8)
    needed = math.log2(max(float(hdr.max()), 2.0**SMALLEST_HEADROOM))
    gain_map = GainMap((low,) * 3, (high,) * 3, (1.0,) * 3, (OFFSET,) * 3, (OFFSET,) * 3, _rounded(needed))
    return _assemble(base, _encode_jpeg(codes, quality), gain_map, {**(attributes or {}), WHITE: white}, name)


def decode_ultra_hdr(data: bytes, name: str = "Ultra HDR image") -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Decode a JPEG with a gain map as ISO 21496-1 describes it, with the whole gain.

    Parameters
    ----------
    data
        The whole file.
    name
        What messages call it.

    Returns
    -------
    image
        ``(H, W, 3)`` float32 with the primaries of the base (BT.709 unless it carries a profile, which is not
        applied); in the original unit if `encode_ultra_hdr` made the file, else relative to diffuse white.
    attributes
        What `encode_ultra_hdr` was given; empty for files of other programs.

    Raises
    ------
    FileFormatError
        Not a JPEG, damaged, or without such a gain map.

    Warns
    -----
    StereoHdrWarning
        The base carries a colour profile.
    """
    segments = list(_segments(data, name))
    second = _second_image(data, segments, name)
    attributes: dict[str, Any] = {}
    for _, marker, content in segments:
        if marker == _APP1 and content.startswith(XMP_NAME):
            attributes = unpack_xmp(content)
        elif marker == _APP2 and content.startswith(ICC_NAME):
            warnings.warn(f"{name}: its colour profile was not applied", StereoHdrWarning, stacklevel=2)
    gain_map = _gain_map_of(second, name)
    base, codes = _decode_jpeg(data, name), _decode_jpeg(second, name)
    if codes.shape[:2] != base.shape[:2]:
        codes = _resized(codes, base.shape[0], base.shape[1])
    return _apply(base, codes, gain_map) * np.float32(take_white(attributes)), attributes


def _log_gain(base: NDArray[np.uint8], hdr: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``(H, W, 3)`` log2 of the gain from base codes to the HDR image."""
    light = srgb_decode(np.arange(256) / 255).astype(np.float32) + np.float32(OFFSET)
    gain = np.log2((hdr + np.float32(OFFSET)) / light[base])
    return np.maximum(gain, np.float32(SMALLEST_GAIN))


def _apply(base: NDArray[np.uint8], codes: NDArray[np.uint8], gain_map: GainMap) -> NDArray[np.float32]:
    """Return ``(H, W, 3)`` light, 1 is diffuse white: 21496-1, 6.2."""
    light = srgb_decode(np.arange(256) / 255)
    position = np.arange(256) / 255
    hdr = np.empty(base.shape, np.float32)
    for c in range(3):
        low, high, gamma, base_offset, offset = (
            field[c % len(field)]
            for field in (
                gain_map.low,
                gain_map.high,
                gain_map.gamma,
                gain_map.base_offset,
                gain_map.alternate_offset,
            )
        )
        with np.errstate(over="ignore"):  # `read_hdr` refuses what is not finite
            gain = np.exp2(low + (high - low) * position ** (1 / gamma)).astype(np.float32)
            shifted = (light + base_offset).astype(np.float32)
            product = shifted[base[..., c]] * gain[codes[..., c % codes.shape[2]]]
        hdr[..., c] = np.maximum(product - np.float32(offset), 0)
    return hdr


def _encode_jpeg(codes: NDArray[np.uint8], quality: int) -> bytes:
    from PIL import Image

    file = BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=quality, subsampling=0)
    return file.getvalue()


def _decode_jpeg(data: bytes, name: str) -> NDArray[np.uint8]:
    """Return ``(H, W, C)`` codes, C 3 for the base, 1 or 3 for a gain map."""
    from PIL import Image

    try:
        with Image.open(BytesIO(data), formats=("JPEG", "MPO")) as image:
            check_size(name, image.height, image.width, len(image.getbands()), len(data))
            if image.mode not in ("L", "RGB"):
                raise FileFormatError(f"{name}: {image.mode} JPEG images are not supported; convert it to RGB")
            codes = np.asarray(image)
    except FileFormatError:
        raise
    except Exception as error:  # Pillow raises OSError, SyntaxError, struct.error, ... on damaged files
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{name}: damaged JPEG image ({reason}); get the file again") from error
    return codes[..., None] if codes.ndim == 2 else codes


def _resized(codes: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Return a gain map in the size of its base."""
    from PIL import Image

    planes = [
        np.asarray(Image.fromarray(codes[..., c]).resize((width, height), Image.Resampling.BILINEAR))
        for c in range(codes.shape[2])
    ]
    return np.stack(planes, axis=-1)


# --- the container ----------------------------------------------------------------------------------------------


def _assemble(base: bytes, second: bytes, gain_map: GainMap, attributes: Mapping[str, Any], name: str) -> bytes:
    """Return the file: the base with its new segments, then the gain map with its own."""
    metadata = _pack_gain_map(gain_map)
    second = _with_segments(
        second,
        _segment(_APP1, XMP_NAME + xmp_packet(_gain_map_rdf(gain_map)), name),
        _segment(_APP2, ISO_NAME + metadata, name),
    )
    xmp = xmp_packet(_directory_rdf(len(second)), attributes_to_rdf(attributes))
    base = _with_segments(
        base,
        _segment(_APP1, XMP_NAME + xmp, name),
        _segment(_APP2, ISO_NAME + metadata[:4], name),  # the versions only: the gain map has the rest
        _segment(_APP2, MPF_NAME + _multi_picture_index(0, 0, 0), name),
    )
    # The index has its final length now, so that the positions in it can be computed.
    index_at = base.index(MPF_NAME + b"MM") + len(MPF_NAME)
    index = _multi_picture_index(len(base), len(second), len(base) - index_at)
    return base[:index_at] + index + base[index_at + len(index) :] + second


def _segment(marker: int, content: bytes, name: str) -> bytes:
    if len(content) > _LARGEST_SEGMENT:
        raise InputError(f"{name}: the attributes do not fit into a JPEG ({len(content)} bytes); give fewer")
    return struct.pack(">BBH", 0xFF, marker, 2 + len(content)) + content


def _with_segments(jpeg: bytes, *segments: bytes) -> bytes:
    """Insert segments behind that of JFIF, which has to be the first."""
    end = 4 + struct.unpack(">H", jpeg[4:6])[0]
    return jpeg[:end] + b"".join(segments) + jpeg[end:]


def _multi_picture_index(first_length: int, second_length: int, second_offset: int) -> bytes:
    """Return the index of two pictures (CIPA DC-007, 5.2), a big-endian TIFF structure."""
    entries_at = 8 + 2 + 3 * 12 + 4
    entry = struct.Struct(">IIIHH")
    return (
        struct.pack(">2sHIH", b"MM", 42, 8, 3)
        + struct.pack(">HHI4s", 0xB000, 7, 4, b"0100")  # version
        + struct.pack(">HHII", 0xB001, 4, 1, 2)  # number of pictures
        + struct.pack(">HHII", 0xB002, 7, 2 * entry.size, entries_at)
        + struct.pack(">I", 0)
        + entry.pack(0x030000, first_length, 0, 0, 0)  # "baseline primary image"
        + entry.pack(0, second_length, second_offset, 0, 0)
    )


def _pack_gain_map(gain_map: GainMap) -> bytes:
    """Return the metadata of ISO 21496-1, annex C: versions, flags, headrooms, then each channel."""
    fields = (gain_map.low, gain_map.high, gain_map.gamma, gain_map.base_offset, gain_map.alternate_offset)
    packed = struct.pack(">HHB", 0, 0, 0xC0)  # three channels, gains in the base's colour space
    packed += _fraction(0.0) + _fraction(gain_map.headroom)
    return packed + b"".join(_fraction(field[c]) for c in range(3) for field in fields)


def _fraction(value: float) -> bytes:
    return struct.pack(">iI", round(value * DENOMINATOR), DENOMINATOR)


def _rounded(value: float) -> float:
    """Return the number nearest to `value` that the file can hold."""
    return round(float(value) * DENOMINATOR) / DENOMINATOR


def _gain_map_rdf(gain_map: GainMap) -> str:
    return (
        '<rdf:Description rdf:about="" xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0" '
        f'hdrgm:GainMapMin="{gain_map.low[0]:.7g}" hdrgm:GainMapMax="{gain_map.high[0]:.7g}" '
        f'hdrgm:Gamma="{gain_map.gamma[0]:g}" hdrgm:OffsetSDR="{gain_map.base_offset[0]:.7g}" '
        f'hdrgm:OffsetHDR="{gain_map.alternate_offset[0]:.7g}" hdrgm:HDRCapacityMin="0" '
        f'hdrgm:HDRCapacityMax="{gain_map.headroom:.7g}" hdrgm:BaseRenditionIsHDR="False"/>\n'
    )


def _directory_rdf(second_length: int) -> str:
    item = (
        '<rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="{}" Item:Mime="image/jpeg"{}/></rdf:li>'
    )
    return (
        '<rdf:Description rdf:about="" xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" '
        'xmlns:Container="http://ns.google.com/photos/1.0/container/" '
        'xmlns:Item="http://ns.google.com/photos/1.0/container/item/" hdrgm:Version="1.0">'
        f"<Container:Directory><rdf:Seq>{item.format('Primary', '')}"
        f"{item.format('GainMap', f' Item:Length={chr(34)}{second_length}{chr(34)}')}"
        "</rdf:Seq></Container:Directory></rdf:Description>\n"
    )


def _segments(jpeg: bytes, name: str) -> Iterator[tuple[int, int, bytes]]:
    """Yield position, marker and content of the segments before the first scan."""
    if not jpeg.startswith(_START):
        raise FileFormatError(f"{name}: not a JPEG image; get the file again, or give it the suffix of its format")
    position = len(_START)
    while True:
        head = jpeg[position : position + 4]
        if len(head) < 4 or head[0] != 0xFF:
            raise FileFormatError(f"{name}: damaged JPEG image: its header is broken off; get the file again")
        _, marker, length = struct.unpack(">BBH", head)
        if marker == 0xFF:  # a fill byte
            position += 1
            continue
        yield position, marker, jpeg[position + 4 : position + 2 + length]
        if marker == _SCAN:
            return
        position += 2 + length


def _second_image(data: bytes, segments: list[tuple[int, int, bytes]], name: str) -> bytes:
    """Return the second picture that the multi-picture index lists."""
    for position, marker, content in segments:
        if marker == _APP2 and content.startswith(MPF_NAME):
            start, length = _second_entry(content[len(MPF_NAME) :], name)
            start += position + 4 + len(MPF_NAME)
            second = data[start : start + length]
            if len(second) < length or not second.startswith(_START) or not second.endswith(_END):
                raise FileFormatError(f"{name}: damaged JPEG image: its gain map is cut off; get the file again")
            return second
    raise FileFormatError(
        f"{name}: a JPEG without a gain map is no HDR image; give a photo to fuse or merge, or get the HDR image"
    )


def _second_entry(index: bytes, name: str) -> tuple[int, int]:
    """Return offset (from the index) and length of the second picture."""
    order = ">" if index.startswith(b"MM") else "<"
    try:
        (directory,) = struct.unpack_from(f"{order}I", index, 4)
        (count,) = struct.unpack_from(f"{order}H", index, directory)
        for i in range(count):
            tag, _, _, value = struct.unpack_from(f"{order}HHII", index, directory + 2 + 12 * i)
            if tag == 0xB002:
                _, length, offset = struct.unpack_from(f"{order}III", index, value + 16)
                return offset, length
    except struct.error:
        pass
    raise FileFormatError(f"{name}: damaged JPEG image: its index of pictures is broken; get the file again")


def _gain_map_of(second: bytes, name: str) -> GainMap:
    """Return the metadata of a gain map image."""
    for _, marker, content in _segments(second, name):
        if marker == _APP2 and content.startswith(ISO_NAME):
            try:
                return _unpack_gain_map(content[len(ISO_NAME) :])
            except (struct.error, ArithmeticError, ValueError) as error:
                raise FileFormatError(
                    f"{name}: damaged JPEG image: the description of its gain map is not valid; get the file again"
                ) from error
    raise FileFormatError(
        f"{name}: has a second picture, but no gain map as ISO 21496-1 describes it; get an OpenEXR file of it"
    )


def _unpack_gain_map(metadata: bytes) -> GainMap:
    """Return the metadata of ISO 21496-1, annex C; ValueError if it is not for an SDR base of our colour space."""
    version, _, flags = struct.unpack_from(">HHB", metadata)
    numbers = [Fraction(*pair) for pair in struct.iter_unpack(">iI", metadata[5:])]
    channels = 3 if flags & 0x80 else 1
    base_headroom, headroom = numbers[:2]
    rows = [tuple(float(n) for n in numbers[2 + i :: 5][:channels]) for i in range(5)]
    low, high, gamma, base_offset, offset = rows
    if version or not flags & 0x40 or base_headroom or headroom <= 0 or len(numbers) != 2 + 5 * channels:
        raise ValueError("not an SDR base")
    if min(gamma) <= 0 or min(low) < -100 or max(high) > 100:
        raise ValueError("gains out of range")
    return GainMap(low, high, gamma, base_offset, offset, float(headroom))
