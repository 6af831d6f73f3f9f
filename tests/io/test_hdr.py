import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from stereohdr.errors import FileFormatError, InputError
from stereohdr.io import read_hdr, write_hdr
from stereohdr.io.exr import read_exr
from stereohdr.io.hdr import HDR_SUFFIXES, check_hdr_path

RNG = np.random.default_rng(11)
RGB = RNG.lognormal(0, 3, (9, 13, 3)).astype(np.float32)


@pytest.mark.parametrize("suffix", [*HDR_SUFFIXES, ".EXR", ".Npy"])
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


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_same_input_same_bytes(tmp_path, suffix):
    for name in ("a", "b"):
        write_hdr(tmp_path / (name + suffix), RGB, attributes={"method": "paper"})
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_attributes_go_where_they_can(tmp_path):
    for suffix in HDR_SUFFIXES:
        write_hdr(tmp_path / f"a{suffix}", RGB, attributes={"method": "paper", "ratio": 4.0})
    assert read_exr(tmp_path / "a.exr")[1] == {"method": "paper", "ratio": 4.0}
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


def test_bad_attributes_are_refused_before_the_disk_is_touched(tmp_path):
    with pytest.raises(InputError, match="EXR attribute 'x'"):
        write_hdr(tmp_path / "a.exr", RGB, attributes={"x": None})
    assert list(tmp_path.iterdir()) == []


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
    monkeypatch.setattr(np, "save", fail)
    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(FileFormatError, match=rf"a\{suffix}: cannot be written .*No space left on device"):
        write_hdr(path, RGB)
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


def test_names_that_cannot_be_written_fail_early(tmp_path):
    assert check_hdr_path(tmp_path / "a.HDR") == ".hdr"
    for name in ("a.tif", "a", "a.exr.gz"):
        with pytest.raises(FileFormatError, match=r"not an HDR format; use \.exr, \.hdr, \.pfm, \.npy"):
            check_hdr_path(tmp_path / name)
    with pytest.raises(FileFormatError, match="does not exist; create it first"):
        check_hdr_path(tmp_path / "no" / "a.exr")
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(FileFormatError, match="is a folder"):
        check_hdr_path(tmp_path / "folder.exr")
    with pytest.raises(FileFormatError, match="not an HDR format"):
        write_hdr(tmp_path / "a.jpg", RGB)


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
    with pytest.raises(FileFormatError, match=r"\.jpg is not an HDR format; use \.exr"):
        read_hdr("a.jpg")


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_truncated(tmp_path, suffix):
    write_hdr(tmp_path / f"whole{suffix}", RGB)
    data = (tmp_path / f"whole{suffix}").read_bytes()
    path = tmp_path / f"a{suffix}"
    for length in np.linspace(1, len(data) - 1, 12).astype(int):
        path.write_bytes(data[:length])
        with pytest.raises(FileFormatError, match=rf"a\{suffix}: "):
            read_hdr(path)


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".exr"])
def test_values_that_are_not_finite_are_counted_and_located(tmp_path, suffix):
    from stereohdr.io.exr import write_exr
    from stereohdr.io.pfm import encode_pfm

    image = RGB.copy()
    image[3, 2, 1] = np.nan
    image[8, 0, 0] = np.inf
    path = tmp_path / f"a{suffix}"
    if suffix == ".exr":
        write_exr(path, image)
    elif suffix == ".npy":
        np.save(path, image)
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
    write_hdr(path, RGB)
    whole = path.read_bytes()
    rng = np.random.default_rng(len(suffix))
    refused = 0
    for _ in range(60):
        data = bytearray(whole)
        for position in rng.integers(0, min(len(data), 400), 3):
            data[position] = rng.integers(0, 256)
        path.write_bytes(data)
        try:
            assert np.isfinite(read_hdr(path)).all()
        except FileFormatError:
            refused += 1
    assert refused > 0


def test_import_is_light():
    heavy = "{'PIL', 'OpenEXR', 'tifffile', 'imagecodecs', 'scipy', 'numba'}"
    code = f"import sys, stereohdr.io, stereohdr.tone_mapping; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
