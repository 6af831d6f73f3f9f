import numpy as np
import pytest

from stereohdr import Photo, StereoPair
from stereohdr.errors import ResponseError
from stereohdr.response import cdf_sample_pairs, estimate_response
from stereohdr.response.cdf_matching import knot_codes, knot_histograms

from conftest import make_pair


def histogram(codes):
    return np.bincount(codes, minlength=256)


def test_pairs_have_equal_cumulative_frequency_by_hand():
    # H_m: 0.5 at 10, 0.75 at 20, 1 at 30. H_a: 0.25 at 40, 0.75 at 80, 1 at 120. Nearest levels below 0.25
    # (main) and 0.125 (auxiliary) are code 0, which is clipped.
    pairs = cdf_sample_pairs(histogram([10, 10, 20, 30]), histogram([40, 80, 80, 120]))
    assert len(pairs) == 192  # u_i from 64 / 255 on
    assert {tuple(pair) for pair in pairs.tolist()} == {(10, 40), (10, 80), (20, 80), (30, 120)}
    counts = {pair: pairs.tolist().count(list(pair)) for pair in ((10, 40), (10, 80), (20, 80), (30, 120))}
    # u: 64..127 -> (10, 40); 128..159 -> (10, 80); 160..223 -> (20, 80); 224..255 -> (30, 120).
    assert counts == {(10, 40): 64, (10, 80): 32, (20, 80): 64, (30, 120): 32}


def test_pairs_with_a_clipped_code_are_dropped():
    main = histogram(np.repeat([0, 50, 100], [30, 40, 30]))
    auxiliary = histogram(np.repeat([60, 120, 255], [30, 40, 30]))
    pairs = cdf_sample_pairs(main, auxiliary)
    assert {tuple(pair) for pair in pairs.tolist()} == {(50, 120)}


def test_estimated_curve_is_close_to_the_cameras():
    response = estimate_response(make_pair(120, 160, times=(0.02, 0.08)))
    codes = np.arange(30, 220)
    error = response.log_exposure[:, codes] - 2.2 * np.log(codes / 128)
    assert np.sqrt((error**2).mean()) < 0.12
    assert response.is_monotone


def test_scaling_both_exposure_times_changes_nothing():
    one, two = make_pair(), make_pair()
    two = StereoPair(Photo(two.left.codes, 40.0), Photo(two.right.codes, 160.0))
    np.testing.assert_allclose(estimate_response(one).log_exposure, estimate_response(two).log_exposure, atol=2e-6)


def test_deep_codes_are_rounded_to_knots():
    codes = np.array([[0, 8, 9, 2048, 4095]], dtype=np.uint16)
    np.testing.assert_array_equal(knot_codes(codes, 4095), [[0, 0, 1, 128, 255]])
    counts = knot_histograms(Photo(codes, 1.0, 4095))
    assert counts.shape == (1, 256)
    assert dict(zip(*np.unique(np.repeat(np.arange(256), counts[0]), return_counts=True), strict=True)) == {
        0: 2,
        1: 1,
        128: 1,
        255: 1,
    }


def test_a_channel_without_information_takes_the_mean_of_the_others():
    pair = make_pair()
    left, right = pair.left.codes.copy(), pair.right.codes.copy()
    left[..., 2] = right[..., 2] = 0
    response = estimate_response(StereoPair(Photo(left, 0.04), Photo(right, 0.16)))
    np.testing.assert_allclose(response.log_exposure[2], response.log_exposure[:2].mean(axis=0))


def test_no_common_exposure_range_is_said():
    dark = np.full((20, 20, 3), 0, np.uint8)
    dark[0, 0] = 90
    bright = np.full((20, 20, 3), 255, np.uint8)
    with pytest.raises(ResponseError, match="no overlap in exposure"):
        estimate_response(StereoPair(Photo(dark, 0.001), Photo(bright, 1.0)))
