"""Radiance picture, ``.hdr``: three 8-bit mantissas and a common exponent per pixel (RGBE).

References
----------
Ward 1991, "Real pixels", Graphics Gems II; the file format is in the Radiance reference manual and in
``src/common/color.c`` of Radiance.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import FileFormatError
from stereohdr.io.images import check_size

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_VALUE = math.ldexp(255.0, 127 - 8)
"""The largest radiance that RGBE holds, about 1.7e38; larger values are stored as this."""

EXPONENT_BIAS = 128
"""A stored exponent E and mantissa M stand for ``M * 2 ** (E - 128 - 8)``; E = 0 stands for black."""

PRIMARIES = "0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329"
"""x and y of red, green, blue and white (BT.709 and D65)."""

SHORTEST_RUN = 4
LONGEST_RUN = 127
LONGEST_LITERAL = 128

_RUN_LENGTH_WIDTHS = range(8, 32768)
_RESOLUTION = re.compile(rb"([-+][XY]) +([0-9]{1,9}) +([-+][XY]) +([0-9]{1,9})")


def decode_radiance_hdr(data: bytes, name: str = "Radiance data") -> NDArray[np.float32]:
    """Decode a Radiance picture: flat, old or new run-length encoded scan lines.

    ``EXPOSURE=`` and ``COLORCORR=`` lines say by what the pixels were multiplied; they are divided out.

    Parameters
    ----------
    data
        The whole file.
    name
        What messages call it.

    Returns
    -------
    ``(H, W, 3)`` float32.

    Raises
    ------
    FileFormatError
        Not a Radiance picture, damaged, in XYZ colours, or not stored as ``-Y H +X W``.
    """
    height, width, multiplier, start = _decode_header(data, name)
    check_size(name, height, width, 4, len(data))
    rgbe = _decode_scanlines(data, start, height, width, name)
    unit = np.ldexp(np.ones(256, np.float32), np.arange(256) - (EXPONENT_BIAS + 8))
    unit[0] = 0.0
    radiance = rgbe[..., :3].astype(np.float32) * unit[rgbe[..., 3:]]
    if (multiplier != 1).any():
        with np.errstate(over="ignore"):  # an absurd EXPOSURE; `read_hdr` refuses what is not finite
            radiance = (radiance / multiplier).astype(np.float32)
    return radiance


def encode_radiance_hdr(radiance: NDArray[np.float32], attributes: Mapping[str, Any] | None = None) -> bytes:
    """Encode radiance as a Radiance picture.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, finite, >= 0; grey is stored as three equal channels. The largest channel of a
        pixel keeps a relative error of at most 1/256; values above `LARGEST_VALUE` are clipped, pixels below
        2^-128 become black.
    attributes
        Written as comment lines ``# key=value``.

    Notes
    -----
    ``EXPOSURE=1`` says that the pixels are the radiance itself; ``PRIMARIES`` are those of BT.709 with white D65
    (the format's own default has white 1/3, 1/3).
    """
    height, width, _ = radiance.shape
    lines = ["#?RADIANCE"]
    for key, value in (attributes or {}).items():
        lines.append("# " + " ".join(f"{key}={value}".split()))  # a line break would end the comment
    lines += [f"EXPOSURE=1\nPRIMARIES={PRIMARIES}\nFORMAT=32-bit_rle_rgbe", "", f"-Y {height} +X {width}", ""]
    header = "\n".join(lines).encode("ascii", "backslashreplace")

    rgbe = _to_rgbe(radiance)
    if width not in _RUN_LENGTH_WIDTHS:
        return header + rgbe.tobytes()
    encoded = bytearray(header)
    for row in np.ascontiguousarray(np.moveaxis(rgbe, -1, 1)):
        encoded += bytes((2, 2, width >> 8, width & 255))
        for channel in row:
            _encode_runs(channel, encoded)
    return bytes(encoded)


def _to_rgbe(radiance: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return ``(H, W, 4)`` uint8 mantissas and exponent, rounded to nearest."""
    height, width, _ = radiance.shape
    rgbe = np.zeros((height, width, 4), np.uint8)
    for y, row in enumerate(radiance):  # by rows, to keep the float64 copies small
        values = np.minimum(row.astype(np.float64), LARGEST_VALUE)
        largest = values.max(axis=-1)
        exponent = np.frexp(largest)[1]  # largest / 2**exponent is in [0.5, 1)
        exponent += np.rint(np.ldexp(largest, 8 - exponent)) >= 256  # rounds up to the next power of two
        mantissa = np.rint(np.ldexp(values, (8 - exponent)[:, None]))
        # The smallest exponent, 0, stands for black. Denormal pixels would also be taken for repeat counts.
        kept = (largest > 0) & (exponent + EXPONENT_BIAS >= 1)
        rgbe[y, :, :3] = np.where(kept[:, None], mantissa, 0)
        rgbe[y, :, 3] = np.where(kept, exponent + EXPONENT_BIAS, 0)
    return rgbe


def _encode_runs(channel: NDArray[np.uint8], encoded: bytearray) -> None:
    """Append one channel of one scan line: ``(128 + n, value)`` for runs, ``(n, n values)`` for the rest."""
    content = channel.tobytes()
    edges = np.flatnonzero(channel[1:] != channel[:-1]) + 1
    starts = np.concatenate(([0], edges))
    stops = np.append(edges, channel.size)
    is_run = stops - starts >= SHORTEST_RUN
    done = 0
    for start, stop in zip(starts[is_run].tolist(), stops[is_run].tolist(), strict=True):
        _encode_literals(content, done, start, encoded)
        for begin in range(start, stop, LONGEST_RUN):
            encoded += bytes((128 + min(LONGEST_RUN, stop - begin), content[start]))
        done = stop
    _encode_literals(content, done, channel.size, encoded)


def _encode_literals(content: bytes, start: int, stop: int, encoded: bytearray) -> None:
    for begin in range(start, stop, LONGEST_LITERAL):
        piece = content[begin : min(begin + LONGEST_LITERAL, stop)]
        encoded.append(len(piece))
        encoded += piece


def _decode_header(data: bytes, name: str) -> tuple[int, int, NDArray[np.float64], int]:
    """Return height, width, what the pixels were multiplied by (per channel), and where they start."""
    if not data.startswith(b"#?"):
        raise FileFormatError(f"{name}: not a Radiance picture (it does not start with #?); get the file again")
    multiplier = np.ones(3)
    position = 0
    while True:
        end = data.find(b"\n", position)
        if end < 0:
            raise _damaged(name, "its header has no end")
        line, position = data[position:end].strip(), end + 1
        if not line:
            break
        key, _, value = line.partition(b"=")
        if key == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise FileFormatError(
                f"{name}: pixels of format {value.decode('ascii', 'replace')!r} are not supported; convert the "
                f"picture to 32-bit_rle_rgbe"
            )
        if key in (b"EXPOSURE", b"COLORCORR"):
            factors = _numbers(value)
            if len(factors) != (1 if key == b"EXPOSURE" else 3) or not all(0 < x < math.inf for x in factors):
                raise _damaged(name, f"its header says {line[:60].decode('ascii', 'replace')!r}")
            with np.errstate(over="ignore"):
                multiplier = multiplier * factors
    if not (np.isfinite(multiplier).all() and (multiplier > 0).all()):
        raise _damaged(name, "its EXPOSURE lines have no finite product")

    end = data.find(b"\n", position)
    resolution = _RESOLUTION.fullmatch(data[position : max(end, position)].strip())
    if resolution is None:
        raise _damaged(name, "it has no resolution line")
    if (resolution[1], resolution[3]) != (b"-Y", b"+X"):
        raise FileFormatError(
            f"{name}: pictures stored as {resolution[0].decode()!r} are not supported; turn it to '-Y H +X W'"
        )
    height, width = int(resolution[2]), int(resolution[4])
    if height < 1 or width < 1:
        raise _damaged(name, f"the picture is {width}x{height} pixels")
    return height, width, multiplier, end + 1


def _numbers(text: bytes) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []


def _decode_scanlines(data: bytes, position: int, height: int, width: int, name: str) -> NDArray[np.uint8]:
    """Return ``(H, W, 4)`` uint8."""
    rows: list[NDArray[np.uint8]] = []  # grows with what was really read, not with what the header promises
    marker = bytes((2, 2, width >> 8 & 255, width & 255))
    for _ in range(height):
        if width in _RUN_LENGTH_WIDTHS and data[position : position + 4] == marker:
            row, position = _decode_new_runs(data, position + 4, width, name)
        else:
            row, position = _decode_old_runs(data, position, width, name)
        rows.append(row)
    return np.stack(rows)


def _decode_new_runs(data: bytes, position: int, width: int, name: str) -> tuple[NDArray[np.uint8], int]:
    """Decode one scan line whose four channels are run-length encoded one after the other."""
    row = bytearray()
    for channel in range(1, 5):
        while len(row) < channel * width:
            if position + 1 >= len(data):
                raise _damaged(name, "it ends early")
            count = data[position]
            if count > 128:
                row += data[position + 1 : position + 2] * (count - 128)
                position += 2
            else:
                row += data[position + 1 : position + 1 + count]
                position += 1 + count
                if count == 0 or position > len(data):
                    raise _damaged(name, "a scan line is broken off" if count else "a run has length 0")
        if len(row) > channel * width:
            raise _damaged(name, "a run leaves its scan line")
    return np.frombuffer(bytes(row), np.uint8).reshape(4, width).T.copy(), position


def _decode_old_runs(data: bytes, position: int, width: int, name: str) -> tuple[NDArray[np.uint8], int]:
    """Decode one scan line of plain pixels, where (1, 1, 1, n) repeats the pixel before it n times.

    Counts that follow each other are the bytes of one number, lowest first.
    """
    available = min(width, (len(data) - position) // 4)
    records = np.frombuffer(data, np.uint8, available * 4, position).reshape(available, 4)
    repeats = (records[:, :3] == 1).all(axis=1)
    if available == width and not repeats.any():
        return records, position + width * 4
    if available == 0 or repeats[0]:
        raise _damaged(name, "it ends early" if available == 0 else "a scan line starts with a repeat count")
    index = np.arange(available)
    pixel = np.maximum.accumulate(np.where(repeats, 0, index))  # the pixel that a record repeats
    byte_number = np.minimum(index - pixel - 1, 4)  # 4: far more than the widest image, whatever follows
    count = np.where(repeats, records[:, 3].astype(np.int64) << (8 * np.maximum(byte_number, 0)), 1)
    filled = np.cumsum(count)
    last = int(np.searchsorted(filled, width))
    if last == available:
        raise _damaged(name, "it ends early")
    if filled[last] > width:
        raise _damaged(name, "a run leaves its scan line")
    return records[np.repeat(pixel[: last + 1], count[: last + 1])], position + 4 * (last + 1)


def _damaged(name: str, what: str) -> FileFormatError:
    return FileFormatError(f"{name}: damaged Radiance picture: {what}; get the file again")
