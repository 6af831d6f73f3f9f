"""Scenes of the real data: sizes, signs and scales of the ground truth; skipped where the data are absent."""

from dataclasses import replace

import numpy as np
import pytest

from stereohdr.datasets import (
    benchmark_scenes,
    channel_mask,
    load_scene,
    luminance_mask,
    read_boreal,
    read_polar,
    visible_in_auxiliary,
    warped_by_truth,
)
from stereohdr.datasets.scene import any_channel_out_of_range
from stereohdr.merging import merge_bracket
from stereohdr.radiance import initial_radiance, luminance
from stereohdr.response.bracket import estimate_bracket_response


def response_of(scene):
    response = scene.response or scene.reference_response
    assert response is not None
    return response


def visible_of(scene):
    visible = visible_in_auxiliary(scene)
    assert visible is not None
    return visible


def truth_error(scene, offset=0.0):
    """Median error in stops of the AV's radiance, brought over by ground truth (+ offset), where all is well."""
    pair, truth = scene.pair, scene.disparity_main
    auxiliary = initial_radiance(pair.auxiliary_photo, response_of(scene), exposure=pair.exposures[1])
    bad = any_channel_out_of_range(pair.auxiliary_photo)[..., None].astype(np.float32)
    there = visible_of(scene) & ~channel_mask(scene) & (warped_by_truth(bad, truth, main=pair.main)[..., 0] == 0)
    moved = replace(truth, values=np.maximum(truth.values + np.float32(offset), 0))
    warped = warped_by_truth(auxiliary, moved, main=pair.main)
    error = np.log2(luminance(warped) / luminance(scene.reference))[there]
    return float(np.median(np.abs(error - np.median(error))))


@pytest.mark.parametrize(
    ("name", "most"),
    [("R1-half", 0.07), ("R2-half", 0.05), ("R3-half", 0.06), ("R4", 0.08), ("Art-long-short", 0.15)],
)
def test_the_truth_brings_the_auxiliary_view_over(shared_data, name, most):
    scenes = benchmark_scenes(shared_data)
    if name not in scenes:
        pytest.skip(f"the images of {name} are not in the data folder")
    scene = scenes[name]()
    exact = truth_error(scene)
    assert exact < most
    # Half a pixel of a wrong sign or scale would show.
    assert all(truth_error(scene, offset) > 1.08 * exact for offset in (-1.0, 1.0))
    assert scene.disparity_main is not None
    assert scene.disparity_auxiliary is not None
    assert scene.disparity_main.values.max() <= scene.max_disparity
    assert scene.disparity_auxiliary.valid.mean() > 0.9
    assert 0.7 < visible_of(scene).mean() < 0.95
    assert scene.reference_clipped.mean() < 0.001
    # What the main view's channels say and what the reference says is the same, where the view is exposed well.
    main = initial_radiance(scene.pair.main_photo, response_of(scene), exposure=scene.pair.exposures[0])
    error = np.log2(luminance(main) / luminance(scene.reference))[~channel_mask(scene)]
    assert np.median(np.abs(error - np.median(error))) < 0.06


@pytest.mark.parametrize(
    "name", ["R5", "Aloe-normal-long", "Books-half-short-dark", "Aloe-half-short-long", "Motorcycle-long-short"]
)
def test_other_scenes_load(shared_data, name):
    scenes = benchmark_scenes(shared_data)
    if name not in scenes:
        pytest.skip(f"the images of {name} are not in the data folder")
    scene = scenes[name]()
    assert scene.name == name
    assert scene.disparity_main is not None
    assert scene.disparity_main.values.max() <= scene.max_disparity
    assert truth_error(scene) < 0.2
    assert luminance_mask(scene).mean() <= channel_mask(scene).mean()


def test_a_scene_that_is_rectified_first(shared_data):
    pytest.importorskip("cv2")
    if "R8" not in benchmark_scenes(shared_data):
        pytest.skip("Boreal is not in the data folder")
    scene = load_scene("R8", shared_data)
    assert scene.pair.exposures == (0.001, 0.032)
    assert 90 < scene.max_disparity < 180
    main = initial_radiance(scene.pair.main_photo, response_of(scene), exposure=0.001)
    error = np.log2(luminance(main) / luminance(scene.reference))[~channel_mask(scene)]
    assert np.median(np.abs(error - np.median(error))) < 0.2  # the rig moves a little between its exposures


def test_full_size(shared_data):
    if "R3" not in benchmark_scenes(shared_data):
        pytest.skip("the images of R3 are not in the data folder")
    scene = load_scene("R3", shared_data)
    assert scene.reference.shape == (1110, 1390, 3)
    assert (scene.pair.main, scene.pair.exposures) == ("right", (4.0, 0.25))
    assert 0.05 < luminance_mask(scene).mean() < 0.12


def test_polar_is_linear_above_its_black_level(shared_data):
    if not (shared_data / "polar").is_dir():
        pytest.skip("POLAR is not in the data folder")
    bracket = read_polar(shared_data / "polar")
    assert [len(bracket.left), len(bracket.right)] == [7, 7]
    assert bracket.response is not None
    estimate = estimate_bracket_response(bracket.left)
    error = (estimate.log_exposure - bracket.response.log_exposure)[:, 5:251]
    assert np.sqrt((error**2).mean()) < 0.02
    _, clipped = merge_bracket(bracket.left, response=bracket.response)
    assert clipped.mean() < 1e-3


def test_boreal_sees_green_grass(shared_data):
    folder = shared_data / "boreal"
    if not folder.is_dir():
        pytest.skip("Boreal is not in the data folder")
    bracket = read_boreal(folder / "cycle00", folder / "calibration" / "pcalib_inside1.txt")
    assert bracket.left[0].codes.shape == (600, 960, 3)
    radiance, clipped = merge_bracket(bracket.left, response=bracket.response)
    assert clipped.mean() < 0.05
    red, green, blue = np.median(radiance[300:, 100:800], axis=(0, 1))
    assert green > red > blue
