import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import ResponseCurve
from stereohdr.response.toe import calibrate_toe, resolve_black
from stereohdr.simulation import Camera, expose


def counts_of(*cells, channels=1):
    counts = np.zeros((channels, 256, 256), int)
    for channel, short, long, pixels in cells:
        counts[channel, short, long] = pixels
    return counts


def test_a_code_moves_to_the_median_that_the_longer_exposure_sees():
    response = ResponseCurve.gamma(2.2, 1)
    g = response.log_exposure[0]
    # Of 900 pixels the 450th has the long code 4; the curve itself counts as 100 pixels.
    counts = counts_of((0, 2, 3, 449), (0, 2, 4, 2), (0, 2, 40, 449))
    found = calibrate_toe(response, counts, exposure_ratio=8.0).log_exposure[0]
    assert found[2] == pytest.approx(0.9 * (g[4] - np.log(8)) + 0.1 * g[2], abs=2e-6)
    np.testing.assert_allclose(np.delete(found, 2), np.delete(g, 2), atol=1e-6)


def test_each_channel_has_its_own_toe():
    response = ResponseCurve.gamma(2.2)
    g = response.log_exposure[0]
    counts = counts_of((1, 0, 4, 100), channels=3)
    found = calibrate_toe(response, counts, exposure_ratio=16.0).log_exposure
    assert found[1, 0] == pytest.approx(0.5 * (g[4] - np.log(16)) + 0.5 * g[0], abs=2e-6)
    np.testing.assert_allclose(found[[0, 2]], response.log_exposure[[0, 2]], atol=1e-6)


def test_codes_above_the_toe_stay():
    response = ResponseCurve.srgb(1)
    counts = counts_of((0, 4, 250, 10_000), (0, 100, 3, 10_000))
    found = calibrate_toe(response, counts, exposure_ratio=4.0)
    np.testing.assert_allclose(found.log_exposure, response.log_exposure, atol=1e-6)


def test_the_curve_keeps_rising():
    response = ResponseCurve.gamma(2.2, 1)
    g = response.log_exposure[0]
    counts = counts_of((0, 1, 255, 10_000), (0, 3, 255, 10_000))  # both want to be brighter than code 4
    found = calibrate_toe(response, counts, exposure_ratio=2.0)
    np.testing.assert_allclose(found.log_exposure[0, 3], g[4] - 0.001, atol=2e-6)
    assert found.is_monotone
    assert found.log_exposure[0, 1] <= found.log_exposure[0, 2] - 0.001 + 2e-6


@given(
    seed=st.integers(0, 200), ratio=st.floats(1.02, 1e12), lowest=st.sampled_from([-40.0, -39.999, -20.0, -5.0])
)
def test_any_counts_leave_a_rising_curve_within_bounds(seed, ratio, lowest):
    rng = np.random.default_rng(seed)
    response = ResponseCurve(np.interp(np.arange(256.0), [0, 128, 255], [lowest, 0, 1])[None])
    counts = np.zeros((1, 256, 256), int)
    counts[0, :6] = rng.integers(0, 50, (6, 256)) * (rng.random((6, 256)) < 0.01)
    assert calibrate_toe(response, counts, exposure_ratio=ratio).is_monotone


def test_the_dark_codes_of_a_simulated_camera_come_nearer_to_what_they_stand_for():
    """The true curve is off at its dark end, where read noise lifts what is black to code 1 and 2."""
    camera = Camera()
    rng = np.random.default_rng(4)
    scene = np.exp(rng.uniform(-11, -4, (300, 300, 1))).astype(np.float32)
    short, long = expose(scene, 1.0, camera, 1).codes[..., 0], expose(scene, 16.0, camera, 2).codes[..., 0]
    counts = np.histogram2d(short.ravel(), long.ravel(), np.arange(257) - 0.5)[0][None].astype(int)
    true = camera.response_curve(1)
    start = ResponseCurve(true.log_exposure - 0.8 * (np.arange(256) < 4) * (4 - np.arange(256)))
    found = calibrate_toe(start, counts, exposure_ratio=16.0)
    unit = np.median(scene[..., 0][short == 40]) / np.exp(true.log_exposure[0, 40])
    for code in range(4):
        radiance = np.log(np.median(scene[..., 0][short == code]) / unit)
        assert abs(found.log_exposure[0, code] - radiance) < 0.25
        assert abs(start.log_exposure[0, code] - radiance) > 0.3


def test_black_of_deep_codes_by_hand():
    start = ResponseCurve.gamma(1.0, 1)  # knots 1 and 2 stand for 1 / 128 and 2 / 128, and so knot 0 for nothing
    g = start.log_exposure[0]
    found = resolve_black(start, 4095).log_exposure[0]
    assert found[0] == pytest.approx(np.log(0.5 * 255 / 4095 / 128), abs=2e-6)  # half a code
    np.testing.assert_allclose(found[1:], g[1:], atol=1e-6)
    lifted = np.log(np.exp(g) + 0.1)
    found = resolve_black(ResponseCurve((lifted - lifted[128])[None]), 65535).log_exposure[0]
    assert found[0] == pytest.approx(np.log(0.1) - lifted[128], abs=2e-6)
    assert resolve_black(start, 255) is start


def test_black_stays_within_bounds():
    steep = ResponseCurve(np.interp(np.arange(256.0), [0, 128, 255], [-40, 0, 1])[None])
    found = resolve_black(steep, 65535)
    assert found.is_monotone
    assert found.log_exposure[0, 0] == -40


def test_deep_linear_codes_stay_linear_to_the_dark_end():
    found = resolve_black(ResponseCurve.gamma(1.0, 1), 4095)
    exposure = found.exposure_table(4095)[0]
    np.testing.assert_allclose(exposure[1:17], np.arange(1, 17) * exposure[1600] / 1600, rtol=0.5)
    np.testing.assert_allclose(exposure[8:17], np.arange(8, 17) * exposure[1600] / 1600, rtol=0.05)
