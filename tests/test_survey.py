import itertools
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr import Disparity, DisparityFlag, Photo, ResponseCurve, StereoPair, survey
from stereohdr.config import ParametricResponseConfig, SurveyConfig
from stereohdr.simulation import Camera, expose_pair
from stereohdr.survey import joint_counts, matched_samples, reduced_codes, survey_pair


def wall_pair(
    disparity, *, rows=0.0, times=(0.6, 0.1), camera=None, channels=3, width=160, height=90, fine=1.2, seed=0
):
    """Return a pair of a textured wall.

    What the left view sees at (y, x) the right one has at (y + rows, x - disparity).
    """
    rng = np.random.default_rng(seed)
    size = (height + 20, width + 80)
    shape = (*size, channels)
    scene = 3 * ndimage.gaussian_filter(rng.normal(size=(*size, 1)), (fine, fine, 0))
    scene = scene + 4 * ndimage.gaussian_filter(rng.normal(size=shape), (6, 6, 0))
    scene = np.exp(scene + np.linspace(-1.5, 1.5, size[1])[None, :, None])
    y, x = np.mgrid[10 : 10 + height, 40 : 40 + width].astype(float)
    left, right = (
        np.stack([ndimage.map_coordinates(channel, at, order=3) for channel in np.moveaxis(scene, 2, 0)], axis=-1)
        for at in ([y, x], [y - rows, x + disparity])
    )
    views = (np.maximum(view, 1e-3).astype(np.float32) for view in (left, right))
    return expose_pair(*views, times, camera or Camera(), seed)


def error(found, truth):
    return np.sqrt(((found.log_exposure - truth.log_exposure)[:, 5:251] ** 2).mean())


def test_reduced_codes_by_hand():
    codes = np.array([[1, 2, 10, 10, 7], [3, 6, 20, 255, 7], [9, 9, 9, 9, 9]], np.uint8)
    found = reduced_codes(Photo(codes), 2)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found[..., 0], [[3, 255]])  # white, because one of its codes is
    np.testing.assert_array_equal(reduced_codes(Photo(codes), 1)[..., 0], codes)
    deep = np.array([[0, 2047], [2047, 4094]], np.uint16)
    found = reduced_codes(Photo(deep, white_level=4095), 2)
    np.testing.assert_allclose(found[..., 0], 2047 * 255 / 4095, rtol=1e-6)


@pytest.mark.parametrize("disparity", [0.0, 6.0, 40.0, -4.0, -2.5])
@pytest.mark.parametrize("times", [(0.6, 0.1), (0.1, 0.6)], ids=["long-short", "short-long"])
def test_a_wall_is_found_wherever_it_is(disparity, times):
    found = survey_pair(wall_pair(disparity, times=times))
    lowest, highest = found.disparities
    assert lowest <= disparity <= highest
    assert highest - lowest <= 12
    assert (lowest < 0) == (disparity < 0)
    assert found.confirmed_share > 0.7
    assert found.vertical_offset == pytest.approx(0, abs=0.05)


def test_the_range_is_in_pixels_of_the_full_image():
    pair = wall_pair(16.0, fine=3.0)
    full = survey_pair(pair).disparities
    found = survey_pair(pair, config=SurveyConfig(width=54)).disparities  # 3 times smaller
    assert 6 <= found[0] <= 16 <= found[1]
    assert found[1] - found[0] >= full[1] - full[0]
    assert found[1] - found[0] < 30


def test_near_and_far_are_in_the_range():
    far, near = wall_pair(2.0), wall_pair(25.0, seed=1)
    left, right = far.left.codes.copy(), far.right.codes.copy()
    left[:40, 60:], right[:40, 35:135] = near.left.codes[:40, 60:], near.right.codes[:40, 35:135]
    lowest, highest = survey_pair(StereoPair(Photo(left, 0.6), Photo(right, 0.1))).disparities
    assert 0 <= lowest <= 2
    assert 25 <= highest <= 40


@pytest.mark.parametrize("width", [360, 54])
def test_a_known_range_is_kept(width):
    pair = wall_pair(6.0)
    found = survey_pair(pair, max_disparity=30, config=SurveyConfig(width=width))
    assert found.disparities == (0, 30)
    assert found.confirmed_share > 0.7


def test_a_few_negative_disparities_are_no_reason_to_search_there():
    """The lower 3 % of the wall lie behind infinity; from 1 % on they count, but not when 10 % are asked for."""
    near, behind = wall_pair(3.0), wall_pair(-4.0)
    left, right = near.left.codes.copy(), near.right.codes.copy()
    left[-9:], right[-9:] = behind.left.codes[-9:], behind.right.codes[-9:]
    pair = StereoPair(Photo(left, 0.6), Photo(right, 0.1))
    assert survey_pair(pair).disparities[0] < -4
    assert survey_pair(pair, config=SurveyConfig(negative_evidence=0.2)).disparities[0] == 0


@pytest.mark.parametrize("name", ["linear", "gamma", "srgb", "s-shaped"])
def test_the_response_of_a_simulated_camera_is_found(name):
    camera = Camera(response=name)
    found = survey_pair(wall_pair(6.0, camera=camera))
    assert found.response is not None
    assert error(found.response, camera.response_curve(3)) < 0.1
    assert 0 < found.residual < 0.1


def test_a_known_response_is_kept():
    response = ResponseCurve.gamma(1.9)
    found = survey_pair(wall_pair(6.0), response=response)
    assert found.response is response
    assert np.isnan(found.residual)


def test_where_nothing_is_flat_ranks_tell_the_response():
    rng = np.random.default_rng(1)
    scene = np.exp(rng.uniform(-4, 2, (100, 210, 1))).astype(np.float32)
    camera = Camera(response="linear")
    pair = expose_pair(scene[:, :200], scene[:, 10:], (0.5, 0.1), camera, 1)
    everything = Disparity(
        np.full((100, 200), 10, np.float32), np.full((100, 200), DisparityFlag.MATCHED, np.uint8)
    )
    views = [photo.codes.astype(np.float32) for photo in (pair.left, pair.right)]
    assert len(matched_samples(*views, everything, pair.exposures)[0]) < 8  # too few for a fit
    found = survey_pair(pair)
    assert found.response is not None
    assert error(found.response, camera.response_curve(1)) < 0.1


@pytest.mark.parametrize(("residuals", "best"), [((0.2, 0.1), 1), ((0.1, 0.2), 0)])
def test_of_two_responses_the_one_with_the_smaller_residual_is_kept(monkeypatch, residuals, best):
    candidates = [(ResponseCurve.srgb(), residuals[0]), (ResponseCurve.gamma(2.3), residuals[1])]
    answers = itertools.cycle(candidates)
    monkeypatch.setattr(survey, "fit_parametric_response", lambda *args, **options: next(answers))
    found = survey_pair(wall_pair(6.0))
    assert found.response is candidates[best][0]
    assert found.residual == 0.1


@pytest.mark.parametrize("disparity", [40, -6])
def test_ranks_are_those_of_what_both_views_see(monkeypatch, disparity):
    histograms = []
    original = survey.mid_rank_pairs
    monkeypatch.setattr(survey, "mid_rank_pairs", lambda *a, **k: histograms.append(a[:2]) or original(*a, **k))
    pair = wall_pair(float(disparity))
    survey_pair(pair)
    main, auxiliary = (
        (pair.left.codes[:, 40:], pair.right.codes[:, :-40])
        if disparity > 0
        else (pair.left.codes[:, :-6], pair.right.codes[:, 6:])
    )
    for found, codes in zip(histograms[0], (main, auxiliary), strict=True):
        np.testing.assert_array_equal(found, np.bincount(codes[..., 0].ravel(), minlength=256))


def test_a_response_far_from_srgb_is_a_reason_to_match_again(monkeypatch):
    used = []
    original = survey._match
    monkeypatch.setattr(survey, "_match", lambda *args: used.append(args[1]) or original(*args))
    survey_pair(wall_pair(6.0, camera=Camera(response="srgb")))
    assert len(used) == 1
    np.testing.assert_array_equal(used[0].log_exposure, ResponseCurve.srgb().log_exposure)
    used.clear()
    survey_pair(wall_pair(6.0, camera=Camera(response="linear")))
    assert len(used) == 2
    assert error(used[1], ResponseCurve.gamma(1.0)) < 0.2


def test_exposures_without_a_common_radiance_tell_no_response():
    rng = np.random.default_rng(2)
    scene = np.where(np.arange(100)[None, :, None] < 50, 0.001, 100.0) * np.exp(rng.uniform(0, 1, (60, 100, 1)))
    pair = expose_pair(scene[:, :94], scene[:, 6:], (200.0, 0.003), Camera(noise=False), 1)
    found = survey_pair(pair)
    assert found.response is None
    assert np.isnan(found.residual)


@pytest.mark.parametrize("rows", [0.5, -0.5, 1.0, -1.4])
@pytest.mark.parametrize("width", [360, 80])
def test_a_vertical_offset_is_measured_at_full_size(rows, width):
    found = survey_pair(wall_pair(6.0, rows=rows), config=SurveyConfig(width=width))
    assert found.vertical_offset == pytest.approx(rows, abs=0.1)


def test_the_vertical_offset_is_measured_where_the_views_match():
    """At half size, and with another picture in a corner."""
    pair, other = wall_pair(20.0, rows=1.0), wall_pair(20.0, seed=1)
    left = pair.left.codes.copy()
    left[:45, :80] = other.left.codes[:45, :80]
    found = survey_pair(StereoPair(Photo(left, 0.6), pair.right), config=SurveyConfig(width=80))
    assert found.vertical_offset == pytest.approx(1, abs=0.1)


def test_joint_counts_by_hand():
    main = np.array([[[9, 1], [8, 2], [7, 3], [7, 4]]], np.uint8)
    auxiliary = np.array([[[90, 10], [80, 20], [70, 30], [60, 40]]], np.uint8)
    disparity = np.float32([[0.4, 1.2, 1.0, -0.4]])
    everywhere = np.ones((1, 4), bool)
    counts = joint_counts(main, auxiliary, disparity, everywhere, everywhere)
    # x - d: -0.4 and -0.2 are outside; 1 and, rounded from 3.4, outside again.
    assert counts.shape == (2, 256, 256)
    assert counts[0, 7, 80] == counts[1, 3, 20] == 1
    assert counts.sum() == 2
    counts = joint_counts(
        main, auxiliary, np.zeros_like(disparity), everywhere, np.array([[True, False, True, True]])
    )
    assert counts[0, 7, 70] == counts[0, 7, 60] == counts[0, 9, 90] == 1
    assert counts.sum() == 6
    counts = joint_counts(
        main, auxiliary, np.zeros_like(disparity), np.array([[False, False, True, False]]), everywhere
    )
    assert counts[1, 3, 30] == 1
    assert counts.sum() == 2


def test_matched_samples_by_hand():
    main, auxiliary = np.full((10, 12, 1), 100.0), np.full((10, 12, 1), 200.0)
    values, flags = np.full((10, 12), 1.4, np.float32), np.full((10, 12), DisparityFlag.MATCHED, np.uint8)
    flags[0] = DisparityFlag.OCCLUDED
    flags[1] = DisparityFlag.MISMATCHED
    disparity = Disparity(values, flags)
    # 8 rows; columns 2 to 11 have their partner inside.
    rows = [[100, 200, 80, np.log(4)], [100, 200, 80, np.log(4)]]
    np.testing.assert_allclose(matched_samples(main, auxiliary, disparity, (0.4, 0.1))[0], rows)
    fit = ParametricResponseConfig(fewest_pixels=81)
    assert matched_samples(main, auxiliary, disparity, (0.4, 0.1), fit=fit)[0].size == 0

    # The partner is one column to the left.
    auxiliary[:, 5:] = 190
    auxiliary[:, 5] = 195  # a step of less than 15 % is flat enough
    found = matched_samples(main, auxiliary, disparity, (0.4, 0.1), fit=ParametricResponseConfig(fewest_pixels=1))[
        0
    ]
    np.testing.assert_allclose(found[1:, :3], [[100, 190, 40], [100, 195, 8], [100, 200, 32]])


def test_samples_at_edges_of_either_view_do_not_count():
    flat, edge = np.full((20, 30, 1), 100.0), np.full((20, 30, 1), 100.0)
    edge[:, 20:] = 180
    disparity = Disparity(np.zeros((20, 30), np.float32), np.full((20, 30), DisparityFlag.MATCHED, np.uint8))
    fit = ParametricResponseConfig(fewest_pixels=1)
    for views in ((flat, edge), (edge, flat)):
        pixels = matched_samples(*views, disparity, (0.4, 0.1), fit=fit)[0][:, 2].sum() / 2
        # ln(183 / 103) = 0.57; its Gaussian gradient is 0.20 half a pixel from the edge, and 0.07 at 1.5 pixels.
        assert pixels == 20 * 28


@given(
    height=st.integers(1, 12),
    width=st.integers(1, 40),
    channels=st.sampled_from([1, 3]),
    known=st.sampled_from([None, 0, 3]),
    reduced_to=st.sampled_from([32, 360]),
    seed=st.integers(0, 500),
)
def test_any_pair_gives_a_range_that_can_be_searched(height, width, channels, known, reduced_to, seed):
    rng = np.random.default_rng(seed)
    codes = rng.choice([0, 2, 60, 128, 200, 254, 255], (2, height, width, channels)).astype(np.uint8)
    pair = StereoPair(Photo(codes[0], 0.01), Photo(codes[1], 0.01 * rng.choice([0.004, 0.5, 3, 256])))
    known = None if known is None else min(known, width - 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = survey_pair(pair, max_disparity=known, config=SurveyConfig(width=reduced_to))
    lowest, highest = found.disparities
    assert -width < lowest <= highest
    assert lowest < width
    assert highest > -width
    assert 0 <= found.confirmed_share <= 1
    assert np.isfinite(found.vertical_offset)
    assert found.response is None or found.response.is_monotone


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_do_not_change_the_survey(threads):
    pair = wall_pair(6.0)
    one, many = (survey_pair(pair, threads=n) for n in (1, threads))
    np.testing.assert_array_equal(one.response.log_exposure, many.response.log_exposure)
    assert (one.disparities, one.residual, one.confirmed_share, one.vertical_offset) == (
        many.disparities,
        many.residual,
        many.confirmed_share,
        many.vertical_offset,
    )
