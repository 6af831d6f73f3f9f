import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from stereohdr.errors import FileFormatError
from stereohdr.io.radiance_hdr import LARGEST_VALUE, decode_radiance_hdr, encode_radiance_hdr


def picture(pixels, width, height=1, header=b"FORMAT=32-bit_rle_rgbe\n", resolution=b"-Y %d +X %d\n"):
    return b"#?RADIANCE\n" + header + b"\n" + resolution % (height, width) + pixels


def value(r, g, b, e):
    return [math.ldexp(m, e - 136) for m in (r, g, b)]


# --- reading ----------------------------------------------------------------------------------------------------


def test_flat_pixels_by_hand():
    image = decode_radiance_hdr(picture(bytes((128, 64, 32, 129, 255, 0, 1, 120, 9, 9, 9, 0)), 3))
    assert image.dtype == np.float32
    np.testing.assert_array_equal(image, [[[1.0, 0.5, 0.25], value(255, 0, 1, 120), [0, 0, 0]]])


def test_new_runs_by_hand():
    scan = bytes((2, 2, 0, 10))
    scan += bytes((128 + 10, 200))  # red: one run of 10
    scan += bytes((10, *range(100, 110)))  # green: ten literals
    scan += bytes((3, 1, 2, 3, 128 + 4, 7, 3, 4, 5, 6))  # blue: literals, run, literals
    scan += bytes((128 + 5, 128, 128 + 5, 129))  # exponent: two runs
    blue = [1, 2, 3, 7, 7, 7, 7, 4, 5, 6]
    expected = [value(200, 100 + x, blue[x], 128 if x < 5 else 129) for x in range(10)]
    np.testing.assert_array_equal(decode_radiance_hdr(picture(scan * 2, 10, 2)), [expected, expected])


def test_old_runs_by_hand():
    scan = bytes((200, 100, 50, 128)) + bytes((1, 1, 1, 3)) + bytes((10, 20, 200, 130)) + bytes((1, 1, 1, 1))
    first, second = value(200, 100, 50, 128), value(10, 20, 200, 130)
    expected = [first] * 4 + [second] * 2
    np.testing.assert_array_equal(decode_radiance_hdr(picture(scan * 2, 6, 2)), [expected, expected])


def test_old_runs_that_follow_each_other_are_one_number():
    # 1 pixel + 0x0204 = 516 repeats + 1 pixel
    scan = bytes((200, 100, 50, 128, 1, 1, 1, 0x04, 1, 1, 1, 0x02, 130, 140, 150, 128))
    image = decode_radiance_hdr(picture(scan, 518))
    np.testing.assert_array_equal(image[0, :517], np.tile(np.float32(value(200, 100, 50, 128)), (517, 1)))
    np.testing.assert_array_equal(image[0, 517], value(130, 140, 150, 128))


def test_old_runs_equal_a_slow_reader():
    """Decode random old-style scan lines as ``oldreadcolrs`` of Radiance does, pixel by pixel."""
    rng = np.random.default_rng(5)
    for width in (1, 2, 7, 20, 300, 3000):
        records, pixels = [], []
        while len(pixels) < width:
            pixel = tuple(rng.integers(2, 256, 4).tolist())
            records.append(pixel)
            pixels.append(pixel)
            count = int(rng.choice([0, 0, 1, 3, 255, 256, 300]))
            if len(pixels) + count <= width:
                records += [
                    (1, 1, 1, byte) for byte in count.to_bytes(2, "little")[: (count.bit_length() + 7) // 8]
                ]
                pixels += [pixel] * count
        image = decode_radiance_hdr(picture(bytes(sum(records, ())), width))
        np.testing.assert_array_equal(image[0], np.float32([value(*p) for p in pixels]))


def test_exposure_lines_are_divided_out():
    pixel = bytes((128, 128, 128, 129))  # 1.0
    header = b"FORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE= 4.0\nCOLORCORR=1 2 0.5\n"
    image = decode_radiance_hdr(picture(pixel, 1, header=header))
    np.testing.assert_array_equal(image, [[[0.125, 0.0625, 0.25]]])
    assert image.dtype == np.float32


def test_lines_that_mean_nothing_here_are_skipped():
    header = b"# EXPOSURE=9\nSOFTWARE=x\npfilt -x 1\nFORMAT=32-bit_rle_rgbe\r\nPIXASPECT=1\n"
    assert decode_radiance_hdr(picture(bytes((128, 0, 0, 129)), 1, header=header))[0, 0, 0] == 1.0
    assert decode_radiance_hdr(picture(bytes((128, 0, 0, 129)), 1, header=b""))[0, 0, 0] == 1.0


PIXELS = bytes((128, 64, 32, 129)) * 12


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (picture(PIXELS, 1, header=b"FORMAT=32-bit_rle_xyze\n"), "'32-bit_rle_xyze' are not supported; convert"),
        (picture(PIXELS, 1, resolution=b"+Y %d +X %d\n"), "turn it to '-Y H [+]X W'"),
        (picture(PIXELS, 1, resolution=b"+X %d -Y %d\n"), "stored as '[+]X 1 -Y 1'"),
        (picture(PIXELS, 1, resolution=b"%d %d\n"), "no resolution line"),
        (picture(PIXELS, 0), "0x1 pixels"),
        (picture(PIXELS, 1, header=b"EXPOSURE=0\n"), "its header says 'EXPOSURE=0'"),
        (picture(PIXELS, 1, header=b"EXPOSURE=abc\n"), "its header says"),
        (picture(PIXELS, 1, header=b"EXPOSURE=nan\n"), "its header says"),
        (picture(PIXELS, 1, header=b"EXPOSURE=1e200\n" * 2), "no finite product"),
        (picture(PIXELS, 1, header=b"COLORCORR=1 2\n"), "its header says"),
        (b"P6 1 1 255\n", "does not start with #[?]"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "its header has no end"),
        (picture(b"", 999999999, 999999999), "more than the 178 million"),
        (picture(PIXELS, 20000, 8000), "it claims 20000x8000 pixels in"),
        (picture(bytes((2, 2, 0, 10, 138, 1, 11)) + PIXELS, 10), "a run leaves its scan line"),
        (picture(bytes((2, 2, 0, 10, 139, 1)) + PIXELS, 10), "a run leaves its scan line"),
        (picture(bytes((2, 2, 0, 10, 0, 1)) + PIXELS, 10), "a run has length 0"),
        (picture(bytes((1, 1, 1, 9)) + PIXELS, 10), "starts with a repeat count"),
        (picture(bytes((9, 9, 9, 9, 1, 1, 1, 10)), 10), "a run leaves its scan line"),
        (picture(bytes((9, 9, 9, 9, 1, 1, 1, 8)), 10), "it ends early"),
        (picture(bytes((9, 9, 9, 9)) + bytes((1, 1, 1, 255)) * 8, 10), "a run leaves its scan line"),
    ],
)
def test_wrong_files(data, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        decode_radiance_hdr(data, "a.hdr")
    assert str(caught.value).startswith("a.hdr: ")
    assert "; " in str(caught.value)


@pytest.mark.parametrize("width", [5, 40])
def test_every_truncation(width):
    rng = np.random.default_rng(1)
    data = encode_radiance_hdr(rng.lognormal(size=(3, width, 3)).astype(np.float32))
    for length in range(len(data)):
        with pytest.raises(FileFormatError):
            decode_radiance_hdr(data[:length])


# --- writing ----------------------------------------------------------------------------------------------------

images = hnp.arrays(
    np.float32,
    st.tuples(st.integers(1, 4), st.sampled_from([1, 3, 7, 8, 9, 40]), st.sampled_from([1, 3])),
    elements=st.one_of(
        st.floats(0, 2.0**126, width=32), st.sampled_from([0.0, 1.0, 0.998046875, 0.99999994, 3.0])
    ),
)


@given(images)
def test_round_trip_error_is_at_most_half_a_step_of_the_largest_channel(image):
    decoded = decode_radiance_hdr(encode_radiance_hdr(image)).astype(np.float64)
    expected = np.broadcast_to(image, decoded.shape).astype(np.float64)
    largest = expected.max(axis=-1, keepdims=True)
    error = np.abs(decoded - expected)
    assert (error <= np.where(largest < 2.0**-127, 2.0**-127, largest / 256)).all()


@given(images)
def test_what_was_read_is_written_back_unchanged(image):
    once = decode_radiance_hdr(encode_radiance_hdr(image))
    np.testing.assert_array_equal(decode_radiance_hdr(encode_radiance_hdr(once)), once)


@pytest.mark.parametrize("width", [7, 8, 127, 128, 129, 300, 1000])
def test_long_and_short_runs(width):
    rng = np.random.default_rng(width)
    lengths = rng.choice([1, 2, 3, 4, 5, 127, 128, 129, 260], size=width)
    row = np.repeat(rng.integers(128, 256, width), lengths)[:width].astype(np.float32)
    noise = np.arange(width, dtype=np.float32) % 128 + 128
    image = np.stack([row, np.full(width, 255.0, np.float32), noise], axis=-1)[None]
    np.testing.assert_array_equal(decode_radiance_hdr(encode_radiance_hdr(image)), image)


def test_constant_picture_is_packed():
    data = encode_radiance_hdr(np.full((10, 1270, 3), 0.7, np.float32))
    assert len(data) < 150 + 10 * (4 + 4 * 2 * 10)


def test_rounding_up_to_the_next_power_of_two():
    image = np.full((1, 1, 3), np.nextafter(np.float32(1), np.float32(0)))
    assert encode_radiance_hdr(image)[-4:] == bytes((128, 128, 128, 129))


def test_values_that_rgbe_cannot_hold():
    tiny = [2.0**-128, 2.0**-129, 1e-45]
    image = np.array([[[3.4e38, 1.0, 0.0], *([x, 0, 0] for x in tiny)]], np.float32)
    decoded = decode_radiance_hdr(encode_radiance_hdr(image))
    np.testing.assert_array_equal(decoded[0, :, 0], np.float32([LARGEST_VALUE, 2.0**-128, 0, 0]))
    assert not decoded[..., 1:].any()


def test_a_width_too_large_for_runs():
    image = np.arange(1, 32769, dtype=np.float32)[None, :, None]
    data = encode_radiance_hdr(image)
    assert len(data.split(b"+X 32768\n", 1)[1]) == 4 * 32768
    decoded = decode_radiance_hdr(data)
    assert decoded.shape == (1, 32768, 3)
    np.testing.assert_allclose(decoded, np.broadcast_to(image, decoded.shape), rtol=1 / 256)


def test_attributes_become_comments_that_cannot_break_the_header():
    attributes = {"method": "paper", "evil": "a\n\nEXPOSURE=5\r\n", "name": "Zoë", "ratio": 4.0}
    data = encode_radiance_hdr(np.ones((1, 1, 3), np.float32), attributes)
    lines = data.split(b"\n\n")[0].split(b"\n")
    assert lines[1:5] == [b"# method=paper", b"# evil=a EXPOSURE=5", rb"# name=Zo\xeb", b"# ratio=4.0"]
    assert decode_radiance_hdr(data)[0, 0, 0] == 1.0


def test_opencv_reads_the_same_values(tmp_path):
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(3)
    for width in (5, 50):
        image = rng.lognormal(0, 3, (6, width, 3)).astype(np.float32)
        image[2] = 0.5
        path = tmp_path / f"{width}.hdr"
        path.write_bytes(encode_radiance_hdr(image))
        theirs = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
        np.testing.assert_array_equal(decode_radiance_hdr(path.read_bytes()), theirs)
        assert cv2.imwrite(str(path), np.ascontiguousarray(image[..., ::-1]))
        theirs = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
        np.testing.assert_array_equal(decode_radiance_hdr(path.read_bytes()), theirs)
