"""Method `paper` is its stages in the order of Figure 1, each with its own configuration."""

from dataclasses import fields, replace

import numpy as np
import pytest

from stereohdr import Disparity, PaperConfig, ResponseCurve, fuse
from stereohdr.disparity import estimate_disparity
from stereohdr.fusion import blend, weight_map
from stereohdr.radiance import exposure_map, initial_radiance, luminance
from stereohdr.restoration import edge_preserving_filter, fill_holes, poisson_edit, reject_uncertain
from stereohdr.segmentation import auxiliary_interest, main_interest, segment_photo
from stereohdr.simulation import Camera, expose_pair, room
from stereohdr.warping import warp_forward

from conftest import make_pair

CONFIG = PaperConfig(max_disparity=18)


@pytest.fixture(scope="module")
def pair():
    """A small room, over- and under-exposed in the main view, with depth edges and several segments."""
    scene = room(width=120, height=90)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    return expose_pair(scene.radiance_left / scale, scene.radiance_right / scale, (2.0, 0.125), Camera(), 3)


@pytest.fixture(scope="module")
def result(pair):
    return fuse(pair, "paper", CONFIG, keep_stages=True)


def test_every_stage_is_its_public_function_of_the_stages_before(pair, result):
    s, equal = result.stages, np.testing.assert_array_equal
    t_m, t_a = pair.exposures
    R_m = initial_radiance(pair.left, result.response, exposure=t_m)
    R_a = initial_radiance(pair.right, result.response, exposure=t_a)
    equal(s["main_radiance"], R_m)
    equal(s["auxiliary_radiance"], R_a)
    equal(s["exposure_map"], exposure_map(pair.left))
    for view, photo in (("main", pair.left), ("auxiliary", pair.right)):
        segments, superpixels = segment_photo(photo)
        equal(s[f"{view}_segments"], segments)
        equal(s[f"{view}_superpixels"], superpixels)
    equal(s["main_interest"], main_interest(s["main_segments"], s["exposure_map"]))
    equal(s["auxiliary_interest"], auxiliary_interest(s["main_interest"], max_disparity=18))
    disparity = estimate_disparity(
        luminance(R_a), luminance(R_m), s["auxiliary_segments"], s["auxiliary_interest"], max_disparity=18
    )
    equal(s["auxiliary_disparity"], disparity.values)
    equal(result.disparity.flags, disparity.flags)
    warped, arrived = warp_forward(R_a, Disparity(disparity.values, disparity.flags))
    equal(s["warped"], warped)
    equal(s["arrived"], arrived)
    valid = reject_uncertain(luminance(R_m), luminance(warped), arrived)
    equal(s["rejected"], arrived & ~valid)
    equal(s["holes"], s["main_interest"] & ~valid)
    equal(s["filled"], fill_holes(warped, valid, s["holes"], R_m, s["main_segments"]))
    guide = R_m / np.float32(1000)  # milliseconds
    holes = s["holes"][..., None]
    defined = (valid | s["holes"])[..., None]
    smooth = edge_preserving_filter(np.where(defined, s["filled"], R_m), guide)
    equal(s["filtered"], np.where(holes, smooth, s["filled"]))
    restored, unbounded = poisson_edit(s["filtered"], valid, s["holes"], R_m)
    equal(s["restored"], restored)
    equal(s["smoothed_exposure_map"], weight_map(s["exposure_map"], guide))
    usable = valid | (s["holes"] & ~unbounded)
    equal(s["weight"], np.where(usable, s["smoothed_exposure_map"], 0))
    lowest = np.minimum(R_m.min(axis=(0, 1)), R_a.min(axis=(0, 1)))
    equal(result.radiance, blend(R_m, restored, s["weight"], lowest=lowest))


def test_the_pair_puts_every_stage_to_use(result):
    """Without this the test above could pass on empty stages."""
    s = result.stages
    for name in ("exposure_map", "main_interest", "auxiliary_interest", "arrived", "rejected", "holes"):
        assert 0.02 < s[name].mean() < 0.98, name
    assert (s["filtered"] != s["filled"]).any()
    assert (s["restored"] != s["filtered"]).any()
    assert s["main_segments"].max() > 5


CHANGES = {
    ("response", "smoothness", 200.0): "main_radiance",
    ("exposure_map", "over_threshold", 200.0): "exposure_map",
    ("exposure_map", "under_threshold", 20.0): "exposure_map",
    ("lattice", "pitch", 9): "main_superpixels",
    ("lattice", "tolerance", 1): "auxiliary_superpixels",
    ("lattice", "smoothing_sigma", 3.0): "main_superpixels",
    ("merging", "scale", 20.0): "main_segments",
    ("merging", "minimum_size", 5): "auxiliary_segments",
    ("census", "window", 3): "auxiliary_disparity",
    ("census", "threshold", 0.3): "auxiliary_disparity",
    ("candidates", "share", 0.5): "auxiliary_disparity",
    ("candidates", "box", 1): "auxiliary_disparity",
    ("aggregation", "radius", 3): "auxiliary_disparity",
    ("aggregation", "sigma", 2.0): "auxiliary_disparity",
    ("aggregation", "squared_sigma", True): "auxiliary_disparity",
    ("rejection", "enabled", False): "holes",
    ("rejection", "tolerance", 0.2): "rejected",
    ("edge_filter", "spatial_sigma", 3.0): "filtered",
    ("edge_filter", "range_sigma", 0.01): "smoothed_exposure_map",
    ("edge_filter", "iterations", 4): "filtered",
    ("poisson", "enabled", False): "restored",
}


@pytest.mark.parametrize(("change", "stage"), CHANGES.items(), ids=lambda value: str(value))
def test_each_setting_reaches_its_stage(pair, result, change, stage):
    part, name, value = change
    settings = replace(getattr(CONFIG, part), **{name: value})
    changed = fuse(pair, "paper", replace(CONFIG, **{part: settings}), keep_stages=True)
    assert (changed.stages[stage] != result.stages[stage]).any()


def test_no_setting_was_forgotten_above():
    names = {(part.name, f.name) for part in fields(CONFIG) if part.name != "max_disparity"
             for f in fields(getattr(CONFIG, part.name))}  # fmt: skip
    names.remove(("response", "samples"))  # tests/response/test_sift_matching.py
    assert names == {(part, name) for part, name, _ in CHANGES}


def test_a_right_main_view_uses_the_disparity_of_the_left_camera():
    """Known geometry, not only mirroring: x_left = x_right + 5, so the left view moves 5 px to the left."""
    pair = make_pair(60, 90, times=(0.04, 0.64), disparity=5)
    pair = replace(pair, main="right")
    result = fuse(
        pair, "paper", PaperConfig(max_disparity=12), response=ResponseCurve.gamma(2.2), keep_stages=True
    )
    d = result.disparity.values.astype(int)
    assert np.median(d[result.disparity.valid]) == 5
    left, warped = result.stages["auxiliary_radiance"], result.stages["warped"]
    y, x = np.nonzero(result.disparity.valid & (np.arange(90) - d >= 0))
    landed = (warped[y, x - d[y, x]] == left[y, x]).all(axis=1)
    assert landed.mean() > 0.5  # the others are hidden by something nearer
    y, x = np.nonzero(result.disparity.valid & (np.arange(90) + d < 90))
    assert (warped[y, x + d[y, x]] == left[y, x]).all(axis=1).mean() < 0.1  # the other way is wrong


def test_without_poisson_nothing_dark_bleeds_into_the_holes(pair):
    config = replace(CONFIG, poisson=replace(CONFIG.poisson, enabled=False))
    stages = fuse(pair, "paper", config, keep_stages=True).stages
    holes = stages["holes"]
    # A weighted mean of positive radiance is at least the smallest of them.
    assert stages["filtered"][holes].min() >= 0.99 * min(
        stages["filled"][holes].min(), stages["main_radiance"].min(), stages["auxiliary_radiance"].min()
    )
