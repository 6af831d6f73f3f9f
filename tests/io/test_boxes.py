import struct

import pytest

from stereohdr.errors import FileFormatError
from stereohdr.io.boxes import box, boxes, first_box


def test_boxes_come_back_in_order():
    data = box(b"ftyp", b"avif") + box(b"free", b"") + box(b"mdat", b"x" * 300)
    assert list(boxes(data, "a")) == [(b"ftyp", b"avif"), (b"free", b""), (b"mdat", b"x" * 300)]
    assert first_box(data, b"mdat", "a") == b"x" * 300
    assert first_box(data, b"moov", "a") is None
    assert list(boxes(b"", "a")) == []


def test_long_and_open_lengths():
    long = struct.pack(">I4sQ", 1, b"mdat", 16 + 5) + b"12345"
    to_the_end = struct.pack(">I4s", 0, b"free") + b"rest"
    assert list(boxes(long + to_the_end, "a")) == [(b"mdat", b"12345"), (b"free", b"rest")]


@pytest.mark.parametrize(
    "data",
    [
        b"\0\0\0",
        box(b"ftyp", b"avif")[:-1],
        box(b"ftyp", b"avif") + b"\0",
        struct.pack(">I4s", 7, b"ftyp"),
        struct.pack(">I4sQ", 1, b"mdat", 15),
        struct.pack(">I4s", 1, b"mdat"),
        struct.pack(">I4sQ", 1, b"mdat", 2**63),
    ],
)
def test_broken_lengths(data):
    with pytest.raises(FileFormatError, match="x: damaged file"):
        list(boxes(data, "x"))
