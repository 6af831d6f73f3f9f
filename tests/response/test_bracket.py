from dataclasses import replace

import numpy as np
import pytest

from stereohdr import Photo
from stereohdr.errors import ExposureError, InputError, ResponseError
from stereohdr.response.bracket import (
    _rising,
    bracket_exposures,
    bracket_sample_pairs,
    check_bracket,
    estimate_bracket_response,
)
from stereohdr.simulation import Camera, expose


def scene(channels=3, stops=9.0, seed=5):
    """Radiance spread evenly over `stops` below 1, ``(150, 200, channels)``."""
    return 2.0 ** -np.random.default_rng(seed).uniform(0, stops, (150, 200, channels))


def bracket(camera, times, channels=3, **more):
    radiance = scene(channels, **more)
    return [expose(radiance, time, camera, seed, name=f"at {time}") for seed, time in enumerate(times)]


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("response", ["srgb", "s-shaped", "linear"])
def test_recovers_the_response_of_a_simulated_camera(response, bits):
    camera = Camera(response=response, bits=bits)
    estimate = estimate_bracket_response(bracket(camera, (1.0, 4.0, 16.0)))
    error = (estimate.log_exposure - camera.response_curve(3).log_exposure)[:, 5:251]
    assert np.sqrt((error**2).mean(axis=1)).max() < 0.025
    assert estimate.is_monotone


def test_the_order_of_the_photos_does_not_matter():
    photos = bracket(Camera(), (1.0, 2.0, 8.0), channels=1)
    first, second = (estimate_bracket_response(p).log_exposure for p in (photos, photos[::-1]))
    np.testing.assert_array_equal(first, second)


def test_pairs_are_medians_both_ways_over_all_pixels():
    # Code 10 of the short photo meets 30, 40, 40, ..., code 40 of the long one meets 10 mostly; 20 is clipped.
    short = np.array([10] * 41 + [20] * 30 + [1] * 30 + [99] * 19, np.uint8)
    long = np.array([30] * 20 + [40] * 21 + [255] * 30 + [3] * 30 + [120] * 19, np.uint8)
    photos = [Photo(short[None], 1.0), Photo(long[None], 4.0)]
    (codes, times), *others = bracket_sample_pairs(photos)
    assert not others
    # (10, 40) from the short code 10; (10, 30) and (10, 40) from the long codes 30 and 40. Left out: 20, whose
    # partner is clipped; 1, which is itself; 99, for 19 pixels are too few.
    assert sorted(map(tuple, codes.tolist())) == [(10, 30), (10, 40), (10, 40)]
    np.testing.assert_array_equal(times, [[1.0, 4.0]] * 3)


def test_clipped_pixels_take_part_in_the_medians():
    # Of the pixels with code 100, most are clipped in the long photo: dropping them first would give 200.
    short = np.full((1, 100), 100, np.uint8)
    long = np.where(np.arange(100) < 40, 200, 255).astype(np.uint8)[None]
    (codes, _), *_ = bracket_sample_pairs([Photo(short, 1.0), Photo(long, 2.0)])
    assert codes.tolist() == [[100, 200]]  # from the long photo's 200, not from the short photo's 100


def test_photos_far_apart_are_compared_only_as_neighbours():
    photos = bracket(Camera(), (1.0, 16.0, 64.0), channels=1)
    ratios = {round(float(long / short)) for _, t in bracket_sample_pairs(photos) for short, long in t}
    assert ratios == {16, 4}


def test_a_clipped_channel_takes_the_mean_of_the_others():
    photos = []
    for photo in bracket(Camera(noise=False), (1.0, 4.0)):
        codes = photo.codes.copy()
        codes[..., 2] = 255
        photos.append(replace(photo, codes=codes))
    curve = estimate_bracket_response(photos).log_exposure
    np.testing.assert_allclose(curve[2], curve[:2].mean(axis=0))


def test_a_curve_that_falls_at_its_ends_is_made_to_rise():
    curve = np.linspace(-4, 2, 256)
    curve[:20] = np.linspace(-2, curve[20], 20)  # as extrapolation below the fog of a film gives
    curve[200] -= 1
    curve -= curve[128]
    rising = _rising(curve)
    assert (np.diff(rising) > 0).all()
    assert rising[128] == 0
    np.testing.assert_allclose(rising[25:195], curve[25:195], atol=1e-12)


def test_no_overlap_is_told():
    dark, bright = (Photo(np.full((8, 8), code, np.uint8), time) for code, time in ((0, 0.001), (255, 1.0)))
    with pytest.raises(ResponseError, match="closer together, or the right white level"):
        estimate_bracket_response([dark, bright])


def test_twelve_bits_without_their_white_level_are_told():
    photos = [
        replace(photo, white_level=65535) for photo in bracket(Camera(response="linear", bits=10), (1.0, 4.0))
    ]
    with pytest.raises(ResponseError, match="white level 65535"):
        estimate_bracket_response(photos)


def test_effective_exposures_use_iso_and_f_number():
    codes = np.zeros((2, 2), np.uint8)
    photos = [Photo(codes, 0.5, iso=100, f_number=4), Photo(codes, 0.5, iso=400, f_number=8), Photo(codes, 2.0)]
    np.testing.assert_allclose(bracket_exposures(photos[:2]), (0.5, 0.5))  # 4x the gain, a quarter of the light
    alike = [replace(photo, iso=100, f_number=None) for photo in photos[:2]] + [photos[2]]
    np.testing.assert_allclose(bracket_exposures(alike), (0.5, 0.5, 2.0))
    with pytest.raises(ExposureError, match="does not state its ISO"):
        bracket_exposures(photos)


CODES = np.full((4, 6), 100, np.uint8)


@pytest.mark.parametrize(
    ("photos", "error", "words"),
    [
        ([Photo(CODES, 1.0, name="a")], InputError, "got 1"),
        ([Photo(CODES, 1.0), Photo(CODES[:2], 2.0, name="b")], InputError, "b: .* size: it has 6x2"),
        ([Photo(CODES, 1.0), Photo(np.dstack([CODES] * 3), 2.0)], InputError, "channels"),
        ([Photo(CODES, 1.0), Photo(CODES, 2.0, 200)], InputError, "white level: it has 200"),
        ([Photo(CODES, 1.0), Photo(CODES, name="b")], ExposureError, "b: the exposure time is not known"),
        ([Photo(CODES, 1.0), Photo(CODES + 9, 1.005, name="b")], ExposureError, "b have the same exposure"),
        ([Photo(CODES, 2.0), Photo(CODES + 9, 1.0)], ExposureError, "contradict"),
    ],
)
def test_what_is_no_bracket_is_refused(photos, error, words):
    with pytest.raises(error, match=words):
        check_bracket(photos)
