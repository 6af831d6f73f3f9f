"""What `read_photo` does beyond decoding: mosaics, pedestals, arrays, profiles, cameras, conflicts."""

import imagecodecs
import numpy as np
import pytest
import tifffile
from camera_files import bayer_mosaic, write_bayer_tiff
from PIL import Image, ImageCms

from stereohdr.errors import ConfigError, FileFormatError, InputError, StereoHdrWarning
from stereohdr.io import read_photo
from stereohdr.io.metadata import camera_from_tags, image_kind, profile_name

PATTERN_CODES = {"RGGB": b"\0\1\1\2", "BGGR": b"\2\1\1\0", "GRBG": b"\1\0\2\1", "GBRG": b"\1\2\0\1"}


def colour(values=(300, 800, 500), height=8, width=10):
    return np.tile(np.array(values, np.uint16), (height, width, 1))


def write_png(path, codes):
    path.write_bytes(imagecodecs.png_encode(np.asarray(codes)))
    return path


# --- mosaics and pedestals --------------------------------------------------------------------------------------


@pytest.mark.parametrize("pattern", PATTERN_CODES)
def test_a_png_mosaic_with_a_pedestal_of_twelve_bits(tmp_path, pattern):
    mosaic = bayer_mosaic(colour(), pattern) + np.uint16(60)
    mosaic[7, 9] = 4095
    path = write_png(tmp_path / "m.png", mosaic)
    photo = read_photo(path, bayer=pattern.lower(), black_level=60, white_level=4095)
    assert photo.white == 4035
    np.testing.assert_array_equal(photo.codes[:5, :7], colour(height=5, width=7))
    assert (photo.codes[7, 9] == 4035).sum() == 1


def test_samples_above_the_white_level_are_clipped_before_they_spread(tmp_path):
    mosaic = bayer_mosaic(colour(), "RGGB")
    mosaic[4, 4] = 60000
    photo = read_photo(write_png(tmp_path / "m.png", mosaic), bayer="RGGB", white_level=4095)
    assert (photo.codes[3:6, 3:6, 0] == 4095).all()
    assert (photo.codes == 4095).any(axis=-1).sum() == 9


@pytest.mark.parametrize(("pattern", "codes"), PATTERN_CODES.items())
def test_a_tiff_mosaic_states_its_pattern(tmp_path, pattern, codes):
    path = write_bayer_tiff(tmp_path / "m.tif", bayer_mosaic(colour(), pattern), codes)
    np.testing.assert_array_equal(read_photo(path).codes, colour())
    np.testing.assert_array_equal(read_photo(path, bayer=pattern).codes, colour())


def test_a_given_pattern_wins_over_the_stated_one(tmp_path):
    path = write_bayer_tiff(tmp_path / "m.tif", bayer_mosaic(colour(), "RGGB"), PATTERN_CODES["BGGR"])
    with pytest.warns(StereoHdrWarning, match="pattern RGGB is given, the file states BGGR; RGGB is used"):
        photo = read_photo(path, bayer="RGGB")
    np.testing.assert_array_equal(photo.codes, colour())


@pytest.mark.parametrize(
    ("codes", "repeat"),
    [(None, None), (b"\3\5\1\4", (2, 2)), (b"\0\1\2\0\1\2\0\1\2", (3, 3)), (b"\0\0\1\2", (2, 2))],
)
def test_an_unknown_pattern_is_asked_for(tmp_path, codes, repeat):
    path = write_bayer_tiff(tmp_path / "m.tif", bayer_mosaic(colour(), "GRBG"), codes, repeat=repeat)
    with pytest.raises(FileFormatError, match=r"m\.tif: holds a sensor mosaic of unknown pattern; .*--bayer RGGB"):
        read_photo(path)
    np.testing.assert_array_equal(read_photo(path, bayer="GRBG").codes, colour())


def test_patterns_that_cannot_be(tmp_path):
    path = write_png(tmp_path / "c.png", colour())
    with pytest.raises(InputError, match=r"c\.png: is in colour already"):
        read_photo(path, bayer="RGGB")
    with pytest.raises(ConfigError, match="'RGBG' is not a Bayer pattern"):
        read_photo(path, bayer="RGBG")


def test_a_pedestal_is_taken_off_colour_images_too(tmp_path):
    codes = colour((10, 200, 255)).astype(np.uint8)
    photo = read_photo(write_png(tmp_path / "c.png", codes), black_level=16)
    assert photo.codes[0, 0].tolist() == [0, 184, 239]
    assert photo.white == 239


@pytest.mark.parametrize(("black", "white"), [(-1, None), (254, None), (4093, 4095), (5000, 4095)])
def test_black_levels_that_cannot_be(tmp_path, black, white):
    codes = colour() if white else colour((1, 2, 3)).astype(np.uint8)
    with pytest.raises(InputError, match=r"c\.png: the black level must be 0 to (252|4092)"):
        read_photo(write_png(tmp_path / "c.png", codes), black_level=black, white_level=white)


# --- arrays -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<u2", ">u2", "u1"])
def test_arrays_are_read_like_files(tmp_path, dtype, order):
    codes = np.asarray(np.random.default_rng(0).integers(0, 255, (5, 7, 3)).astype(dtype), order=order)
    photo = read_photo(codes, exposure_time=0.5, name="left")
    np.testing.assert_array_equal(photo.codes, codes)
    assert (photo.name, photo.exposure_time, photo.exposure_source) == ("left", 0.5, "given")
    np.save(tmp_path / "a.npy", codes)
    np.testing.assert_array_equal(read_photo(tmp_path / "a.npy").codes, codes)
    mosaic = bayer_mosaic(colour(), "GBRG")
    np.testing.assert_array_equal(read_photo(mosaic, bayer="GBRG").codes, colour())


@pytest.mark.parametrize(
    "array",
    [np.zeros((4, 4)), np.zeros((2, 2, 2, 2), np.uint8), np.zeros((0, 4), np.uint8), np.zeros(4, np.uint8)],
)
def test_arrays_that_are_no_photos(tmp_path, array):
    with pytest.raises(InputError, match="array: codes must be uint8 or uint16"):
        read_photo(array)
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InputError, match=r"a\.npy: codes must be uint8 or uint16"):
        read_photo(tmp_path / "a.npy")


def test_pickles_are_not_loaded(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(FileFormatError, match=r"a\.npy: damaged or unsupported NPY file"):
        read_photo(tmp_path / "a.npy")


# --- metadata ---------------------------------------------------------------------------------------------------


def profile(name=None):
    """Return an ICC profile; named ones have the sRGB profile's primaries."""
    made = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    if name is None:
        return made
    # The description is UTF-16 text of fixed length inside of the profile.
    old = "sRGB built-in".encode("utf-16-be")
    assert old in made
    return made.replace(old, name.ljust(13)[:13].encode("utf-16-be"))


def test_other_profiles_than_srgb_are_told(tmp_path):
    picture = Image.fromarray(colour((10, 20, 30)).astype(np.uint8))
    for name in ("a.jpg", "a.png", "a.tif"):
        picture.save(tmp_path / name, icc_profile=profile())
        assert read_photo(tmp_path / name).channels == 3  # no warning, which would be an error here
        picture.save(tmp_path / name, icc_profile=profile("Display P3"))
        with pytest.warns(StereoHdrWarning, match=r"its colour profile \(Display P3\) is not applied"):
            read_photo(tmp_path / name)
    assert profile_name(b"not a profile") is None


def test_the_camera_is_read(tmp_path):
    exif = Image.Exif()
    exif[271], exif[272] = "NIKON CORPORATION\0", "NIKON D750 "
    for name in ("a.jpg", "a.png", "a.tif"):
        Image.fromarray(colour().astype(np.uint8)).save(tmp_path / name, exif=exif)
        assert read_photo(tmp_path / name).camera == "NIKON D750"


@pytest.mark.parametrize(
    ("maker", "model", "expected"),
    [
        ("Apple", "iPhone 15", "Apple iPhone 15"),
        ("Canon", "Canon EOS R5", "Canon EOS R5"),
        (None, "X100", "X100"),
        ("Acme", None, "Acme"),
        (None, None, None),
        ("  ", "\0", None),
    ],
)
def test_maker_and_model_become_one_name(maker, model, expected):
    assert camera_from_tags({271: maker, 272: model}) == expected


def test_kinds_are_told_by_content(tmp_path):
    heads = {
        "HEIF": b"\0\0\0\x18ftypheic\0\0\0\0mif1heic",
        "AVIF": b"\0\0\0\x20ftypmif1\0\0\0\0mif1avifmiaf",
        "RAW": b"\0\0\0\x18ftypcrx \0\0\0\1crx isom",
    }
    for kind, head in heads.items():
        (tmp_path / "file").write_bytes(head + bytes(40))
        assert image_kind(tmp_path / "file") == kind
    for head in (b"FUJIFILMCCD-RAW 0201", b"IIRO\x08\0\0\0", b"IIU\0\x18\0\0\0", b"II*\0\x10\0\0\0CR\2\0"):
        (tmp_path / "file").write_bytes(head + bytes(40))
        assert image_kind(tmp_path / "file") == "RAW"
    (tmp_path / "file").write_bytes(b"\0\0\0\x18ftypisom\0\0\0\0isommp42" + bytes(40))
    with pytest.raises(FileFormatError, match="not a PNG, JPEG, TIFF, HEIC"):
        image_kind(tmp_path / "file")


def test_sensor_data_beside_a_preview_is_camera_raw(tmp_path):
    # The layout of NEF and ARW: a small picture first, the mosaic in a sub-directory.
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        writer.write(np.zeros((8, 8, 3), np.uint8), photometric="rgb", subifds=1, subfiletype=1)
        writer.write(np.zeros((32, 32), np.uint16), photometric="cfa", subfiletype=0)
    assert image_kind(tmp_path / "a.tif") == "RAW"
    tifffile.imwrite(tmp_path / "b.tif", np.zeros((8, 8, 3), np.uint8), photometric="rgb")
    assert image_kind(tmp_path / "b.tif") == "TIFF"
    assert image_kind((tmp_path / "b.tif").rename(tmp_path / "b.nef")) == "RAW"
