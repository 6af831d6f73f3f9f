import subprocess
import sys
import tracemalloc
import warnings
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from stereohdr.errors import (
    ConfigError,
    FileFormatError,
    InputError,
    MissingDependencyError,
    OutputError,
    StereoHdrWarning,
)
from stereohdr.io import read_hdr, write_hdr
from stereohdr.io.hdr import FORMATS, HDR_SUFFIXES, check_hdr_path, read_hdr_with_attributes

RNG = np.random.default_rng(11)
RGB = RNG.lognormal(0, 3, (9, 13, 3)).astype(np.float32)
SCALED = (".jpg", ".jpeg", ".avif", ".jxl")
"""Formats that store radiance relative to diffuse white; tests of their own say how exactly."""

MILD = (RNG.lognormal(0, 0.4, (9, 13, 1)) * [1.0, 0.8, 0.6]).astype(np.float32)
"""An image that every format holds without a notice."""


@pytest.mark.parametrize("suffix", [*(set(HDR_SUFFIXES) - set(SCALED)), ".EXR", ".Npy"])
@pytest.mark.parametrize(
    "image", [RGB, RGB[..., :1], RGB[..., 0], RGB.astype(np.float64)], ids=["rgb", "grey", "2d", "float64"]
)
def test_round_trip_by_suffix(tmp_path, suffix, image):
    path = tmp_path / f"a{suffix}"
    write_hdr(path, image)
    back = read_hdr(str(path))
    expected = np.float32(image if image.ndim == 3 else image[..., None])
    assert back.dtype == np.float32
    assert back.flags.c_contiguous
    if suffix == ".hdr":
        assert back.shape == (9, 13, 3)
        assert (np.abs(back - expected).max(axis=-1) <= expected.max(axis=-1) / 256).all()
    else:
        np.testing.assert_array_equal(back, expected)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", SCALED)
@pytest.mark.parametrize("scale", [1e-20, 1.0, 1e20])
def test_the_scale_of_radiance_survives_formats_for_display(tmp_path, suffix, scale):
    path = tmp_path / f"a{suffix}"
    image = (MILD * scale).astype(np.float32)
    write_hdr(path, image, attributes={"method": "paper"})
    back, attributes = read_hdr_with_attributes(path)
    assert back.dtype == np.float32
    assert np.median(np.abs(back - image) / image) < 0.03
    assert attributes == {"method": "paper"}


@pytest.mark.parametrize("suffix", SCALED)
def test_grey_images_in_formats_for_display(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_hdr(path, MILD[..., 0])
    back = read_hdr(path)
    assert back.shape == (9, 13, 1 if suffix == ".jxl" else 3)
    assert np.median(np.abs(back / MILD[..., :1] - 1)) < 0.03


@pytest.mark.parametrize("suffix", SCALED)
def test_all_black(tmp_path, suffix):
    write_hdr(tmp_path / f"a{suffix}", np.zeros((5, 6, 3)))
    assert read_hdr(tmp_path / f"a{suffix}").max() < 1e-3


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
@given(
    image=hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 5), st.integers(1, 5), st.sampled_from([1, 3])),
        elements=st.floats(0, width=32, allow_nan=False, allow_infinity=False),
    ),
    data=st.data(),
)
@settings(
    max_examples=30,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    deadline=None,
)
def test_whatever_is_written_is_read_back_finite(tmp_path, suffix, image, data):
    options = {}
    if "white" in FORMATS[suffix].options:
        options["white"] = data.draw(st.sampled_from([None, 1e-30, 1.0, 1e30]))
    if "half" in FORMATS[suffix].options:
        options["half"] = data.draw(st.booleans())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        write_hdr(tmp_path / f"a{suffix}", image, **options)
        back = read_hdr(tmp_path / f"a{suffix}")
    assert back.shape[:2] == image.shape[:2]
    assert np.isfinite(back).all()
    assert back.min() >= 0


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 2, 1), (3, 1, 3)])
def test_tiny_images(tmp_path, suffix, shape):
    write_hdr(tmp_path / f"a{suffix}", np.full(shape, 0.5, np.float32))
    back = read_hdr(tmp_path / f"a{suffix}")
    assert back.shape[:2] == shape[:2]
    np.testing.assert_allclose(back, 0.5, rtol=0.05)


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_same_input_same_bytes(tmp_path, suffix):
    for name in ("a", "b"):
        write_hdr(tmp_path / (name + suffix), MILD, attributes={"method": "paper"})
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_attributes_go_where_they_can(tmp_path):
    attributes = {"method": "paper", "ratio": 4.0, "exposureTimes": (0.5, 0.25), "count": 3}
    for suffix in HDR_SUFFIXES:
        write_hdr(tmp_path / f"a{suffix}", MILD, attributes=attributes)
        back = read_hdr_with_attributes(tmp_path / f"a{suffix}")[1]
        if suffix in (".hdr", ".pfm", ".npy"):
            assert back == {}
        else:
            assert back == attributes
    assert b"\n# method=paper\n# ratio=4.0\n" in (tmp_path / "a.hdr").read_bytes()


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1e-30, 1e300])
def test_bad_values_are_refused_before_the_disk_is_touched(tmp_path, suffix, bad):
    image = RGB.astype(np.float64)
    image[4, 5, 1] = bad
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match=r"1 of 351 values \(first at row 4, column 5, channel 1\)"):
        write_hdr(path, image)
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    "image", [RGB[..., :2], RGB[0, 0], RGB[:0], RGB * 1j, RGB > 0, RGB[None], np.array(["a"])]
)
def test_bad_shapes_and_types_are_refused(tmp_path, image):
    with pytest.raises(InputError, match="radiance must be real numbers of shape"):
        write_hdr(tmp_path / "a.exr", image)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".jpg", ".avif", ".jxl"])
def test_bad_attributes_are_refused_before_the_disk_is_touched(tmp_path, suffix):
    with pytest.raises(InputError, match="attribute 'x'"):
        write_hdr(tmp_path / f"a{suffix}", MILD, attributes={"x": None})
    assert list(tmp_path.iterdir()) == []


def test_what_was_read_can_be_written_in_any_format(tmp_path):
    write_hdr(tmp_path / "a.exr", MILD, attributes={"method": "paper", "list": ["a", "b"]})
    image, attributes = read_hdr_with_attributes(tmp_path / "a.exr")
    for suffix in HDR_SUFFIXES:
        write_hdr(tmp_path / f"b{suffix}", image, attributes=attributes)
        back, same = read_hdr_with_attributes(tmp_path / f"b{suffix}")
        assert np.median(np.abs(back - image) / image) < 0.03
        assert same in (attributes, {})


OPTIONS = {
    "layers": {"a.b": MILD[..., 0]},
    "half": True,
    "white": 2.0,
    "headroom": 3.0,
    "operator": "drago",
    "quality": 90,
    "bits": 12,
}


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
@pytest.mark.parametrize("option", OPTIONS)
def test_options_are_used_or_refused(tmp_path, suffix, option):
    path = tmp_path / f"a{suffix}"
    if option not in FORMATS[suffix].options:
        with pytest.raises(ConfigError, match=rf"files have no option '{option}'; leave it out, or write \."):
            write_hdr(path, MILD, **{option: OPTIONS[option]})
        assert not path.exists()
        return
    more = {"white": MILD.max() / 10} if option == "headroom" else {}  # more stops than the option leaves
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        write_hdr(path, MILD, **{option: OPTIONS[option]}, **more)
    write_hdr(tmp_path / f"b{suffix}", MILD, **more)
    assert path.read_bytes() != (tmp_path / f"b{suffix}").read_bytes()
    assert np.median(np.abs(read_hdr(path) / MILD - 1)) < 0.05


@pytest.mark.parametrize(
    ("suffix", "option", "value", "message"),
    [
        (".jpg", "white", 0, "diffuse white must be a number from"),
        (".avif", "white", float("nan"), "diffuse white must be"),
        (".jxl", "white", 1e31, "diffuse white must be"),
        (".jpg", "headroom", 0.5, "headroom is in stops, from 1 to 16"),
        (".jpg", "operator", "durand", "unknown tone mapping operator"),
        (".jpg", "quality", 0, "quality must be from 1 to 100"),
        (".avif", "quality", 101, "quality must be from 1 to 100"),
        (".jxl", "quality", 0, "quality must be from 1 to 100"),
        (".avif", "bits", 8, "bits must be 10 or 12, got 8"),
    ],
)
def test_options_out_of_range(tmp_path, suffix, option, value, message):
    with pytest.raises(ConfigError, match=message):
        write_hdr(tmp_path / f"a{suffix}", MILD, **{option: value})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("suffix", "peak"), [(".jpg", 16), (".avif", 10_000 / 203)])
def test_pixels_that_are_too_bright_are_darkened_with_their_hue_and_a_notice(tmp_path, suffix, peak):
    image = MILD.copy()
    image[4, 5:8] = [300.0, 200.0, 100.0]
    path = tmp_path / f"a{suffix}"
    with pytest.warns(StereoHdrWarning, match=rf"a\{suffix}: 2\.56 % of the pixels are brighter than"):
        write_hdr(path, image, white=1.0, quality=100)
    np.testing.assert_allclose(read_hdr(path)[4, 6], peak * np.array([1, 2 / 3, 1 / 3]), rtol=0.05)
    write_hdr(path, image, white=300.0, quality=100)  # a larger white keeps it
    np.testing.assert_allclose(read_hdr(path)[4, 6], image[4, 6], rtol=0.05)


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_a_writer_that_fails_leaves_the_old_file(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")

    def fail(target, *arguments, **options):
        with open(target, "wb") if isinstance(target, Path) else target as file:
            file.write(b"half")
        raise OSError(28, "No space left on device")

    class FailingFile:
        def __init__(self, header, channels):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def write(self, path):
            Path(path).open("wb").close()
            raise RuntimeError("No space left on device")

    monkeypatch.setattr(OpenEXR, "File", FailingFile)
    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(OutputError, match=rf"a\{suffix}: cannot be written .*No space left on device"):
        write_hdr(path, MILD)
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


def test_names_that_cannot_be_written_fail_early(tmp_path):
    assert check_hdr_path(tmp_path / "a.HDR") == ".hdr"
    for name in ("a.png", "a", "a.exr.gz"):
        with pytest.raises(FileFormatError, match=r"not an HDR format; use \.exr, \.hdr, .*, \.avif, \.jxl$"):
            check_hdr_path(tmp_path / name)
    with pytest.raises(FileFormatError, match="does not exist; create it first"):
        check_hdr_path(tmp_path / "no" / "a.exr")
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(FileFormatError, match="is a folder"):
        check_hdr_path(tmp_path / "folder.exr")
    with pytest.raises(FileFormatError, match="not an HDR format"):
        write_hdr(tmp_path / "a.bmp", RGB)


@pytest.mark.parametrize(("suffix", "codec", "name"), [(".avif", "AVIF", "AVIF"), (".jxl", "JPEGXL", "JPEG XL")])
def test_builds_without_a_codec_say_so_early(tmp_path, monkeypatch, suffix, codec, name):
    write_hdr(tmp_path / f"a{suffix}", MILD)
    monkeypatch.setattr(getattr(imagecodecs, codec), "available", False)
    message = f"this build of imagecodecs has no {name}; install"
    with pytest.raises(MissingDependencyError, match=message):
        check_hdr_path(tmp_path / f"b{suffix}")
    with pytest.raises(MissingDependencyError, match=message):
        read_hdr(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_files_that_cannot_be_read(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    with pytest.raises(FileFormatError, match="no such file"):
        read_hdr(path)
    path.mkdir()
    with pytest.raises(FileFormatError, match="is a folder"):
        read_hdr(path)
    path.rmdir()
    for content in (b"", b"\0", b"just some text\n", b"\x93NUMPY\1\0"):
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=rf"a\{suffix}: .*; get "):
            read_hdr(path)


def test_unknown_suffix():
    with pytest.raises(FileFormatError, match=r"\.png is not an HDR format; use \.exr"):
        read_hdr("a.png")


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_truncated(tmp_path, suffix):
    write_hdr(tmp_path / f"whole{suffix}", MILD)
    data = (tmp_path / f"whole{suffix}").read_bytes()
    path = tmp_path / f"a{suffix}"
    for length in np.linspace(1, len(data) - 1, 12).astype(int):
        path.write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=rf"a\{suffix}: "):
            read_hdr(path)


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".exr", ".tif"])
def test_values_that_are_not_finite_are_counted_and_located(tmp_path, suffix):
    from stereohdr.io.exr import write_exr
    from stereohdr.io.pfm import encode_pfm
    from stereohdr.io.tiff import encode_tiff

    image = RGB.copy()
    image[3, 2, 1] = np.nan
    image[8, 0, 0] = np.inf
    path = tmp_path / f"a{suffix}"
    if suffix == ".exr":
        write_exr(path, image)
    elif suffix == ".npy":
        np.save(path, image)
    elif suffix == ".tif":
        path.write_bytes(encode_tiff(image))
    else:
        path.write_bytes(encode_pfm(image))
    with pytest.raises(FileFormatError, match=r"2 of 351 values \(first at row 3, column 2, channel 1\)"):
        read_hdr(path)


def test_absurd_exposure_does_not_give_infinity(tmp_path):
    path = tmp_path / "a.hdr"
    path.write_bytes(b"#?RADIANCE\nEXPOSURE=1e-30\n\n-Y 1 +X 1\n\xff\xff\xff\xff")
    with pytest.raises(FileFormatError, match="NaN or infinite"):
        read_hdr(path)


@pytest.mark.parametrize("dtype", ["f2", "f4", ">f8", "u1", "<i8", ">u2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_numpy_files_of_other_types(tmp_path, dtype, order):
    image = RNG.integers(0, 100, (4, 5, 3)).astype(dtype)
    np.save(tmp_path / "a.npy", np.asarray(image, order=order))
    back = read_hdr(tmp_path / "a.npy")
    np.testing.assert_array_equal(back, image.astype(np.float32))
    assert back.flags.c_contiguous
    np.save(tmp_path / "b.npy", np.asarray(image[..., 0], order=order))
    assert read_hdr(tmp_path / "b.npy").shape == (4, 5, 1)


@pytest.mark.parametrize(
    "array",
    [np.zeros((2, 2), complex), np.zeros((2, 2), bool), np.zeros((2, 2, 4)), np.zeros(3), np.zeros((2, 2), "S3")],
)
def test_numpy_files_that_are_no_images(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(FileFormatError, match=r"a\.npy: expected numbers of shape"):
        read_hdr(tmp_path / "a.npy")


def test_pickles_and_archives_are_never_opened(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[{"a": 1}]], dtype=object), allow_pickle=True)
    with pytest.raises(FileFormatError, match="not a readable NumPy file"):
        read_hdr(tmp_path / "a.npy")
    np.savez(tmp_path / "b.npz", RGB)
    (tmp_path / "b.npz").rename(tmp_path / "b.npy")
    with pytest.raises(FileFormatError, match="found an archive"):
        read_hdr(tmp_path / "b.npy")


def test_numpy_header_that_lies_about_its_size(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((4, 5)))
    data = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(data.replace(b"(4, 5), }        ", b"(4000, 50000), }  "))
    tracemalloc.start()
    try:
        with pytest.raises(FileFormatError, match="not a readable NumPy file"):
            read_hdr(tmp_path / "a.npy")
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_flipped_bytes_never_escape_as_another_error(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_hdr(path, MILD, attributes={"method": "paper"})
    whole = path.read_bytes()
    rng = np.random.default_rng(len(suffix))
    refused = 0
    for limit in [400] * 60 + [len(whole)] * 60:
        data = bytearray(whole)
        for position in rng.integers(0, min(len(data), limit), 3):
            data[position] = rng.integers(0, 256)
        path.write_bytes(data)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", StereoHdrWarning)  # other primaries, an alpha channel, ...
                assert np.isfinite(read_hdr(path)).all()
        except FileFormatError:
            refused += 1
    assert refused > 0


def test_import_is_light():
    heavy = "{'PIL', 'OpenEXR', 'tifffile', 'imagecodecs', 'scipy', 'numba'}"
    code = f"import sys, stereohdr.io, stereohdr.tone_mapping; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
