import numpy as np
import pytest
from dataset_folders import write_deep_png

from stereohdr.datasets import read_boreal, read_polar
from stereohdr.datasets.boreal import read_inverse_response
from stereohdr.datasets.polar import BLACK_LEVEL, WHITE_LEVEL, polar_response
from stereohdr.errors import FileFormatError
from stereohdr.merging import merge_bracket


def test_polar_codes_become_linear_radiance(tmp_path):
    light = np.random.default_rng(0).uniform(100, 1500, (6, 8))  # codes above black per second
    for side in ("left", "right"):
        for ms in (500, 1000, 2000):
            codes = np.minimum(np.rint(light * ms / 1000 + BLACK_LEVEL), WHITE_LEVEL)
            write_deep_png(tmp_path / f"{side}_{ms:04}ms.png", codes)
    bracket = read_polar(tmp_path)
    assert [photo.exposure_time for photo in bracket.left] == [0.5, 1.0, 2.0]
    assert bracket.left[0].white == WHITE_LEVEL
    assert not bracket.rectified
    radiance, clipped = merge_bracket(bracket.left, response=bracket.response)
    ratio = radiance[..., 0] / light
    np.testing.assert_allclose(ratio, np.median(ratio), rtol=0.01)
    assert not clipped.any()


def test_polar_response_is_finite_and_rising():
    curve = polar_response()
    assert curve.is_monotone
    table = curve.exposure_table(WHITE_LEVEL)[0]
    np.testing.assert_allclose(np.diff(table[20:]), table[-1] / (WHITE_LEVEL - BLACK_LEVEL), rtol=1e-6)


def test_boreal_mosaics_become_rgb_of_half_size(tmp_path):
    mosaic = np.tile(np.array([[100, 200], [202, 300]]), (3, 4))
    for side, times in (("left", ("01.0", "08.0")), ("right", ("01.0", "32.0"))):
        for ms in times:
            write_deep_png(tmp_path / f"{side}_{ms}ms.png", mosaic * (1 + (ms != "01.0")))
    calibration = tmp_path / "pcalib.txt"
    calibration.write_text(" ".join(str(0.5 + value) for value in range(256)))
    bracket = read_boreal(tmp_path, calibration)
    assert bracket.left[0].codes.shape == (3, 4, 3)
    assert bracket.left[0].codes[0, 0].tolist() == [100, 201, 300]
    assert [photo.exposure_time for photo in bracket.right] == [0.001, 0.032]
    assert bracket.response is not None
    assert bracket.response.channels == 3
    np.testing.assert_allclose(np.exp(bracket.response.log_exposure[1]), (np.arange(256) + 0.5) / 128.5)
    assert read_boreal(tmp_path).response is None


@pytest.mark.parametrize("text", ["1 2 3", "one " * 256, " ".join(["1"] * 256), "1 2 3\n" * 256])
def test_a_bad_calibration_is_refused(tmp_path, text):
    (tmp_path / "pcalib.txt").write_text(text)
    with pytest.raises(FileFormatError, match=r"pcalib\.txt"):
        read_inverse_response(tmp_path / "pcalib.txt")


def test_missing_photos_are_told(tmp_path):
    with pytest.raises(FileFormatError, match=r"holds no left_<time>ms\.png"):
        read_polar(tmp_path)
    write_deep_png(tmp_path / "left_longms.png", np.zeros((2, 2)))
    with pytest.raises(FileFormatError, match=r"left_longms\.png: the name states no exposure time"):
        read_polar(tmp_path)
