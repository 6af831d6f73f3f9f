from dataclasses import replace

import numpy as np
import pytest
from dataset_folders import ART_WIDTH, Wall, write_art, write_official

from stereohdr.datasets import (
    ExposurePair,
    MiddleburyFolder,
    exposure_scene,
    reexposed_scene,
    same_exposure_pair,
    two_view_pair,
    visible_in_auxiliary,
    warped_by_truth,
)
from stereohdr.errors import FileFormatError, InputError
from stereohdr.io.images import write_png
from stereohdr.io.pfm import encode_pfm
from stereohdr.simulation import Camera

RECIPE = ExposurePair(main=(1, 0), auxiliary=(5, 2), bracket=(0, 1, 2), max_disparity=40)


def assert_same_up_to_scale(radiance, truth, tolerance, where=None):
    error = np.log2(radiance / truth)
    error = (error - np.median(error))[... if where is None else where]
    assert np.percentile(np.abs(error), 95) < tolerance


@pytest.mark.parametrize(("height", "factor"), [(1110, 1), (555, 2), (370, 3)])
def test_official_layout_at_every_size(tmp_path, height, factor):
    wall = Wall(height, 60, 12)
    write_official(tmp_path / "Art", wall, factor, illumination=2)
    source = MiddleburyFolder(tmp_path / "Art")
    assert source.size_factor() == factor
    scene = exposure_scene("art", source, replace(RECIPE, illumination=2))
    assert (scene.pair.main, scene.pair.exposures) == ("left", (0.25, 4.0))
    assert_same_up_to_scale(scene.reference, wall.radiance(0), 0.05, ~scene.reference_clipped)
    truth = scene.disparity_main
    assert truth is not None
    assert np.unique(truth.values).tolist() == [0, 12]
    assert truth.flags[0, :3].tolist() == [0, 0, 0]
    assert truth.flags[5, [11, 12]].tolist() == [2, 1]  # left of 12 the point leaves the frame of view 5


def test_a_right_main_view_and_a_view_in_between(tmp_path):
    source = MiddleburyFolder(write_art(tmp_path))
    recipe = ExposurePair(main=(2, 2), auxiliary=(1, 0), bracket=(1, 2), max_disparity=20, reduce=2)
    scene = exposure_scene("R3-half", source, recipe)
    assert (scene.pair.main, scene.pair.exposures) == ("right", (4.0, 0.25))
    assert scene.reference.shape == (555, ART_WIDTH // 2, 3)
    truth, visible = scene.disparity_main, visible_in_auxiliary(scene)
    assert truth is not None
    assert visible is not None
    # 24 full pixels between views 1 and 5: 6 between views 1 and 2, 3 at half size.
    assert np.unique(truth.values).tolist() == [3.0]  # where disp1 is unknown, disp5 knows
    assert visible[5].tolist() == [True] * (ART_WIDTH // 2 - 3) + [False] * 3
    radiance = Wall(1110, ART_WIDTH, 24).radiance(0).reshape(555, 2, -1, 2, 3).mean(axis=(1, 3)).astype(np.float32)
    warped = warped_by_truth(radiance, truth, main="right")
    inside = visible & ~scene.reference_clipped
    assert_same_up_to_scale(scene.reference, warped, 0.4, inside)  # codes were averaged, not radiance
    with pytest.raises(AssertionError):
        assert_same_up_to_scale(scene.reference, warped_by_truth(radiance, truth, main="left"), 0.8, inside)


def test_a_view_without_a_bracket_is_its_own_reference(tmp_path):
    wall = Wall(555, 60, 12)
    write_official(tmp_path, wall, 2)
    recipe = ExposurePair(main=(5, 1), auxiliary=(1, 0), bracket=(1,), auxiliary_bracket=(0, 1), max_disparity=40)
    scene = exposure_scene("R5", MiddleburyFolder(tmp_path), recipe)
    assert scene.pair.main == "right"
    assert_same_up_to_scale(scene.reference, wall.radiance(1), 0.15, ~scene.reference_clipped)
    expected = ((scene.pair.main_photo.codes >= 248) | (scene.pair.main_photo.codes < 5)).any(axis=2)
    np.testing.assert_array_equal(scene.reference_clipped, expected)


def test_times_that_the_folder_does_not_state(tmp_path):
    wall = Wall(555, 60, 12)
    write_official(tmp_path, wall, 2)
    for path in tmp_path.rglob("exposure_ms.txt"):
        path.unlink()
    with pytest.raises(FileFormatError, match=r"view1.png: its exposure time is stated nowhere"):
        exposure_scene("art", MiddleburyFolder(tmp_path), RECIPE)
    scene = exposure_scene("art", MiddleburyFolder(tmp_path, (1.0, 4.0, 16.0)), RECIPE)
    assert scene.pair.exposures == (1.0, 16.0)
    (tmp_path / "Illum1" / "Exp0" / "exposure_ms.txt").write_text("soon")
    with pytest.raises(FileFormatError, match="no time in milliseconds"):
        exposure_scene("art", MiddleburyFolder(tmp_path), RECIPE)


def test_missing_photos_and_odd_sizes_are_told(tmp_path):
    write_official(tmp_path, Wall(555, 60, 12), 2)
    with pytest.raises(FileFormatError, match=r"has no photo of view 1, illumination 3, exposure 0"):
        exposure_scene("art", MiddleburyFolder(tmp_path), replace(RECIPE, illumination=3))
    for views in ((1, 1), (0, 1)):
        with pytest.raises(InputError, match="two different views of 1 to 5"):
            exposure_scene(
                "art", MiddleburyFolder(tmp_path), replace(RECIPE, main=(views[0], 0), auxiliary=(views[1], 1))
            )
    write_png(tmp_path / "disp1.png", np.ones((500, 60), np.uint8))
    with pytest.raises(FileFormatError, match=r"is 500 pixels high; .* 1110, 555 and 370"):
        MiddleburyFolder(tmp_path).disparities()


def write_flat(folder, tail="default"):
    wall = Wall(370, 100, 12)
    folder.mkdir(parents=True)
    for view in (1, 5):
        write_png(folder / f"view{view}_{tail}.png", wall.codes((view - 1) / 4, 0.4))
    wall.write_truth(folder, 3)
    return wall


def test_a_pair_at_one_exposure_is_exposed_again(tmp_path):
    write_flat(tmp_path / "Wall")
    pair = same_exposure_pair(tmp_path / "Wall")
    assert (pair.name, pair.max_disparity) == ("Wall", 80)
    scene = reexposed_scene(pair, "long-short")
    assert scene.name == "Wall-long-short"
    assert scene.pair.exposures == (4.0, 0.25)
    # The reference is the true radiance: the codes linearised, half a code of dither.
    codes = 255 * scene.reference ** (1 / 2.2)
    assert np.abs(codes - pair.left.codes).max() <= 0.5
    assert not scene.reference_clipped.any()
    assert scene.response is not None
    np.testing.assert_array_equal(scene.response.log_exposure, Camera().response_curve().log_exposure)
    again = reexposed_scene(pair, "long-short")
    np.testing.assert_array_equal(again.pair.left.codes, scene.pair.left.codes)
    # Its auxiliary view, brought over by the ground truth, is the reference.
    truth, visible = scene.disparity_main, visible_in_auxiliary(scene)
    assert truth is not None
    assert visible is not None
    assert 0.8 < visible.mean() < 0.9
    right = reexposed_scene(pair, "normal-long").pair.right
    warped = warped_by_truth(right.codes.astype(np.float32), truth, main="left")
    left = reexposed_scene(pair, "short-long").pair.left
    assert np.median(warped[visible]) > 2 * np.median(left.codes)
    with pytest.raises(InputError, match="known are normal-long"):
        reexposed_scene(pair, "dark")


def test_a_folder_without_a_pair_is_told(tmp_path):
    with pytest.raises(FileFormatError, match="has no view1"):
        same_exposure_pair(tmp_path)
    write_flat(tmp_path / "a")
    (tmp_path / "a" / "disp5.png").unlink()
    with pytest.raises(FileFormatError, match=r"disp5\.png"):
        same_exposure_pair(tmp_path / "a")


def write_two_view(folder, wall):
    folder.mkdir()
    for view in (0, 1):
        write_png(folder / f"im{view}.png", wall.codes(view, 0.4))
    truth = np.full((40, 60, 1), 12, np.float32)
    truth[0, 0] = np.inf
    (folder / "disp0GT.pfm").write_bytes(encode_pfm(truth))
    (folder / "calib.txt").write_text("cam0=[1 0 0]\nwidth= 60\n ndisp= 30 \nisint= 0\n")


def test_two_views_of_2014(tmp_path):
    write_two_view(tmp_path / "Wall", Wall(40, 60, 12))
    pair = two_view_pair(tmp_path / "Wall")
    assert pair.max_disparity == 30
    assert pair.disparity_right is None
    assert pair.disparity_left is not None
    assert pair.disparity_left[0, :2].tolist() == [0, 12]
    scene = reexposed_scene(pair, "short-dark")
    assert scene.disparity_auxiliary is None
    visible = visible_in_auxiliary(scene)
    assert visible is not None
    assert visible[3].tolist() == [False] * 12 + [True] * 48
    (tmp_path / "Wall" / "calib.txt").write_text("width=60")
    with pytest.raises(FileFormatError, match="states no ndisp"):
        two_view_pair(tmp_path / "Wall")
    (tmp_path / "Wall" / "calib.txt").unlink()
    with pytest.raises(FileFormatError, match=r"calib\.txt: cannot be read"):
        two_view_pair(tmp_path / "Wall")
