import numpy as np
import pytest
import tifffile

from stereohdr.errors import FileFormatError, StereoHdrWarning
from stereohdr.io.tiff import encode_tiff, read_tiff

RNG = np.random.default_rng(2)
RGB = RNG.lognormal(0, 3, (70, 21, 3)).astype(np.float32)


def write(path, image, **options):
    tifffile.imwrite(path, image, **options)
    return path


@pytest.mark.parametrize("image", [RGB, RGB[..., :1], RGB[:1, :1]], ids=["rgb", "grey", "1x1"])
def test_round_trip_keeps_every_bit(tmp_path, image):
    path = tmp_path / "a.tif"
    path.write_bytes(encode_tiff(image, {"method": "paper", "software": "ünicode"}))
    back, attributes = read_tiff(path)
    np.testing.assert_array_equal(back, image)
    assert attributes == {"method": "paper", "software": "ünicode"}
    with tifffile.TiffFile(path) as file:
        assert len(file.pages) == 1
        assert "DateTime" not in file.pages.first.tags  # same input, same bytes


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("compression", [None, "zlib", "lzw"])
def test_files_of_other_programs(tmp_path, dtype, compression):
    image = RGB.clip(1e-3, 1e4).astype(dtype)
    path = write(tmp_path / "a.tif", image, photometric="rgb", compression=compression, tile=(16, 16))
    back, attributes = read_tiff(path)
    np.testing.assert_array_equal(back, image.astype(np.float32))
    assert attributes == {}
    planar = write(tmp_path / "b.tif", np.moveaxis(image, -1, 0), photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(read_tiff(planar)[0], back)


def test_alpha_is_dropped_with_a_notice(tmp_path):
    image = np.concatenate([RGB, RGB[..., :1]], axis=2)
    path = write(tmp_path / "a.tif", image, photometric="rgb", extrasamples=["unassalpha"])
    with pytest.warns(StereoHdrWarning, match="alpha channel was dropped"):
        np.testing.assert_array_equal(read_tiff(path)[0], RGB)


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (np.zeros((4, 5, 3), np.uint16), {"photometric": "rgb"}, "holds uint16 codes, not radiance"),
        (np.zeros((4, 5, 5), np.float32), {"photometric": "minisblack", "planarconfig": "contig"}, "5 channel"),
        (np.zeros((4, 5), np.complex64), {}, "holds complex64 codes"),
    ],
)
def test_other_tiffs_are_refused(tmp_path, image, options, message):
    with pytest.raises(FileFormatError, match=message):
        read_tiff(write(tmp_path / "a.tif", image, **options))


def test_further_pages_are_left_with_a_notice(tmp_path):
    path = write(tmp_path / "a.tif", RGB[:20, :5, 0].reshape(4, 5, 5), photometric="minisblack")
    with pytest.warns(StereoHdrWarning, match="only the first of its 4 pages was read"):
        assert read_tiff(path)[0].shape == (5, 5, 1)


def test_missing_strips_are_damage(tmp_path):
    path = write(tmp_path / "a.tif", RGB, photometric="rgb", rowsperstrip=10)
    with tifffile.TiffFile(path, mode="r+") as file:
        counts = file.pages.first.tags["StripByteCounts"]
        counts.overwrite([0, *counts.value[1:]])
    with pytest.raises(FileFormatError, match="1 of its strips or tiles are missing"):
        read_tiff(path)


def test_a_header_that_promises_too_much(tmp_path):
    path = write(tmp_path / "a.tif", RGB, photometric="rgb")
    with tifffile.TiffFile(path, mode="r+") as file:
        file.pages.first.tags["ImageWidth"].overwrite(100_000_000)
    with pytest.raises(FileFormatError, match="million that are accepted"):
        read_tiff(path)
