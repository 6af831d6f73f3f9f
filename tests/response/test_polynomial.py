import numpy as np
import pytest

from stereohdr import Disparity, DisparityFlag, Photo, ResponseCurve, StereoPair
from stereohdr.config import PolynomialResponseConfig
from stereohdr.response import fit_polynomial_response

TIMES = (0.1, 0.4)


def pair_of(response, *, seed=0, size=(80, 120), wrong=0.0):
    """Return a pair at disparity 0 of a camera with this inverse response, in part mismatched."""
    rng = np.random.default_rng(seed)
    scene = np.exp(rng.uniform(-2.5, 3.5, (*size, response.channels)))
    views = []
    for time in TIMES:
        codes = [
            np.searchsorted(g, np.log(scene[..., c] * time / np.sqrt(TIMES[0] * TIMES[1])))
            for c, g in enumerate(response.log_exposure)
        ]
        views.append(np.clip(np.stack(codes, axis=-1), 0, 255).astype(np.uint8))
    mismatched = rng.random(size) < wrong
    views[1][mismatched] = rng.integers(0, 256, (mismatched.sum(), response.channels))
    matched = Disparity(np.zeros(size, np.float32), np.full(size, DisparityFlag.MATCHED, np.uint8))
    return StereoPair(*(Photo(view, time) for view, time in zip(views, TIMES, strict=True))), matched


def error(curve, truth, codes=slice(10, 251)):
    return np.sqrt(((curve.log_exposure - truth.log_exposure)[:, codes] ** 2).mean())


@pytest.mark.parametrize("truth", [ResponseCurve.gamma(2.2), ResponseCurve.gamma(1.0, 1), ResponseCurve.srgb()])
@pytest.mark.parametrize("wrong", [0.0, 0.15])
def test_known_cameras_are_found(truth, wrong):
    found = fit_polynomial_response(*pair_of(truth, wrong=wrong))
    assert found is not None
    assert found.is_monotone
    assert error(found, truth) < (0.1 if wrong else 0.05)


def test_degree_0_is_a_gamma_curve():
    pair, matched = pair_of(ResponseCurve.gamma(1.8))
    found = fit_polynomial_response(pair, matched, config=PolynomialResponseConfig(degree=0))
    assert found is not None
    u = np.log((np.arange(256) + 0.5) / 128.5)
    slope = found.log_exposure[0, 255] / u[255]
    np.testing.assert_allclose(found.log_exposure[0], slope * u, atol=1e-5)
    assert slope == pytest.approx(1.8, abs=0.05)


def test_only_matched_pixels_inside_the_other_view_count():
    truth = ResponseCurve.gamma(2.2)
    pair, matched = pair_of(truth)
    values, flags = matched.values.copy(), matched.flags.copy()
    flags[:, 60:] = DisparityFlag.OCCLUDED
    values[:, 60:] = 7  # wrong
    values[:, :5] = 50  # outside
    found = fit_polynomial_response(pair, Disparity(values, flags))
    assert found is not None
    assert error(found, truth) < 0.05
    flags[:, 5:] = DisparityFlag.NOT_COMPUTED
    assert fit_polynomial_response(pair, Disparity(values, flags)) is None


def test_a_channel_without_codes_takes_the_mean_and_a_falling_relation_gives_none():
    pair, matched = pair_of(ResponseCurve.gamma(2.2))
    left = pair.left.codes.copy()
    left[..., 1] = 255
    found = fit_polynomial_response(StereoPair(Photo(left, TIMES[0]), pair.right), matched)
    assert found is not None
    np.testing.assert_allclose(found.log_exposure[1], found.log_exposure[[0, 2]].mean(axis=0))
    exchanged = StereoPair(Photo(pair.left.codes, TIMES[1]), Photo(pair.right.codes, TIMES[0]))
    assert fit_polynomial_response(exchanged, matched) is None
