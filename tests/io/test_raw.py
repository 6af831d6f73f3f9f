import numpy as np
import pytest
from camera_files import NEUTRAL, bayer_mosaic, write_dng

from stereohdr import StereoPair
from stereohdr.camera_colour import white_balanced
from stereohdr.errors import FileFormatError, InputError, MissingDependencyError
from stereohdr.io import read_photo
from stereohdr.io.raw import clip_level

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
X_TRANS = "GGRGGBGGBGGRBRGRBGGGBGGRGGRGGBRBGBRG"


@pytest.fixture(autouse=True, scope="module")
def _rawpy():
    pytest.importorskip("rawpy", reason="rawpy is not installed")


def flat(colour, height=24, width=36):
    return np.tile(np.array(colour, np.uint16), (height, width, 1))


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_dng_becomes_linear_codes_without_pedestal(tmp_path, pattern):
    black = (64, 65, 66, 67)  # rows of the 2x2 cell
    mosaic = bayer_mosaic(flat([500, 900, 300]), pattern) + np.tile(np.reshape(black, (2, 2)), (12, 18))
    path = write_dng(tmp_path / "a.dng", mosaic.astype(np.uint16), pattern=pattern, black=black, white=4000)
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.codes, flat([500, 900, 300]))
    assert photo.white == 4000 - 67
    assert photo.linear
    assert (photo.exposure_time, photo.f_number, photo.iso) == (pytest.approx(1 / 60), 2.8, 200)
    assert photo.camera == "Acme One"
    assert photo.exposure_source == "file"


def test_the_response_is_linear_and_the_white_balance_known(tmp_path):
    neutral = np.array(NEUTRAL) * 800
    mosaic = bayer_mosaic(flat(neutral), "RGGB")
    photo = read_photo(write_dng(tmp_path / "a.dng", mosaic))
    assert photo.white_balance == pytest.approx((2, 1, 1.6))
    (balanced,) = white_balanced([photo], as_in=photo)
    np.testing.assert_array_equal(balanced.codes, 800)
    deep = photo.response.exposure_table(photo.white)[1]
    np.testing.assert_allclose(deep / deep[4000] * 4000, np.arange(4096), rtol=1e-5, atol=0.5001)
    np.testing.assert_allclose(deep[17:] / deep[4000] * 4000, np.arange(17, 4096), rtol=1e-5)
    # Rows that add up to 1 keep grey grey.
    np.testing.assert_allclose(photo.colour_matrix.sum(axis=1), 1, atol=1e-3)


def test_the_colour_matrix_leads_to_bt709(tmp_path):
    # A camera whose colours are those of XYZ has the matrix from XYZ to BT.709, up to the balance of the rows.
    import camera_files

    photo = read_photo(write_dng(tmp_path / "a.dng", bayer_mosaic(flat([500, 900, 300]), "RGGB")))
    from_xyz = np.reshape(camera_files.MATRIX, (3, 3))
    from_srgb = from_xyz @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    expected = np.linalg.inv(from_srgb / from_srgb.sum(axis=1, keepdims=True))
    np.testing.assert_allclose(photo.colour_matrix, expected, atol=2e-3)


def test_clipped_samples_are_white_in_every_pixel_that_they_touch(tmp_path):
    mosaic = bayer_mosaic(flat([500, 900, 300]), "RGGB")
    mosaic[10, 10] = 4095  # a red sample, far brighter than its surroundings
    white = read_photo(write_dng(tmp_path / "a.dng", mosaic)).codes == 4095
    assert white[10, 10].tolist() == [True, False, False]
    white[10, 10] = True
    assert white[9:12, 9:12].all()
    assert white.sum() == 27


def test_a_sensor_that_clips_below_its_stated_white_level_is_noticed(tmp_path):
    rng = np.random.default_rng(0)
    mosaic = np.minimum(rng.integers(0, 6000, (60, 80)), 3800).astype(np.uint16)
    assert read_photo(write_dng(tmp_path / "a.dng", mosaic, black=100)).white == 3700
    spread = rng.integers(0, 3800, (60, 80)).astype(np.uint16)
    assert read_photo(write_dng(tmp_path / "b.dng", spread, black=100)).white == 3995
    assert clip_level(np.zeros((4, 4), np.uint16), 4095) == 4095


@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_raw_photos_stand_upright(tmp_path, orientation, turns):
    rgb = flat([500, 900, 300])
    rgb[:6, :10] = 1000
    photo = read_photo(write_dng(tmp_path / "a.dng", bayer_mosaic(rgb, "RGGB"), orientation=orientation))
    upright = read_photo(write_dng(tmp_path / "b.dng", bayer_mosaic(rgb, "RGGB"))).codes
    np.testing.assert_array_equal(photo.codes, np.rot90(upright, turns))


def test_linear_dng_is_taken_as_it_is(tmp_path):
    rgb = np.random.default_rng(2).integers(50, 4000, (40, 60, 3)).astype(np.uint16)
    photo = read_photo(write_dng(tmp_path / "a.dng", rgb, black=50))
    np.testing.assert_array_equal(photo.codes, rgb - 50)
    assert photo.linear


def test_x_trans_is_interpolated_with_a_margin_around_clipping(tmp_path):
    mosaic = np.full((520, 522), 1000, np.uint16)  # LibRaw interpolates X-Trans from 512 pixels on
    mosaic[16, 20] = 4095
    photo = read_photo(write_dng(tmp_path / "a.dng", mosaic, pattern=X_TRANS))
    assert photo.white == 65535
    clipped = (photo.codes == 65535).any(axis=-1)
    assert clipped.sum() == 49
    assert clipped[13:20, 17:24].all()
    far = photo.codes[4:10, 4:40]
    np.testing.assert_allclose(far, 1000 / 4095 * 65535, rtol=0.01)


def test_a_raw_file_states_its_levels_itself(tmp_path):
    path = write_dng(tmp_path / "a.dng", np.zeros((8, 8), np.uint16))
    for options in ({"white_level": 4095}, {"black_level": 64}, {"bayer": "RGGB"}):
        with pytest.raises(InputError, match="a camera raw file states its own"):
            read_photo(path, **options)


@pytest.mark.parametrize("share", [0.02, 0.2, 0.5, 0.9])
def test_corrupt_raw_is_one_sentence(tmp_path, share):
    path = write_dng(tmp_path / "a.dng", np.random.default_rng(0).integers(0, 4095, (40, 60)).astype(np.uint16))
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(FileFormatError, match=r"a\.dng: damaged or unsupported camera raw file") as caught:
        read_photo(path)
    assert "copy it from the camera again" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_text_file_with_a_raw_suffix_is_told_apart(tmp_path):
    (tmp_path / "a.nef").write_bytes(b"II*\0" + bytes(60))
    with pytest.raises(FileFormatError, match=r"a\.nef: damaged or unsupported camera raw"):
        read_photo(tmp_path / "a.nef")


def test_levels_that_make_no_sense_are_refused(tmp_path):
    path = write_dng(tmp_path / "a.dng", np.full((24, 24), 50, np.uint16), black=100, white=100)
    with pytest.raises(FileFormatError, match="white level 100 is not above its black level 100"):
        read_photo(path)


def test_without_rawpy_the_extra_is_named(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "rawpy", None)
    path = write_dng(tmp_path / "a.dng", np.zeros((8, 8), np.uint16))
    with pytest.raises(MissingDependencyError, match=r"stereohdr\[raw\]"):
        read_photo(path)


def test_differing_white_levels_of_a_linear_sensor_count_as_exposure(tmp_path):
    # The same light gives the same code; one file states a lower white level.
    mosaic = bayer_mosaic(flat([500, 900, 300]), "RGGB")
    left = read_photo(write_dng(tmp_path / "l.dng", mosaic, exposure=(1, 60)))
    right = read_photo(write_dng(tmp_path / "r.dng", mosaic, exposure=(1, 30), white=3000))
    pair = StereoPair(left, right)
    radiance = [
        pair.known_response.apply(photo.codes, photo.white) / time
        for photo, time in zip((left, right), pair.exposures, strict=True)
    ]
    np.testing.assert_allclose(radiance[0], 2 * radiance[1], rtol=1e-3)
