"""Method `robust`: what it reaches on scenes with known truth, and what must hold for any pair."""

import warnings
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr import (
    Disparity,
    DisparityFlag,
    Photo,
    ResponseCurve,
    RobustConfig,
    SourceFlag,
    StereoHdrWarning,
    StereoPair,
    fuse,
    fuse_other_view,
)
from stereohdr.disparity.two_way import given_match
from stereohdr.disparity.vertical_offset import level_rows
from stereohdr.radiance import initial_radiance
from stereohdr.restoration._highlights_kernels import BORROWED
from stereohdr.simulation import Camera, expose_pair, room
from stereohdr.warping import warp_backward

from conftest import make_pair

CAMERA = Camera()
LONG_SHORT, SHORT_LONG = (2.0, 0.125), (0.125, 2.0)
KEPT = (SourceFlag.MEASURED, SourceFlag.NO_INFORMATION)


@pytest.fixture(scope="module")
def scene():
    """A small room, scaled so that it is over- and under-exposed at the exposure times above."""
    scene = room(width=120, height=90)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    return replace(scene, radiance_left=scene.radiance_left / scale, radiance_right=scene.radiance_right / scale)


@pytest.fixture(scope="module")
def pairs(scene):
    return {times: expose_pair(scene.radiance_left, scene.radiance_right, times, CAMERA, 3)
            for times in (LONG_SHORT, SHORT_LONG)}  # fmt: skip


@pytest.fixture(scope="module")
def results(pairs):
    return {times: fuse(pair, keep_stages=True) for times, pair in pairs.items()}


def wall_pair(disparity=6.0, *, rows=0.0, times=(0.6, 0.1), camera=CAMERA, channels=3, seed=0):
    """Return a pair of a textured wall, and the left view's radiance.

    What the left view sees at (y, x) the right one has at (y + rows, x - disparity).
    """
    rng = np.random.default_rng(seed)
    height, width = 90, 160
    scene = 3 * ndimage.gaussian_filter(rng.normal(size=(height + 20, width + 80, 1)), (1.2, 1.2, 0))
    scene = scene + 4 * ndimage.gaussian_filter(rng.normal(size=(height + 20, width + 80, channels)), (6, 6, 0))
    scene = np.exp(scene + np.linspace(-1.5, 1.5, width + 80)[None, :, None])
    y, x = np.mgrid[10 : 10 + height, 40 : 40 + width].astype(float)
    left, right = (
        np.stack([ndimage.map_coordinates(channel, at, order=3) for channel in np.moveaxis(scene, 2, 0)], axis=-1)
        for at in ([y, x], [y - rows, x + disparity])
    )
    left, right = (np.maximum(view, 1e-3).astype(np.float32) for view in (left, right))
    return expose_pair(left, right, times, camera, seed), left


def seen_by_both(disparity, width=160):
    partner = np.arange(width) - disparity
    return (partner >= 0) & (partner <= width - 1)


def own_radiance(pair, result):
    return initial_radiance(pair.main_photo, result.response, exposure=pair.exposures[0])


def response_error(result, truth):
    return np.sqrt(((result.response.log_exposure - truth.log_exposure)[:, 5:251] ** 2).mean())


def log_errors(radiance, truth, where):
    """Return log2 errors of an image with the scale that makes their median 0 (a scale per image is free)."""
    error = np.log2(radiance / truth)
    return (error - np.median(error[where]))[where]


def assert_same(one, other, *, scale=1.0):
    np.testing.assert_array_equal(one.source, other.source)
    np.testing.assert_array_equal(one.weight, other.weight)
    np.testing.assert_array_equal(one.confidence, other.confidence)
    for map_one, map_other in ((one.disparity, other.disparity), (one.main_disparity, other.main_disparity)):
        np.testing.assert_array_equal(map_one.values, map_other.values)
        np.testing.assert_array_equal(map_one.flags, map_other.flags)
    np.testing.assert_array_equal(one.response.log_exposure, other.response.log_exposure)
    if scale == 1:
        np.testing.assert_array_equal(one.radiance, other.radiance)
    else:
        np.testing.assert_allclose(one.radiance, other.radiance * np.float64(scale), rtol=3e-7)


# ------------------------------------------------------------------------------------------------ what it reaches


def test_it_is_the_default(pairs, results):
    assert results[LONG_SHORT].method == "robust"
    assert isinstance(results[LONG_SHORT].config, RobustConfig)


def test_clipped_highlights_come_near_the_truth(scene, pairs, results):
    pair, result = pairs[LONG_SHORT], results[LONG_SHORT]
    clipped = (pair.left.codes >= 250).any(axis=2)
    visible = scene.disparity_left.flags == DisparityFlag.MATCHED
    fine = ~clipped & (pair.left.codes > 20).all(axis=2)
    assert clipped.mean() > 0.2
    truth, before = scene.radiance_left, own_radiance(pair, result)
    scale = np.median((before / truth)[fine])
    errors = [np.abs(np.log2(image / (scale * truth)))[clipped & visible] for image in (before, result.radiance)]
    assert np.median(errors[0]) > 0.8
    assert np.median(errors[1]) < 0.2
    assert np.sqrt((errors[1] ** 2).mean()) < 0.5 * np.sqrt((errors[0] ** 2).mean())


def test_noise_in_the_dark_becomes_less_without_a_bias(scene, pairs, results):
    pair, result = pairs[SHORT_LONG], results[SHORT_LONG]
    dark = (pair.left.codes < 60).all(axis=2) & (pair.left.codes > 5).all(axis=2)
    visible = scene.disparity_left.flags == DisparityFlag.MATCHED
    truth, before = scene.radiance_left, own_radiance(pair, result)
    where = dark & visible
    assert where.mean() > 0.2
    errors = [np.log2(image / truth)[where] for image in (before, result.radiance)]
    assert errors[1].std() < 0.7 * errors[0].std()
    assert np.median(errors[1]) == pytest.approx(np.median(errors[0]), abs=0.1)


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_most_disparities_are_right_and_confidence_tells_which(scene, results, times):
    found, truth = results[times].main_disparity, scene.disparity_left
    visible = truth.flags == DisparityFlag.MATCHED
    wrong = np.abs(found.values - truth.values) > 2
    assert wrong[visible].mean() < 0.2
    confidence = results[times].confidence
    assert confidence[visible & ~wrong].mean() > confidence[visible & wrong].mean() + 0.1


@pytest.mark.parametrize("times", [(0.6, 0.1), (0.1, 0.6), (2.0, 0.05)])
@pytest.mark.parametrize("name", ["linear", "srgb"])
def test_the_response_is_found(name, times):
    camera = Camera(response=name)
    pair, _ = wall_pair(times=times, camera=camera)
    assert response_error(fuse(pair), camera.response_curve(3)) < 0.12


@pytest.mark.parametrize("times", [(0.6, 0.1), (0.1, 0.6)])
@pytest.mark.parametrize("disparity", [0.0, 6.0, 30.0, -4.0, -2.5])
def test_the_range_is_found_also_below_0(disparity, times):
    pair, _ = wall_pair(disparity, times=times)
    result = fuse(pair, checks=False)
    error = np.abs(result.main_disparity.values - disparity)[:, seen_by_both(disparity)]
    assert (error > 1).mean() < 0.01
    assert result.statistics["disparity_searched"] < 50
    assert not result.warnings


def test_a_given_range_is_kept():
    pair, _ = wall_pair(6.0)
    result = fuse(pair, config=RobustConfig(max_disparity=20))
    assert result.statistics["disparity_searched_from"] == 0
    assert result.statistics["disparity_searched"] == 20
    assert (np.abs(result.main_disparity.values - 6)[:, 6:] < 1).mean() > 0.99
    short = fuse(pair, config=RobustConfig(max_disparity=3))
    assert short.main_disparity.values.max() <= 3.5


@pytest.mark.parametrize("rows", [0.5, -0.5, 1.0, -1.0])
def test_a_vertical_offset_of_up_to_a_pixel_is_made_good(rows):
    pair, truth = wall_pair(rows=rows)
    result = fuse(pair)
    assert not result.warnings
    assert result.statistics["vertical_offset"] == pytest.approx(rows, abs=0.05)
    level, _ = wall_pair()
    best = fuse(level)
    where = (pair.left.codes >= 250).any(axis=2) & seen_by_both(6.0)
    assert where.mean() > 0.1
    error, least = (np.std(log_errors(image.radiance, truth, where)) for image in (result, best))
    assert error < least + 0.1
    ignored = fuse(pair, config=RobustConfig(survey=replace(RobustConfig().survey, smallest_offset=9.0)))
    assert np.std(log_errors(ignored.radiance, truth, where)) > error


@pytest.mark.parametrize("rows", [1.4, -2.0])
def test_a_larger_vertical_offset_is_warned_of(rows):
    pair, _ = wall_pair(rows=rows)
    with pytest.warns(StereoHdrWarning, match=rf"left and right: the rows are about {abs(rows):.1f} px apart"):
        result = fuse(pair, checks=False)
    assert (np.abs(result.main_disparity.values - 6)[:, 6:] < 1).mean() > 0.95


def test_without_common_radiance_the_srgb_curve_is_used_with_a_warning():
    rng = np.random.default_rng(2)
    scene = np.where(np.arange(100)[None, :, None] < 50, 0.001, 100.0) * np.exp(rng.uniform(0, 1, (60, 100, 1)))
    pair = expose_pair(scene[:, :94], scene[:, 6:], (200.0, 0.003), Camera(noise=False), 1)
    with pytest.warns(
        StereoHdrWarning, match="left and right do not tell the camera's response.*sRGB curve is used"
    ):
        result = fuse(pair, checks=False)
    difference = result.response.log_exposure - ResponseCurve.srgb(1).log_exposure
    np.testing.assert_allclose(difference[:, 4:], 0, atol=1e-6)


def test_no_warning_when_only_the_survey_sees_too_little_for_a_response(monkeypatch):
    from stereohdr.methods import robust

    original = robust.survey_pair
    monkeypatch.setattr(robust, "survey_pair", lambda *a, **k: replace(original(*a, **k), response=None))
    pair, _ = wall_pair()
    result = fuse(pair)
    assert not result.warnings
    assert response_error(result, CAMERA.response_curve(3)) < 0.1
    with pytest.warns(StereoHdrWarning, match="sRGB curve is used"):
        fuse(pair, config=RobustConfig(response_rounds=1))


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("times", [(0.6, 0.1), (0.1, 0.6)])
def test_grey_and_colour_at_any_depth(bits, channels, times):
    camera = replace(CAMERA, bits=bits)
    pair, truth = wall_pair(times=times, camera=camera, channels=channels)
    result = fuse(pair)
    assert result.radiance.shape == truth.shape
    assert response_error(result, camera.response_curve(channels)) < 0.15
    before = own_radiance(pair, result)
    everywhere = np.broadcast_to(seen_by_both(6.0), truth.shape[:2])
    assert np.std(log_errors(result.radiance, truth, everywhere)) < np.std(log_errors(before, truth, everywhere))


@pytest.mark.parametrize("ratio", [2.0, 16.0, 256.0])
@pytest.mark.parametrize("main_is_long", [True, False])
def test_small_and_large_ratios(ratio, main_is_long):
    times = (2.0, 2.0 / ratio) if main_is_long else (2.0 / ratio, 2.0)
    pair, truth = wall_pair(times=times)
    result = fuse(pair)
    everywhere = np.broadcast_to(seen_by_both(6.0), truth.shape[:2])
    errors = [
        np.std(log_errors(image, truth, everywhere)) for image in (own_radiance(pair, result), result.radiance)
    ]
    assert errors[1] <= errors[0] * 1.001  # at a ratio of 2 there is nothing to gain in the shadows


# ----------------------------------------------------------------------------------------------- what it says


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_flags_agree_with_weight_and_radiance(pairs, results, times):
    pair, result = pairs[times], results[times]
    own, weight = own_radiance(pair, result), result.weight
    np.testing.assert_array_equal(np.isin(result.source, KEPT) & (weight == 0), weight == 0)
    np.testing.assert_array_equal(result.radiance[weight == 0], own[weight == 0])
    measured = result.source == SourceFlag.MEASURED
    assert (weight[measured] == 0).all()
    s, valid = result.stages["exposure_map"], result.stages["valid"]
    assert not (s & measured).any()
    assert valid[result.source == SourceFlag.AUXILIARY].all()
    occluded = result.main_disparity.flags == DisparityFlag.OCCLUDED
    assert occluded[result.source == SourceFlag.FILLED_OCCLUDED].all()
    assert not (valid | occluded)[result.source == SourceFlag.FILLED_REJECTED].any()
    assert weight.dtype == np.float32
    assert weight.min() >= 0
    assert weight.max() <= 1
    shares = [(result.source == flag).mean() for flag in (SourceFlag.MEASURED, SourceFlag.AUXILIARY)]
    assert min(shares) > 0.05
    assert result.statistics["no_information_share"] == (result.source == SourceFlag.NO_INFORMATION).mean()


@pytest.mark.parametrize("times", [(0.6, 0.1), (0.6, 2.4)])
def test_a_well_exposed_clean_pixel_keeps_its_radiance(times):
    pair, _ = wall_pair(times=times, camera=replace(CAMERA, full_well=1e6))
    result = fuse(pair)
    fine = (pair.left.codes >= 170).all(axis=2) & (pair.left.codes < 245).all(axis=2)
    assert fine.sum() > 100
    np.testing.assert_array_equal(result.radiance[fine], own_radiance(pair, result)[fine])
    assert (result.source[fine] == SourceFlag.MEASURED).all()
    assert (result.source != SourceFlag.MEASURED).mean() > 0.05


def test_highlights_are_nowhere_darker_than_their_clip_value(pairs, results):
    own = own_radiance(pairs[LONG_SHORT], results[LONG_SHORT])
    assert (results[LONG_SHORT].radiance >= own).all()
    assert (results[LONG_SHORT].radiance > own).mean() > 0.2


def test_what_both_views_clip_keeps_the_main_view_and_is_flagged():
    # The largest white in the reach of either view has nothing around it that would lift it.
    pair = make_pair(60, 90, times=(0.64, 0.04))
    left, right = pair.left.codes.copy(), pair.right.codes.copy()
    left[10:50, 30:70], right[10:50, 25:65] = 255, 255
    pair = StereoPair(replace(pair.left, codes=left), replace(pair.right, codes=right))
    result = fuse(pair, response=ResponseCurve.gamma(2.2))
    inner = np.s_[15:45, 40:60]
    assert (result.source[inner] == SourceFlag.NO_INFORMATION).all()
    assert (result.radiance[inner] >= own_radiance(pair, result)[inner]).all()


def test_stages_and_seconds_have_the_names_of_the_method(results):
    result = results[LONG_SHORT]
    assert list(result.seconds) == ["checks", "survey", "disparity", "response", "warping", "agreement", "fusion"]
    assert set(result.stages) >= {"main_disparity", "auxiliary_disparity", "confidence", "warped", "valid",
                                  "main_radiance", "exposure_map", "borrowed", "weight"}  # fmt: skip
    assert all(array.shape[:2] == (90, 120) for array in result.stages.values())


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_stages_are_what_their_names_say_in_the_units_of_the_result(pairs, times):
    pair = pairs[times]
    gamma = ResponseCurve.gamma(2.2)
    result = fuse(pair, response=gamma, keep_stages=True)
    s = result.stages
    np.testing.assert_array_equal(s["main_radiance"], initial_radiance(pair.left, gamma, exposure=times[0]))
    everywhere = Disparity(s["main_disparity"], np.full((90, 120), DisparityFlag.MATCHED, np.uint8))
    auxiliary = initial_radiance(pair.right, gamma, exposure=times[1])
    np.testing.assert_allclose(s["warped"], warp_backward(auxiliary, everywhere)[0], rtol=2e-6)
    np.testing.assert_array_equal(s["main_disparity"], result.main_disparity.values)
    np.testing.assert_array_equal(s["auxiliary_disparity"], result.disparity.values)
    np.testing.assert_array_equal(s["confidence"], result.confidence)
    np.testing.assert_array_equal(s["weight"], result.weight)


def test_a_vertical_offset_is_taken_out_of_what_is_warped():
    pair, _ = wall_pair(rows=1.0)
    result = fuse(pair, response=ResponseCurve.gamma(2.2), keep_stages=True)
    auxiliary = initial_radiance(pair.right, result.response, exposure=pair.exposures[1])
    everywhere = Disparity(result.stages["main_disparity"], np.full((90, 160), DisparityFlag.MATCHED, np.uint8))
    level = level_rows(auxiliary, result.statistics["vertical_offset"])
    np.testing.assert_allclose(result.stages["warped"], warp_backward(level, everywhere)[0], rtol=1e-5)


CHANGES = {
    ("exposure_map", "over_threshold", 200.0),
    ("exposure_map", "under_threshold", 40.0),
    ("survey", "width", 40),
    ("survey", "search_share", 0.05),
    ("survey", "sure", 0.97),
    ("survey", "outlier_share", 0.3),
    ("response", "degree", 1),
    ("response", "ridge", 1.0),
    ("response", "tie", 100.0),
    ("response", "outlier_scale", 0.001),
    ("response", "lowest_code", 30),
    ("response", "highest_code", 180),
    ("response", "fewest_pixels", 150),
    ("response", "most_outside", 0.0),
    ("census", "window", 5),
    ("census", "threshold", 0.3),
    ("semiglobal", "paths", 4),
    ("semiglobal", "small_penalty", 3),
    ("semiglobal", "large_penalty", 25),
    ("semiglobal", "edge_factor", 0.0),
    ("semiglobal", "outside_cost", 48),
    ("two_way", "runs", 1),
    ("two_way", "tolerance", 0.2),
    ("two_way", "one_run", 0.2),
    ("two_way", "usual_margin", 400.0),
    ("agreement", "codes", 0.0),
    ("agreement", "auxiliary_codes", 0.0),
    ("agreement", "slack", 0.0),
    ("agreement", "borrowed_slack", 0.0),
    ("agreement", "white_code", 200.0),
    ("agreement", "support", 5),
    ("highlights", "level_error", 1.0),
    ("highlights", "gradient_error", 1.0),
    ("highlights", "borrowed_level_error", 0.01),
    ("highlights", "borrowed_gradient_error", 1.0),
    ("highlights", "colour_error", 0.01),
    ("highlights", "smoothness_error", 2.0),
    ("highlights", "prior_correlation", 0.01),
}
SHADOWS = {
    ("agreement", "black_code", 60.0),
    ("shadows", "radius", 5),
    ("shadows", "clean_noise", 0.1),
    ("shadows", "level_error", 1.0),
    ("shadows", "slope_pull", 0.0),
    ("shadows", "fewest_share", 0.95),
    ("shadows", "alone_share", 0.0),
    ("shadows", "alone_noise", 1.0),
}
ELSEWHERE = {
    ("survey", "negative_share"),  # tests/test_survey.py, with the next one
    ("survey", "negative_evidence"),
    ("survey", "smallest_offset"),  # above
    ("shadows", "noise_radius"),
    ("shadows", "lowest"),
}


@pytest.mark.parametrize(("part", "name", "value"), sorted(CHANGES | SHADOWS, key=str))
def test_each_setting_changes_something(pairs, results, part, name, value):
    times = SHORT_LONG if (part, name, value) in SHADOWS else LONG_SHORT
    config = RobustConfig()
    config = replace(config, **{part: replace(getattr(config, part), **{name: value})})
    changed, usual = fuse(pairs[times], config=config), results[times]
    assert changed.config is config
    same = [np.array_equal(changed.radiance, usual.radiance), np.array_equal(changed.source, usual.source),
            np.array_equal(changed.confidence, usual.confidence)]  # fmt: skip
    assert not all(same)


@pytest.mark.parametrize(("name", "value"), [("response_rounds", 1), ("toe", False)])
def test_each_switch_changes_the_response(pairs, results, name, value):
    changed = fuse(pairs[LONG_SHORT], config=replace(RobustConfig(), **{name: value}))
    difference = changed.response.log_exposure - results[LONG_SHORT].response.log_exposure
    assert (difference != 0).any()
    if name == "toe":
        np.testing.assert_array_equal(difference[:, 4:], 0)


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_the_toe_is_that_of_the_shorter_exposure(monkeypatch, pairs, times):
    from stereohdr.methods import robust

    seen = []
    original = robust.calibrate_toe
    monkeypatch.setattr(robust, "calibrate_toe", lambda *a, **k: seen.append((a[1], k)) or original(*a, **k))
    fuse(pairs[times])
    counts, options = seen[0]
    assert options["exposure_ratio"] == 16
    shorter, longer = np.nonzero(counts.sum(axis=0))
    assert (shorter <= longer).mean() > 0.95


def test_nothing_is_borrowed_where_something_nearer_is_seen(monkeypatch, pairs):
    from stereohdr.methods import robust

    sources = []
    original = robust.restore_logarithms
    monkeypatch.setattr(
        robust, "restore_logarithms", lambda *a, **k: sources.append(a[2].source) or original(*a, **k)
    )
    fuse(pairs[LONG_SHORT])
    monkeypatch.setattr(robust, "hidden", lambda of_main, *rest, **options: np.ones(of_main.values.shape, bool))
    fuse(pairs[LONG_SHORT])
    assert (sources[0] == BORROWED).any()
    assert not (sources[1] == BORROWED).any()


def test_no_setting_was_forgotten_above():
    config = RobustConfig()
    parts = [f.name for f in fields(config) if f.name not in ("max_disparity", "response_rounds", "toe")]
    names = {(part, f.name) for part in parts for f in fields(getattr(config, part))}
    assert names == {(part, name) for part, name, _ in CHANGES | SHADOWS} | ELSEWHERE


# ------------------------------------------------------------------------------------------- what must always hold


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_a_mirrored_pair_gives_the_mirrored_bytes(pairs, results, times):
    mirrored = fuse(pairs[times].mirrored(), keep_stages=True)
    assert mirrored.main == "right"
    back = mirrored.mirrored()
    assert_same(back, results[times])
    for name, array in results[times].stages.items():
        np.testing.assert_array_equal(back.stages[name], array, err_msg=name)


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
@pytest.mark.parametrize("factor", [2.0**-10, 1000.0, 1 / 3])
def test_other_units_of_time_scale_the_radiance_and_change_nothing_else(pairs, results, times, factor):
    """Not a flag, not a disparity: the method works in units of the main exposure."""
    left, right = (
        replace(photo, exposure_time=factor * time)
        for photo, time in zip((pairs[times].left, pairs[times].right), times, strict=True)
    )
    scaled = fuse(StereoPair(left, right), keep_stages=True)
    assert_same(results[times], scaled, scale=factor)
    for name in ("main_radiance", "warped", "borrowed"):
        if name in scaled.stages:
            expected = results[times].stages[name].astype(np.float64)
            np.testing.assert_allclose(scaled.stages[name] * np.float64(factor), expected, rtol=3e-7)


def test_iso_and_f_number_count_as_exposure(pairs, results):
    left, right = pairs[LONG_SHORT].left, pairs[LONG_SHORT].right
    stopped_down = replace(right, exposure_time=0.25, iso=200, f_number=4.0)
    pair = StereoPair(replace(left, iso=100, f_number=2.0), stopped_down)
    assert pair.exposures == LONG_SHORT
    assert_same(results[LONG_SHORT], fuse(pair))


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_with_the_views_exchanged_the_disparities_are_the_same(pairs, times):
    """With the same response and range: what was the main view's map becomes the auxiliary view's."""
    options = {"config": RobustConfig(max_disparity=20), "response": CAMERA.response_curve(3)}
    left = fuse(pairs[times], **options)
    right = fuse(replace(pairs[times], main="right"), **options)
    for one, other in ((left.disparity, right.main_disparity), (left.main_disparity, right.disparity)):
        assert (one.values == other.values).mean() > 0.995  # rounding may decide between equal costs
        assert (one.flags == other.flags).mean() > 0.995


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_the_other_view_gets_its_own_image(scene, pairs, results, times):
    other = fuse_other_view(pairs[times], results[times])
    assert other.main == "right"
    np.testing.assert_array_equal(other.response.log_exposure, results[times].response.log_exposure)
    visible = scene.disparity_right.flags == DisparityFlag.MATCHED
    wrong = np.abs(other.main_disparity.values - scene.disparity_right.values) > 2
    assert wrong[visible].mean() < 0.2
    own = initial_radiance(pairs[times].right, other.response, exposure=times[1])
    measured = other.source == SourceFlag.MEASURED
    assert measured.any()
    np.testing.assert_array_equal(other.radiance[measured], own[measured])


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_channels_in_another_order_give_the_same_radiance(scene, pairs, times):
    """To rounding with response and disparity given; else nearly, as luminance weighs the channels differently."""
    order = [2, 0, 1]
    pair = pairs[times]
    permuted = StereoPair(*(replace(photo, codes=photo.codes[..., order]) for photo in (pair.left, pair.right)))
    truth = CAMERA.response_curve(3)
    known = {"response": truth, "disparity": scene.disparity_right}
    expected = fuse(pair, **known)
    found = fuse(permuted, **known | {"response": ResponseCurve(truth.log_exposure[order])})
    np.testing.assert_allclose(found.radiance, expected.radiance[..., order], rtol=1e-3)
    ratio = np.abs(np.log2(fuse(permuted).radiance / fuse(pair).radiance[..., order]))
    assert np.median(ratio) < 0.05


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_threads_do_not_change_a_byte(pairs, times, threads):
    one, many = (fuse(pairs[times], threads=n) for n in (1, threads))
    assert_same(one, many)
    assert one.radiance.tobytes() == many.radiance.tobytes()


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_the_same_pair_twice_gives_the_same_bytes(pairs, results, times):
    assert fuse(pairs[times]).radiance.tobytes() == results[times].radiance.tobytes()


def test_a_given_response_is_used_and_returned(pairs):
    response = ResponseCurve.gamma(1.8)
    assert fuse(pairs[LONG_SHORT], response=response).response is response


@pytest.mark.parametrize("main", ["left", "right"])
def test_a_given_disparity_is_used(scene, pairs, main):
    pair = replace(pairs[LONG_SHORT], main=main)
    known = scene.disparity_right if main == "left" else scene.disparity_left
    result = fuse(pair, disparity=known, checks=False)
    matched = known.flags == DisparityFlag.MATCHED
    np.testing.assert_array_equal(result.disparity.values[matched], known.values[matched])
    np.testing.assert_array_equal(result.disparity.flags == DisparityFlag.MATCHED, matched)
    if main == "left":
        of_main, _ = given_match(known)
        np.testing.assert_array_equal(result.main_disparity.values, of_main.disparity.values)
        np.testing.assert_array_equal(result.confidence, of_main.confidence)


def random_codes(rng, kind, height, width, channels, white):
    codes = rng.integers(0, white + 1, (2, height, width, channels))
    if kind == "extremes":
        codes = rng.choice([0, 1, white // 100, white // 2, white - 1, white], codes.shape)
    elif kind == "shifted":
        wide = rng.integers(0, white + 1, (height, width + 3, channels))
        codes = np.stack([wide[:, :width], np.minimum(wide[:, 3:] * rng.uniform(0.1, 5), white).astype(int)])
    elif kind == "halves":
        codes[:, : height // 2] = rng.choice([0, white])
        codes[0, :, width // 2 :] = rng.choice([0, white])
    elif kind == "flat":
        codes[0], codes[1] = rng.integers(1, white + 1, 2)
    return codes.astype(np.uint8 if white == 255 else np.uint16)


@settings(max_examples=150)
@given(
    size=st.tuples(st.integers(1, 16), st.integers(1, 40)),
    channels=st.sampled_from([1, 3]),
    bits=st.sampled_from([8, 12, 16]),
    kind=st.sampled_from(["noise", "extremes", "shifted", "halves", "flat"]),
    ratio=st.sampled_from([1.02, 2.0, 16.0, 256.0]),
    time=st.sampled_from([1e-6, 0.01, 1e5]),
    longer=st.sampled_from(["left", "right"]),
    main=st.sampled_from(["left", "right"]),
    response=st.sampled_from([None, 2.2]),
    share=st.sampled_from([None, 0.0, 0.5]),
    seed=st.integers(0, 10_000),
)
@example(size=(1, 1), channels=1, bits=8, kind="noise", ratio=2.0, time=0.01, longer="left", main="left",
         response=None, share=None, seed=1)  # fmt: skip
@example(size=(40, 64), channels=3, bits=8, kind="shifted", ratio=4.0, time=0.04, longer="right", main="left",
         response=None, share=None, seed=2)  # fmt: skip
@example(size=(60, 90), channels=3, bits=12, kind="shifted", ratio=16.0, time=0.04, longer="left", main="right",
         response=None, share=None, seed=3)  # fmt: skip
def test_any_codes_give_finite_positive_radiance_with_flags_that_hold(
    size, channels, bits, kind, ratio, time, longer, main, response, share, seed
):
    rng = np.random.default_rng(seed)
    white = 2**bits - 1
    codes = random_codes(rng, kind, *size, channels, white)
    times = (time * ratio, time) if longer == "left" else (time, time * ratio)
    pair = StereoPair(*(Photo(c, t, white) for c, t in zip(codes, times, strict=True)), main=main)
    config = RobustConfig(max_disparity=None if share is None else int(share * (size[1] - 1)))
    known = None if response is None else ResponseCurve.gamma(response, channels)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        result = fuse(pair, "robust", config, response=known, checks=False, keep_stages=True)

    own = own_radiance(pair, result)
    assert result.radiance.shape == own.shape
    assert result.radiance.dtype == np.float32
    assert np.isfinite(result.radiance).all()
    assert (result.radiance > 0).all()
    measured = result.source == SourceFlag.MEASURED
    np.testing.assert_array_equal(result.radiance[measured], own[measured])
    assert ((result.weight >= 0) & (result.weight <= 1)).all()
    assert (result.weight[measured] == 0).all()
    assert all(np.isfinite(array).all() for array in result.stages.values())
    if longer == main:
        assert (result.radiance >= own).all()
    if result.method == "robust":
        assert ((result.confidence >= 0) & (result.confidence <= 1)).all()
        assert result.response.is_monotone
        for disparity in (result.disparity, result.main_disparity):
            assert np.isfinite(disparity.values).all()
            assert (disparity.flags != DisparityFlag.NOT_COMPUTED).all()
