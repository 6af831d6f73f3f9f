from dataclasses import replace

import numpy as np
import pytest
from camera_files import NEUTRAL, bayer_mosaic, write_dng
from scipy import ndimage

from stereohdr import InputError, Photo, ResponseCurve, StereoHdrWarning, StereoPair, fuse
from stereohdr.camera_colour import to_bt709, white_balanced
from stereohdr.checks import check_same_camera, estimated_ratio
from stereohdr.io import read_photo
from stereohdr.merging import merge_bracket

MATRIX = np.array([[1.8, -0.6, -0.2], [-0.25, 1.4, -0.15], [0.0, -0.3, 1.3]])
GAINS = (2.0, 1.0, 1.6)


def raw_photo(codes, time, **more):
    codes = np.asarray(codes, np.uint16)
    settings = {"response": ResponseCurve.linear(white_level=4095), "full_scale": 4095, "colour_matrix": MATRIX}
    return Photo(codes, time, 4095, white_balance=GAINS, **{**settings, **more})


def test_grey_stays_grey_and_colours_go_through_the_matrix():
    radiance = np.array([[[2, 2, 2], [2, 2.2, 3]]], np.float32)
    got = to_bt709(radiance, MATRIX)
    np.testing.assert_allclose(got[0, 0], 2, rtol=0.01)
    np.testing.assert_allclose(got[0, 1], MATRIX @ [2, 2.2, 3], rtol=1e-6)


def test_colours_outside_of_bt709_stay_positive():
    radiance = np.array([[[0.01, 5, 0.01]]], np.float32)
    got = to_bt709(radiance, MATRIX)
    assert (MATRIX @ radiance[0, 0]).min() < 0
    assert got.min() == pytest.approx(5e-3)


def test_without_a_matrix_nothing_changes():
    radiance = np.ones((2, 2, 3), np.float32)
    assert to_bt709(radiance, None) is radiance


def test_both_views_take_one_white_balance_and_clip_at_one_level():
    codes = np.array([[[400, 800, 500], [2047, 4095, 2559], [3000, 4095, 100], [4095, 10, 4095]]])
    left, right = raw_photo(codes, 1.0), replace(raw_photo(codes, 1.0), white_balance=(1.1, 1, 3))
    balanced = white_balanced((left, right), as_in=left)
    for photo in balanced:
        expected = [[800, 800, 800], [4094, 4095, 4094], [4095, 4095, 160], [4095, 10, 4095]]
        np.testing.assert_array_equal(photo.codes[0], expected)
        assert photo.white_balance is None
    # Never below 1: the smallest factor is 1, whichever channel has it.
    (greenish,) = white_balanced((left,), as_in=replace(left, white_balance=(0.5, 1, 0.8)))
    np.testing.assert_array_equal(greenish.codes[0, 0], [400, 1600, 800])
    assert (greenish.codes[codes == 4095] == 4095).all()
    untouched = replace(left, white_balance=None)
    assert white_balanced((left, right), as_in=untouched) == (left, right)


@pytest.mark.parametrize("gains", [(1, 2), (1, 0, 1), (1, float("nan"), 1)])
def test_malformed_colour_facts_are_refused(gains):
    with pytest.raises(InputError, match="as many positive factors"):
        replace(raw_photo(np.zeros((2, 2, 3)), 1.0), white_balance=gains)
    with pytest.raises(InputError, match="a colour matrix holds 3x3 finite numbers"):
        raw_photo(np.zeros((2, 2, 3)), 1.0, colour_matrix=np.eye(2))


def test_a_highlight_without_information_is_white_not_magenta():
    light = np.full((40, 60, 3), (0.1, 0.2, 0.125))
    light[10:30, 15:45] *= np.geomspace(1, 100, 30)[None, :, None]  # a neutral highlight with a soft rim
    photos = [raw_photo(np.minimum(np.rint(light * t * 4095), 4095), t) for t in (1.0, 4.0)]
    radiance = fuse(StereoPair(*photos), "mv-only", checks=False).radiance
    np.testing.assert_allclose(radiance / radiance[..., 1:2], 1, atol=0.02)


def scene(height=48, width=90):
    """Smooth radiance in BT.709, and the same in camera colours; 1 saturates green at one second."""
    y, x = np.mgrid[:height, :width].astype(float)
    grey = 0.12 + 0.05 * np.sin(x / 5.3) * np.cos(y / 4.1) + 0.03 * np.sin((x + y) / 2.9)
    rgb = grey[..., None] * np.array([1.1, 1.0, 0.9])
    rgb[20:34, 60:80] *= 30
    return rgb.astype(np.float32), rgb @ np.linalg.inv(MATRIX).T


def dng_matrix():
    """Return DNG's ColorMatrix1 (from XYZ) that stands for `MATRIX`."""
    from_xyz = np.array(
        [
            [3.2404542, -1.5371385, -0.4985314],
            [-0.9692660, 1.8760108, 0.0415560],
            [0.0556434, -0.2040259, 1.0572252],
        ]
    )
    return np.diag(NEUTRAL) @ np.linalg.inv(MATRIX) @ from_xyz


def raw_pair(folder, monkeypatch, cameras=("Acme One", "Acme One"), disparity=6):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    monkeypatch.setattr("camera_files.MATRIX", tuple(dng_matrix().ravel()))
    truth, camera = scene()
    paths = []
    for name, seconds, shift, model in zip("lr", ((1, 1), (1, 16)), (0, disparity), cameras, strict=False):
        sensor = camera * NEUTRAL * seconds[0] / seconds[1]
        sensor = np.roll(sensor, -shift, axis=1)
        mosaic = np.minimum(np.rint(bayer_mosaic(sensor, "RGGB") * 4000) + 95, 4095).astype(np.uint16)
        paths.append(folder / f"{name}.dng")
        write_dng(paths[-1], mosaic, black=95, exposure=seconds, camera=("Acme", model))
    return truth, paths


def test_two_raw_files_become_radiance_in_display_colours_without_an_estimate(tmp_path, monkeypatch):
    truth, paths = raw_pair(tmp_path, monkeypatch)
    pair = StereoPair(*(read_photo(path) for path in paths))
    result = fuse(pair, "mv-only", checks=False)
    assert result.response is pair.left.response
    clipped = (pair.left.codes * np.array(pair.left.white_balance) >= pair.left.white).any(axis=-1)
    well = ~ndimage.binary_dilation(clipped, iterations=4)[4:-4, 4:-4]
    ratio = (result.radiance / truth)[4:-4, 4:-4][well]
    error = np.abs(ratio / np.median(ratio) - 1)
    assert np.quantile(error, 0.99) < 0.05  # what demosaicing leaves
    assert error.max() < 0.15


def test_raw_files_of_different_cameras_are_refused(tmp_path, monkeypatch):
    _, paths = raw_pair(tmp_path, monkeypatch, cameras=("Acme One", "Acme Two"))
    pair = StereoPair(*(read_photo(path) for path in paths))
    with pytest.raises(InputError, match=r"l\.dng comes from Acme One, .*r\.dng from Acme Two: their raw codes"):
        fuse(pair, "mv-only")


def photos_of(*cameras, **more):
    codes = np.full((4, 4, 3), 9, np.uint16)
    return [raw_photo(codes, time, camera=name, **more) for name, time in zip(cameras, (1.0, 4.0), strict=True)]


def test_cameras_are_told_apart_by_their_matrices_when_unnamed():
    left, right = photos_of(None, None)
    assert check_same_camera(StereoPair(left, right)) is None
    other = Photo(right.codes, 4.0, 4095, response=right.response, colour_matrix=np.eye(3))
    with pytest.raises(InputError, match="give raw files of two cameras of one model"):
        check_same_camera(StereoPair(left, other))


def test_raw_beside_a_picture_is_refused_unless_a_response_is_given():
    left, right = photos_of("A", "A")
    picture = Photo(right.codes, 4.0, 4095, name="picture")
    with pytest.raises(InputError, match="is linear sensor data, picture is not"):
        check_same_camera(StereoPair(left, picture))
    assert check_same_camera(StereoPair(left, picture), ResponseCurve.srgb()) is None


def test_pictures_of_different_cameras_are_only_warned_of():
    codes = np.full((4, 4, 3), 9, np.uint8)
    pair = StereoPair(Photo(codes, 1.0, camera="A"), Photo(codes, 4.0, camera="B"))
    assert "one response is assumed for both" in (check_same_camera(pair) or "")


def test_an_estimated_ratio_is_flagged_in_the_result(pair):
    left = Photo(pair.left.codes, 0.04, exposure_source="estimated")
    assert estimated_ratio(pair) is None
    with pytest.warns(StereoHdrWarning, match="the exposure ratio 4 was estimated"):
        result = fuse(StereoPair(left, pair.right), "mv-only")
    assert any("was estimated" in sentence for sentence in result.warnings)


def test_a_raw_bracket_is_merged_by_its_own_response():
    rng = np.random.default_rng(1)
    light = rng.uniform(0.05, 0.45, (30, 40, 3))  # below the common clip point in both photos
    photos = [raw_photo(np.minimum(np.rint(light * t * 4095), 4095), t) for t in (1.0, 0.25)]
    radiance, _ = merge_bracket(photos)
    balanced = light * GAINS
    expected = np.maximum(balanced @ MATRIX.T, 1e-3 * balanced.max(axis=-1, keepdims=True))
    ratio = radiance / expected
    np.testing.assert_allclose(ratio / np.median(ratio), 1, rtol=0.2)
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.01
