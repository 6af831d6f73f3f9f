"""Boxes of the ISO base media file format, which AVIF and JPEG XL files are made of.

References
----------
ISO/IEC 14496-12, section 4.2: a box is its length in 32 bits (1: 64 bits follow the type; 0: to the end of the
file), four letters that say its type, and its content.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from stereohdr.errors import FileFormatError


def box(kind: bytes, content: bytes) -> bytes:
    """Return a box of the four letters `kind` with `content`."""
    return struct.pack(">I4s", 8 + len(content), kind) + content


def boxes(data: bytes, name: str) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of the boxes that follow each other in `data`.

    Raises
    ------
    FileFormatError
        A box ends behind the end of `data`; `name` is what the message calls the file.
    """
    position = 0
    while position < len(data):
        header = data[position : position + 16]
        length, kind = struct.unpack(">I4s", header[:8]) if len(header) >= 8 else (-1, b"")
        start = 8
        if length == 1 and len(header) == 16:
            (length,) = struct.unpack(">Q", header[8:])
            start = 16
        elif length == 0:
            length = len(data) - position
        if length < start or position + length > len(data):
            raise FileFormatError(
                f"{name}: damaged file: it ends early, or a box has no valid length; get it again"
            )
        yield kind, data[position + start : position + length]
        position += length


def first_box(data: bytes, kind: bytes, name: str) -> bytes | None:
    """Return the content of the first box of a kind among the boxes in `data`, None if there is none."""
    return next((content for found, content in boxes(data, name) if found == kind), None)
