import numpy as np
import pytest

from stereohdr import Photo, ResponseCurve
from stereohdr.config import ExposureMapConfig
from stereohdr.errors import ResponseError
from stereohdr.radiance import clip_to_common_interval, code_luma, exposure_map, initial_radiance, luminance


def test_radiance_is_exposure_over_time_by_hand():
    codes = np.array([[[128, 64, 255]]], dtype=np.uint8)
    radiance = initial_radiance(Photo(codes), ResponseCurve.gamma(2.0), exposure=0.25)
    assert radiance.dtype == np.float32
    np.testing.assert_allclose(radiance[0, 0], [4.0, 1.0, 4 * (255 / 128) ** 2], rtol=1e-6)


def test_a_response_of_other_channels_is_refused():
    with pytest.raises(ResponseError, match=r"1 channel.* has 3"):
        initial_radiance(Photo(np.zeros((2, 2, 3), np.uint8)), ResponseCurve.srgb(1), exposure=1.0)


def test_luminance_weights():
    np.testing.assert_allclose(luminance(np.eye(3)[None])[0], [0.2126, 0.7152, 0.0722], rtol=1e-6)
    np.testing.assert_array_equal(luminance(np.full((2, 2, 1), 0.5)), np.full((2, 2), 0.5, np.float32))
    luma = code_luma(Photo((np.eye(3) * 255)[None].astype(np.uint8)))
    np.testing.assert_allclose(luma[0], np.array([0.299, 0.587, 0.114]) * 255, rtol=1e-5)


def test_s_includes_the_clipped_codes_and_excludes_the_thresholds():
    codes = np.array([[0, 4, 5, 6, 128, 250, 251, 255]], dtype=np.uint8)
    expected = [[True, True, False, False, False, False, True, True]]
    np.testing.assert_array_equal(exposure_map(Photo(codes)), expected)


def test_s_uses_the_luma_of_all_channels():
    red_only = np.array([[[255, 0, 0], [255, 255, 200]]], dtype=np.uint8)
    np.testing.assert_array_equal(exposure_map(Photo(red_only)), [[False, False]])
    config = ExposureMapConfig(under_threshold=77)
    np.testing.assert_array_equal(exposure_map(Photo(red_only), config=config), [[True, False]])


def test_thresholds_scale_with_the_white_level():
    codes = np.array([[0, 79, 81, 4000, 4020, 4095]], dtype=np.uint16)  # tau: 80.3 and 4014.7
    expected = [[True, True, False, False, True, True]]
    np.testing.assert_array_equal(exposure_map(Photo(codes, 1.0, 4095)), expected)


LINEAR = ResponseCurve.gamma(1.0)  # E(z) = z / 128 / t


def pixel(*values):
    return np.float32([[values]])


def test_both_views_are_cut_to_what_both_exposures_see():
    # Exposure 1 sees 2 / 128 to 247 / 128, exposure 4 a quarter of that: both see 2 / 128 to 61.75 / 128.
    low, high = 2 / 128, 247 / 128 / 4
    bright, dark = pixel(1.0, 0.2, 0.001), pixel(0.3, 0.5, 0.0)
    for exposures in ((1.0, 4.0), (4.0, 1.0)):
        main, auxiliary = clip_to_common_interval(bright, dark, LINEAR, exposures=exposures)
        np.testing.assert_allclose(main[0, 0], [high, 0.2, low], rtol=1e-6)
        np.testing.assert_allclose(auxiliary[0, 0], [0.3, high, low], rtol=1e-6)
        assert main.dtype == auxiliary.dtype == np.float32


def test_each_channel_has_its_own_interval():
    curves = np.stack([LINEAR.log_exposure[0], 2 * LINEAR.log_exposure[0], LINEAR.log_exposure[0]])
    main, _ = clip_to_common_interval(
        pixel(9.0, 9.0, 9.0), pixel(1.0, 1.0, 1.0), ResponseCurve(curves), exposures=(1.0, 2.0)
    )
    np.testing.assert_allclose(main[0, 0], [247 / 256, (247 / 128) ** 2 / 2, 247 / 256], rtol=1e-6)


def test_exposures_that_share_nothing_leave_one_value():
    # Exposure 1 begins at 2 / 128, exposure 400 ends at 247 / 128 / 400: between them there is nothing.
    middle = np.sqrt(2 / 128 * 247 / 128 / 400)
    main, auxiliary = clip_to_common_interval(
        pixel(1.0, 0.01, 0.0), pixel(0.005, 0.0, 3.0), LINEAR, exposures=(1.0, 400.0)
    )
    np.testing.assert_allclose(main[0, 0], middle, rtol=1e-6)
    np.testing.assert_allclose(auxiliary[0, 0], middle, rtol=1e-6)
