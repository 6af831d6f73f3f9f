from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr import Photo, ResponseCurve
from stereohdr.config import ShadowsConfig
from stereohdr.restoration import shadows
from stereohdr.restoration.shadows import clean_shadows, noise_curve

from reference import shadows as twin

RATIO = 8.0
"""Exposure of the auxiliary view against the main view's, which is 1 s."""

READ_NOISE = 0.6
"""Standard deviation in codes."""


def linear_views(truth, *, seed=0, white=255, read_noise=READ_NOISE):
    """Two noisy photos of one linear sensor in the same pixels: main photo, M, A, usable, and the response."""
    rng = np.random.default_rng(seed)
    response = ResponseCurve.linear(truth.shape[2])
    codes = []
    for time in (1.0, RATIO):
        noisy = truth * time * white + rng.normal(0, read_noise * white / 255, truth.shape)
        codes.append(np.rint(np.clip(noisy, 0, white)).astype(np.uint8 if white == 255 else np.uint16))
    main, auxiliary = (response.apply(view, white) for view in codes)
    return Photo(codes[0], 1.0, white), main, auxiliary / np.float32(RATIO), codes[1] < white, response


def textured(height, width, channels=1, *, low=0.01, high=0.11, seed=1):
    """A smooth surface, radiance of the white level 1."""
    rng = np.random.default_rng(seed)
    surface = ndimage.gaussian_filter(rng.standard_normal((height, width, channels)), (3, 3, 0))
    surface = (surface - surface.min()) / np.ptp(surface)
    return low + (high - low) * surface


def assert_equals_twin(main, radiance, auxiliary, usable, response, config=None, *, exposure=1.0):
    config = config or ShadowsConfig()
    got = clean_shadows(main, radiance, auxiliary, usable, response, exposure=exposure, config=config)
    expected = twin.clean_shadows(main, radiance, auxiliary, usable, response, exposure=exposure, config=config)
    np.testing.assert_allclose(got[0], expected[0], rtol=1e-6)
    np.testing.assert_allclose(got[1], expected[1], rtol=1e-5, atol=1e-6)
    return got


@given(
    seed=st.integers(0, 1000),
    height=st.integers(1, 40),
    width=st.integers(1, 40),
    channels=st.sampled_from([1, 3]),
    radius=st.integers(1, 5),
    noise_radius=st.integers(1, 3),
    known=st.sampled_from([0.0, 0.3, 0.9, 1.0]),
)
def test_equals_the_twin(seed, height, width, channels, radius, noise_radius, known):
    rng = np.random.default_rng(seed)
    truth = textured(height + 1, width + 1, channels, low=0.001, high=0.5, seed=seed)[:height, :width]
    main, radiance, auxiliary, usable, response = linear_views(truth, seed=seed)
    usable &= rng.random(usable.shape) < known
    auxiliary[rng.random(usable.shape) < 0.05] *= 20  # wrong matches
    auxiliary[~usable] = np.nan  # must not matter
    config = ShadowsConfig(radius=radius, noise_radius=noise_radius)
    assert_equals_twin(main, radiance, auxiliary, usable, response, config)


@pytest.mark.parametrize("usable", [True, False])
@pytest.mark.parametrize("code", [0, 7, 255])
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 30, 3), (30, 1, 1), (40, 40, 3)])
def test_equals_the_twin_where_nothing_varies(shape, code, usable):
    main = Photo(np.full(shape, code, np.uint8), 1.0)
    response = ResponseCurve.gamma(2.2, shape[2])
    radiance = response.apply(main.codes, 255)
    auxiliary = np.full(shape, 0.01, np.float32)
    cleaned, share = assert_equals_twin(main, radiance, auxiliary, np.full(shape, usable), response)
    assert (cleaned > 0).all()
    if not usable:
        np.testing.assert_array_equal(cleaned, radiance)
        np.testing.assert_array_equal(share, 0)


def test_equals_the_twin_on_16_bits_over_several_strips(monkeypatch):
    views = linear_views(textured(90, 50, 3), white=4095)
    cleaned, share = assert_equals_twin(*views)
    monkeypatch.setattr(shadows, "STRIP_ROWS", 7)
    in_strips = assert_equals_twin(*views)
    np.testing.assert_allclose(in_strips[0], cleaned, rtol=1e-6)
    np.testing.assert_allclose(in_strips[1], share, atol=1e-6)


def test_a_bright_area_does_not_disturb_the_dark_beside_it():
    truth = textured(60, 80, low=0.002, high=0.004)
    truth[20:30, 20:40] = 0.9
    main, radiance, auxiliary, usable, response = linear_views(truth)
    usable[...] = True
    assert_equals_twin(main, radiance, auxiliary, usable, response)


def test_threads_do_not_change_the_bytes(monkeypatch):
    monkeypatch.setattr(shadows, "STRIP_ROWS", 16)
    views = linear_views(textured(70, 60, 3))
    one, four = (clean_shadows(*views, exposure=1.0, threads=threads) for threads in (1, 4))
    np.testing.assert_array_equal(one[0], four[0])
    np.testing.assert_array_equal(one[1], four[1])


def test_the_noise_is_measured():
    truth = textured(300, 300)
    _, radiance, auxiliary, usable, _ = linear_views(truth)
    # A code is 1/128, rounding adds 1/12 of its square; the auxiliary view's own noise is 8 times smaller.
    expected = (READ_NOISE**2 + 1 / 12) / 128**2
    levels, log_variance = noise_curve(radiance, auxiliary, usable, channel=0, radius=2)
    assert len(levels) == shadows.LEVELS
    assert np.median(np.exp(log_variance)) == pytest.approx(expected, rel=0.1)
    np.testing.assert_allclose(np.exp(log_variance), expected, rtol=0.25)


def test_some_windows_of_a_large_image_tell_as_much_as_all(monkeypatch):
    _, radiance, auxiliary, usable, _ = linear_views(textured(300, 300))
    in_64_bits = (image[..., 0].astype(np.float64) for image in (radiance, auxiliary))
    of_all, of_all_variance = twin.noise_curve(*in_64_bits, usable[..., 0], 2)
    monkeypatch.setattr(shadows, "MOST_WINDOWS", 12_000)
    levels, log_variance = noise_curve(radiance, auxiliary, usable, channel=0, radius=2)
    np.testing.assert_allclose(levels, of_all, atol=0.03)
    np.testing.assert_allclose(log_variance, of_all_variance, atol=0.2)
    assert np.mean(log_variance - of_all_variance) == pytest.approx(0, abs=0.05)


def test_noise_falls_and_the_mean_stays():
    truth = textured(120, 160, low=0.01, high=0.05)
    main, radiance, auxiliary, usable, response = linear_views(truth)
    truth = truth * 255 / 128  # the mid code is 1
    cleaned, share = clean_shadows(main, radiance, auxiliary, usable, response, exposure=1.0)
    before, after = (np.sqrt(np.mean((image - truth) ** 2)) for image in (radiance, cleaned))
    assert after < 0.35 * before
    assert cleaned.mean() == pytest.approx(truth.mean(), rel=0.005)
    assert share.mean() > 0.5


def test_structure_that_only_the_auxiliary_view_shows_appears_at_the_level_of_the_main_view():
    truth = np.full((60, 80, 1), 0.02)
    truth[:, 40:] = 0.03
    main, radiance, auxiliary, usable, response = linear_views(truth, read_noise=2.0)
    cleaned, _ = clean_shadows(main, radiance, 1.1 * auxiliary, usable, response, exposure=1.0)  # 10 % off
    left, right = cleaned[5:-5, 30:39].mean(), cleaned[5:-5, 41:50].mean()
    assert left == pytest.approx(radiance[:, :40].mean(), rel=0.05)
    assert right == pytest.approx(radiance[:, 40:].mean(), rel=0.05)
    assert cleaned[5:-5, 30:39].std() < 0.3 * radiance[5:-5, 30:39].std()


def test_clean_pixels_keep_their_value_exactly():
    truth = textured(60, 80, low=0.005, high=0.01)
    truth[:, 40:] = textured(60, 40, low=0.5, high=0.9, seed=2)  # noise below 1 %
    main, radiance, auxiliary, usable, response = linear_views(truth)
    usable[...] = True
    auxiliary[:, 40:] = (truth[:, 40:] * 255 / 128).astype(np.float32)
    cleaned, share = clean_shadows(main, radiance, auxiliary, usable, response, exposure=1.0)
    bright = np.s_[:, 50:]
    np.testing.assert_array_equal(cleaned[bright], radiance[bright])
    np.testing.assert_array_equal(share[bright], 0)
    assert (cleaned[:, :30] != radiance[:, :30]).mean() > 0.9


def test_a_wrong_match_does_no_harm():
    truth = textured(80, 80, low=0.03, high=0.05)
    main, radiance, auxiliary, usable, response = linear_views(truth)
    auxiliary[30:33, 30:33] *= 10
    wrong = np.s_[30:33, 30:33]
    cleaned, _ = clean_shadows(main, radiance, auxiliary, usable, response, exposure=1.0)
    assert np.abs(cleaned[wrong] - radiance[wrong]).max() < 1 / 128  # a code, where A is 90 codes off
    error = np.abs(cleaned - truth * 255 / 128)
    assert error[wrong].mean() < 0.005
    assert error[25:38, 25:38].mean() < 0.7 * np.abs(radiance - truth * 255 / 128)[25:38, 25:38].mean()


def test_what_only_the_main_view_sees_is_left_alone():
    truth = textured(80, 80, low=0.03, high=0.05)
    auxiliary_truth = truth.copy()
    truth[30:33, 30:33] += 0.2  # a gloss
    main, radiance, _, usable, response = linear_views(truth)
    _, _, auxiliary, _, _ = linear_views(auxiliary_truth, seed=5)
    gloss = np.s_[30:33, 30:33]
    cleaned, share = clean_shadows(main, radiance, auxiliary, usable, response, exposure=1.0)
    np.testing.assert_allclose(cleaned[gloss], radiance[gloss], rtol=0.02)
    assert share[gloss].max() < 0.05
    assert np.median(share) > 0.5


def test_what_the_auxiliary_view_does_not_see_is_smoothed_less():
    truth = np.full((60, 80, 1), 0.03)
    main, radiance, auxiliary, usable, response = linear_views(truth)
    usable[:, 40:] = False
    cleaned, share = clean_shadows(main, radiance, auxiliary, usable, response, exposure=1.0)
    alone, seen = np.s_[10:-10, 50:70], np.s_[10:-10, 10:30]
    assert cleaned[seen].std() < cleaned[alone].std() < 0.7 * radiance[alone].std()
    assert share[alone].max() <= ShadowsConfig().alone_share


@given(
    seed=st.integers(0, 1000),
    radius=st.integers(1, 8),
    scale=st.sampled_from([1e-9, 1.0, 1e9]),
    flat=st.booleans(),
    clean_noise=st.sampled_from([1e-6, 0.01, 10.0]),
)
def test_the_result_is_finite_and_positive(seed, radius, scale, flat, clean_noise):
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 30)), int(rng.integers(1, 30)), 1)
    main = Photo(rng.integers(0, 256, shape, dtype=np.uint8), 1.0)
    response = ResponseCurve(np.zeros((1, 256))) if flat else ResponseCurve.srgb(1)
    radiance = response.apply(main.codes, 255) * np.float32(scale)
    auxiliary = (rng.exponential(1.0, shape) * scale * rng.choice([0, 1e-6, 1, 1e6], shape)).astype(np.float32)
    config = replace(ShadowsConfig(), radius=radius, clean_noise=clean_noise)
    cleaned, share = clean_shadows(
        main, radiance, auxiliary, rng.random(shape) < 0.8, response, exposure=1 / scale, config=config
    )
    assert np.isfinite(cleaned).all()
    assert (cleaned > 0).all()
    assert share.min() >= 0
    assert share.max() <= 1
