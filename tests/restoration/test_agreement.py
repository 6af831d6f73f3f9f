import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Photo, ResponseCurve
from stereohdr.config import AgreementConfig
from stereohdr.restoration.agreement import agrees_with_main, supported

LINEAR = ResponseCurve.gamma(1.0, 1)  # E(z) = z / 128 / t


def agree(codes, values, *, exposures=(1.0, 4.0), known=None, response=LINEAR, white=255, **options):
    """Compare a row of main codes with a row of warped radiance, one channel."""
    codes = np.array(codes, np.uint8 if white == 255 else np.uint16).reshape(1, len(codes), -1)
    warped = np.array(values, np.float32).reshape(codes.shape)
    known = np.ones(codes.shape, bool) if known is None else np.array(known).reshape(codes.shape)
    return agrees_with_main(
        Photo(codes, white_level=white), warped, known, response, exposures=exposures, **options
    )[0]


def test_a_code_stands_for_an_interval():
    # 10 codes and 10 % around code 100: 0.9 * 90 / 128 to 1.1 * 110 / 128.
    low, high = 0.9 * 90 / 128, 1.1 * 110 / 128
    found = agree([100] * 4, [0.999 * low, 1.001 * low, 0.999 * high, 1.001 * high])
    np.testing.assert_array_equal(found, [False, True, True, False])
    np.testing.assert_array_equal(agree([100] * 2, [low / 2, high / 2], exposures=(2.0, 8.0)), [True, True])
    found = agree([100] * 2, [1.01 * high, 1.29 / 1.1 * high], slack=0.3)
    np.testing.assert_array_equal(found, [True, True])
    config = AgreementConfig(codes=0, slack=0)
    np.testing.assert_array_equal(
        agree([100] * 3, [99.9 / 128, 100 / 128, 100.1 / 128], config=config), [False, True, False]
    )


def test_a_white_code_has_no_upper_limit_and_a_black_one_no_lower():
    found = agree([244, 245, 245, 255], [1e6, 1e6, 0.5, 1e6])
    np.testing.assert_array_equal(found, [False, True, False, True])
    found = agree([11, 10, 10, 0], [0.0, 0.0, 1.0, 0.0])
    np.testing.assert_array_equal(found, [False, True, False, True])


def test_limits_scale_with_the_white_level():
    white = 4095
    near = [round(z / 255 * white) for z in (244, 245.1, 10.9, 9.9)]
    np.testing.assert_array_equal(agree(near, [1e6, 1e6, 0, 0], white=white), [False, True, False, True])
    # Code 100.5 of 255: 90.5 and 110.5 around it.
    values = [0.999 * 1.1 * 110.5 / 128, 1.002 * 1.1 * 110.5 / 128]
    np.testing.assert_array_equal(agree([1614, 1614], values, white=white), [True, False])


def test_the_coarser_codes_of_a_shorter_auxiliary_exposure_are_intervals_too():
    # The main view's interval ends at 0.633 and 0.945. Four codes of a quarter of the exposure are 4 * 4 / 128.
    low, high = 0.9 * 90 / 128, 1.1 * 110 / 128
    values = [low - 0.13, low - 0.12, high + 0.12, high + 0.13]
    np.testing.assert_array_equal(agree([100] * 4, values, exposures=(1.0, 0.25)), [False, True, True, False])
    np.testing.assert_array_equal(agree([100] * 4, values, exposures=(1.0, 4.0)), [False] * 4)
    exact = AgreementConfig(auxiliary_codes=0)
    np.testing.assert_array_equal(agree([100] * 4, values, exposures=(1.0, 0.25), config=exact), [False] * 4)
    # Below code 4 the auxiliary view may have seen nothing at all.
    np.testing.assert_array_equal(agree([0, 0], [0.12, 0.3], exposures=(1.0, 0.25)), [True, False])


def test_every_known_channel_must_agree_and_unknown_ones_do_not_count():
    good, bad = 100 / 128, 5.0
    values = [[good, good, good], [good, bad, good], [good, bad, good], [bad, bad, bad]]
    known = [[True, True, True], [True, True, True], [True, False, True], [False, False, False]]
    found = agree([[100] * 3] * 4, values, known=known, response=ResponseCurve.gamma(1.0))
    np.testing.assert_array_equal(found, [True, False, True, True])


@given(
    code=st.integers(0, 255),
    shift=st.floats(-4, 4),
    ratio=st.sampled_from([0.1, 0.5, 2.0, 30.0]),
    exponent=st.floats(0.5, 3.0),
)
def test_what_the_code_itself_stands_for_always_agrees(code, shift, ratio, exponent):
    response = ResponseCurve.gamma(exponent, 1)
    position = np.clip(code + shift, 0, 255)
    value = np.interp(position, np.arange(256), np.exp(response.log_exposure[0])) / 0.02
    assert agree([code], [value], exposures=(0.02, 0.02 * ratio), response=response).all()


def test_a_pixel_needs_more_than_half_of_its_window():
    mask = np.zeros((9, 9), bool)
    mask[2:4, 2:7] = mask[4, 2:5] = True  # 13 of the 25 around (4, 4)
    assert supported(mask, radius=2)[4, 4]
    mask[2, 2] = False
    assert not supported(mask, radius=2)[4, 4]
    assert not supported(np.pad(np.ones((1, 1), bool), 3), radius=1).any()
    everywhere = np.ones((4, 3), bool)
    np.testing.assert_array_equal(supported(everywhere, radius=2), everywhere)
    rng = np.random.default_rng(0)
    noise = rng.random((6, 7)) < 0.5
    np.testing.assert_array_equal(supported(noise, radius=0), noise)


@pytest.mark.parametrize("radius", [1, 2, 3])
def test_nothing_new_is_supported(radius):
    mask = np.random.default_rng(1).random((20, 30)) < 0.6
    found = supported(mask, radius=radius)
    assert not (found & ~mask).any()
    assert 0 < found.sum() < mask.sum()
