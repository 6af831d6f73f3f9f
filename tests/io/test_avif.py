import struct

import imagecodecs
import numpy as np
import pytest

from stereohdr.errors import FileFormatError, InputError
from stereohdr.io.avif import XMP_UUID, decode_avif, encode_avif
from stereohdr.io.boxes import box, boxes, first_box

RNG = np.random.default_rng(9)
SMOOTH = np.exp(np.add.outer(np.linspace(-3, 2, 60), np.linspace(0, 2.5, 90)))[..., None]
SCENE = (SMOOTH * [1.0, 0.7, 0.5] * RNG.uniform(0.9, 1.1, (60, 90, 1))).astype(np.float32)
WHITE = 2.0

PQ_OF_203 = 0.5806888810416109
"""ST 2084 code of 203 cd/m²."""


def properties_of(data):
    meta = first_box(data, b"meta", "a")
    return first_box(first_box(meta[4:], b"iprp", "a"), b"ipco", "a")


@pytest.mark.parametrize("quality", [95, 100])
def test_tags(quality):
    data = encode_avif(SCENE, white=WHITE, quality=quality)
    assert data[4:12] == b"ftypavif"
    (nclx,) = [content for kind, content in boxes(properties_of(data), "a") if kind == b"colr"]
    primaries, transfer, matrix, full_range = struct.unpack(">4xHHHB", nclx)
    assert (primaries, transfer, matrix) == (
        9,
        16,
        0 if quality == 100 else 9,
    )  # H.273: BT.2020, PQ, RGB or BT.2020
    assert full_range == 0x80
    assert first_box(properties_of(data), b"ispe", "a") == struct.pack(">III", 0, 90, 60)


@pytest.mark.parametrize("bits", [10, 12])
def test_diffuse_white_is_203_candela(bits):
    image = np.full((16, 16, 3), WHITE, np.float32)
    codes = imagecodecs.avif_decode(encode_avif(image, white=WHITE, bits=bits, quality=100))
    assert codes.dtype == np.uint16
    assert (codes == round(PQ_OF_203 * (2**bits - 1))).all()


@pytest.mark.parametrize(("bits", "error"), [(10, 0.008), (12, 0.002)])
def test_lossless_files_keep_radiance_to_the_step_of_pq(bits, error):
    back, attributes = decode_avif(encode_avif(SCENE, {"a": 1}, white=WHITE, bits=bits, quality=100))
    assert np.median(np.abs(back - SCENE) / SCENE) < error / 2
    assert np.percentile(np.abs(back - SCENE) / SCENE, 99) < 3 * error
    assert attributes == {"a": 1}


def test_colours_outside_of_bt709_are_clipped_not_negative():
    green = np.zeros((8, 8, 3), np.uint16)
    green[..., 1] = 500
    data = imagecodecs.avif_encode(
        green, bitspersample=10, pixelformat="yuv444", primaries=9, transfer=16, matrix=0
    )
    image, attributes = decode_avif(data)
    assert image.min() == 0
    assert image[..., 1].min() > 0.3
    assert attributes == {}


def test_bt709_primaries_and_grey_of_other_programs():
    codes = np.full((8, 8, 3), round(PQ_OF_203 * 1023), np.uint16)
    data = imagecodecs.avif_encode(
        codes, bitspersample=10, pixelformat="yuv444", primaries=1, transfer=16, matrix=0
    )
    np.testing.assert_allclose(decode_avif(data)[0], 1, rtol=0.01)
    grey = imagecodecs.avif_encode(codes[..., 0], bitspersample=10, primaries=9, transfer=16, matrix=9)
    image = decode_avif(grey)[0]
    assert image.shape == (8, 8, 1)
    np.testing.assert_allclose(image, 1, rtol=0.01)


def test_other_transfer_functions_are_refused():
    codes = np.full((8, 8, 3), 500, np.uint16)
    data = imagecodecs.avif_encode(codes, bitspersample=10, primaries=1, transfer=13, matrix=0)
    with pytest.raises(FileFormatError, match=r"this one has transfer 13 and primaries 1 of H\.273"):
        decode_avif(data, "a.avif")


@pytest.mark.parametrize("data", [b"", b"\0\0\0\x08ftyp", b"\x89PNG\r\n\x1a\n", box(b"ftyp", b"avif") * 2])
def test_other_files_are_refused(data):
    with pytest.raises(FileFormatError, match=r"a\.avif: not an AVIF image"):
        decode_avif(data, "a.avif")


def test_a_size_that_the_file_cannot_hold_is_refused():
    data = encode_avif(SCENE, white=WHITE)
    lie = data.replace(struct.pack(">II", 90, 60), struct.pack(">II", 90_000, 60_000))
    with pytest.raises(FileFormatError, match="million that are accepted"):
        decode_avif(lie)


def test_xmp_is_a_box_that_readers_skip():
    data = encode_avif(SCENE, {"software": "me"}, white=WHITE)
    (uuid,) = [content for kind, content in boxes(data, "a") if kind == b"uuid"]
    assert uuid.startswith(XMP_UUID)
    assert b"<xmp:CreatorTool>me</xmp:CreatorTool>" in uuid
    without = b"".join(box(kind, content) for kind, content in boxes(data, "a") if kind != b"uuid")
    np.testing.assert_array_equal(imagecodecs.avif_decode(data), imagecodecs.avif_decode(without))
    np.testing.assert_allclose(decode_avif(without)[0] * WHITE, decode_avif(data)[0], rtol=1e-6)


def test_too_large():
    with pytest.raises(InputError, match="at most 65535 pixels a side"):
        encode_avif(np.ones((1, 65_536, 1), np.float32))
