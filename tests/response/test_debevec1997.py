import numpy as np
import pytest

from stereohdr.response import debevec_weight, solve_response

from reference import response as twin


def samples_of(curve, times, rng, points=200):
    exposures = np.exp(rng.uniform(-6, 2, points))
    return np.stack([np.clip(curve(exposures * t), 0, 255).astype(int) for t in times], axis=1)


def gamma_codes(exposure):
    return np.rint(255 * np.clip(exposure, 0, 1) ** (1 / 2.2))


@pytest.mark.parametrize("times", [(0.25, 1.0), (0.125, 0.5, 2.0)])
@pytest.mark.parametrize("smoothness", [20.0, 100.0])
def test_elimination_equals_the_full_system(times, smoothness):
    samples = samples_of(gamma_codes, times, np.random.default_rng(0), points=60)
    got = solve_response(samples, times, smoothness=smoothness)
    np.testing.assert_allclose(got, twin.solve_response(samples, times, smoothness), atol=2e-6)


def test_weights_are_the_hat_that_is_one_at_the_ends():
    np.testing.assert_array_equal(debevec_weight([0, 1, 127, 128, 254, 255]), [1, 2, 128, 128, 2, 1])


def test_a_gamma_camera_is_recovered_between_the_clipped_ends():
    times = (0.25, 1.0)
    samples = samples_of(gamma_codes, times, np.random.default_rng(1), points=4000)
    samples = samples[((samples > 0) & (samples < 255)).all(axis=1)]
    curve = solve_response(samples, times)
    assert curve[128] == 0
    codes = np.arange(20, 240)
    np.testing.assert_allclose(curve[codes], 2.2 * np.log(codes / 128), atol=0.06)


def test_only_exposure_ratios_matter():
    samples = samples_of(gamma_codes, (0.25, 1.0), np.random.default_rng(2))
    np.testing.assert_allclose(
        solve_response(samples, (0.25, 1.0)), solve_response(samples, (250.0, 1000.0)), atol=2e-6
    )
