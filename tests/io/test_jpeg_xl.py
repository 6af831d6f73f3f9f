import imagecodecs
import numpy as np
import pytest

from stereohdr.errors import FileFormatError, StereoHdrWarning
from stereohdr.io.boxes import box, boxes
from stereohdr.io.jpeg_xl import _size, decode_jpeg_xl, encode_jpeg_xl

RNG = np.random.default_rng(10)
SCENE = RNG.lognormal(0, 2, (21, 34, 3)).astype(np.float32)


def test_full_floats_keep_seven_digits_and_white_is_one():
    data = encode_jpeg_xl(SCENE, {"a": (1, 2)}, white=3.0)
    stored = imagecodecs.jpegxl_decode(data)
    assert stored.dtype == np.float32
    np.testing.assert_allclose(stored, SCENE / 3, rtol=2e-7)
    back, attributes = decode_jpeg_xl(data)
    np.testing.assert_allclose(back, SCENE, rtol=3e-7)
    assert attributes == {"a": (1, 2)}


def test_half_floats():
    data = encode_jpeg_xl(SCENE, white=3.0, half=True)
    assert len(data) < 0.7 * len(encode_jpeg_xl(SCENE, white=3.0))
    assert imagecodecs.jpegxl_decode(data).dtype == np.float16
    np.testing.assert_allclose(decode_jpeg_xl(data)[0], SCENE, rtol=2**-10)
    bright = SCENE.copy()
    bright[3, 4] = [3e6, 1.5e6, 0]
    with pytest.warns(StereoHdrWarning, match=r"brighter than 6\.55e\+04 times diffuse white"):
        data = encode_jpeg_xl(bright, white=1.0, half=True)
    np.testing.assert_allclose(decode_jpeg_xl(data)[0][3, 4], [65504, 32752, 0], rtol=1e-3)


def test_full_floats_never_become_infinite():
    huge = np.full((8, 8, 3), 1e30, np.float32)
    with pytest.warns(StereoHdrWarning, match=r"brighter than 1e\+38 times diffuse white"):
        stored = imagecodecs.jpegxl_decode(encode_jpeg_xl(huge, white=1e-20))
    np.testing.assert_allclose(stored, 1e38, rtol=1e-6)
    np.testing.assert_allclose(decode_jpeg_xl(encode_jpeg_xl(huge, white=1e30))[0], huge, rtol=1e-6)


def test_lossy():
    y, x = np.mgrid[:64, :64] / 20
    smooth = (np.exp(x - y)[..., None] * [1.0, 0.8, 0.6]).astype(np.float32)
    data = encode_jpeg_xl(smooth, quality=90)
    assert len(data) < 0.2 * len(encode_jpeg_xl(smooth))
    back = decode_jpeg_xl(data)[0]
    assert back.min() >= 0
    assert np.median(np.abs(back - smooth) / smooth) < 0.03
    assert smooth.max() > 20  # far above diffuse white, and not clipped
    assert back.max() > 0.8 * smooth.max()


@pytest.mark.parametrize(
    "shape",
    [(1, 1), (8, 8), (16, 24), (256, 256), (9, 12), (10, 12), (30, 40), (20, 30), (9, 16), (10, 20), (1, 700)],
)
@pytest.mark.parametrize("channels", [1, 3])
def test_the_size_is_found_in_the_header(shape, channels):
    data = encode_jpeg_xl(np.ones((*shape, channels), np.float32))
    codestream = dict(boxes(data, "a"))[b"jxlc"]
    assert _size(codestream, "a") == shape[::-1]
    assert decode_jpeg_xl(data)[0].shape == (*shape, channels)


def test_files_that_are_not_ours():
    foreign = imagecodecs.jpegxl_encode(SCENE, usecontainer=True)
    for data, message in (
        (foreign, "not written by stereohdr"),
        (imagecodecs.jpegxl_encode(np.zeros((8, 8, 3), np.uint8)), "not written by stereohdr"),
        (b"", "not a JPEG XL image"),
        (b"\xff\xd8\xff", "not a JPEG XL image"),
        (foreign + box(b"xml ", b"<x:xmpmeta/>"), "not written by stereohdr"),
    ):
        with pytest.raises(FileFormatError, match=rf"a\.jxl: .*{message}"):
            decode_jpeg_xl(data, "a.jxl")


def test_a_size_that_the_file_cannot_hold_is_refused():
    data = bytearray(encode_jpeg_xl(SCENE))
    start = data.index(b"jxlc") + 4
    # SizeHeader: not in eights, 30 bits of height, ratio 1:1; lowest bit first.
    header = 0 | 0b11 << 1 | (2**30 - 1) << 3 | 1 << 33
    data[start + 2 : start + 8] = header.to_bytes(6, "little")
    with pytest.raises(FileFormatError, match=r"1073741824x1073741824 pixels, more than the 178 million"):
        decode_jpeg_xl(bytes(data))
