import numpy as np
import pytest

from stereohdr import Photo, StereoPair
from stereohdr.errors import ResponseError
from stereohdr.response import cdf_sample_pairs, estimate_response
from stereohdr.response.cdf_matching import knot_codes

from conftest import make_pair


def test_pairs_have_equal_cumulative_frequency_by_hand():
    main = np.array([10, 10, 20, 30])
    auxiliary = np.array([40, 80, 80, 120])
    # H_m: .5 at 10, .75 at 20, 1 at 30. H_a: .25 at 40, .75 at 80, 1 at 120.
    pairs = cdf_sample_pairs(main, auxiliary)
    # At u = 0.5 and below 0.25 the nearest of H_m is 0 at code 0, which is clipped and dropped.
    for u, expected in ((0.3, (10, 40)), (0.6, (10, 80)), (0.8, (20, 80)), (0.95, (30, 120))):
        i = round(u * 255)
        distances = [abs(np.array([0.5, 0.75, 1.0]) - i / 255), abs(np.array([0.25, 0.75, 1.0]) - i / 255)]
        assert (
            np.array([10, 20, 30])[distances[0].argmin()],
            np.array([40, 80, 120])[distances[1].argmin()],
        ) == expected
        assert expected in {tuple(p) for p in pairs.tolist()}
    assert set(pairs[:, 0]) == {10, 20, 30}
    assert set(pairs[:, 1]) == {40, 80, 120}


def test_pairs_with_a_clipped_code_are_dropped():
    main = np.repeat([0, 50, 100], [30, 40, 30])
    auxiliary = np.repeat([60, 120, 255], [30, 40, 30])
    pairs = cdf_sample_pairs(main, auxiliary)
    assert ((pairs > 0) & (pairs < 255)).all()
    assert (50, 120) in {tuple(p) for p in pairs.tolist()}


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
    np.testing.assert_array_equal(knot_codes(Photo(codes, 1.0, 4095))[..., 0], [[0, 0, 1, 128, 255]])


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
