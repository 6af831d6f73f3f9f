import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from stereohdr.errors import FileFormatError
from stereohdr.io.pfm import decode_pfm, encode_pfm


def test_colour_by_hand_bottom_row_first():
    bottom, top = (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)
    for order, scale in (("<", "-1.0"), (">", "1.0"), (">", "+2.5e0"), ("<", "-0.003922")):
        data = f"PF\n1 2\n{scale}\n".encode() + struct.pack(f"{order}6f", *bottom, *top)
        image = decode_pfm(data)
        assert image.dtype == np.float32
        assert image.dtype.isnative
        np.testing.assert_array_equal(image, [[top], [bottom]])


def test_grey_by_hand_and_other_white_space():
    data = b"Pf 3 1\r-1 " + struct.pack("<3f", 7.0, 8.0, 9.0)
    np.testing.assert_array_equal(decode_pfm(data), [[[7.0], [8.0], [9.0]]])


def test_pixels_that_look_like_white_space_belong_to_the_image():
    data = b"Pf\n1 1\n-1.0\n" + b"\n\n\n\n"
    assert decode_pfm(data).tobytes() == b"\n\n\n\n"


def test_written_bytes():
    image = np.array([[[1.0], [2.0]], [[3.0], [4.0]]], np.float32)
    assert encode_pfm(image) == b"Pf\n2 2\n-1.0\n" + struct.pack("<4f", 3.0, 4.0, 1.0, 2.0)


@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3])),
        elements=st.floats(width=32),
    )
)
def test_round_trip_keeps_every_bit(image):
    np.testing.assert_array_equal(decode_pfm(encode_pfm(image)), image)


WHOLE = encode_pfm(np.ones((4, 5, 3), np.float32))


@pytest.mark.parametrize("length", [0, 1, 3, 5, 8, 11, 12, 100, len(WHOLE) - 1])
def test_truncated(length):
    with pytest.raises(FileFormatError, match=r"^a\.pfm: .*; get the file again"):
        decode_pfm(WHOLE[:length], "a.pfm")


@pytest.mark.parametrize(
    "header",
    [
        b"PF\n999999999 999999999\n-1\n",
        b"some text",
        b"P6\n1 1\n-1.0\n",
        b"PF4\n1 1\n-1\n",
        b"PF\n0 1\n-1\n",
        b"PF\n1 0\n-1\n",
        b"PF\n-1 1\n-1\n",
        b"PF\n1 1\n0\n",
        b"PF\n1 1\n1e999\n",
        b"PF\n1 1\n--1\n",
        b"PF\n1 1\nnan\n",
    ],
)
def test_wrong_headers(header):
    with pytest.raises(FileFormatError, match="get the file again"):
        decode_pfm(header + b"\0" * 64)
