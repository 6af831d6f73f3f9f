import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import ResponseCurve
from stereohdr.config import ParametricResponseConfig
from stereohdr.response.parametric import fit_parametric_response, median_code_pairs, mid_rank_pairs
from stereohdr.simulation import Camera, expose

LOG_RATIO = np.log(8.0)
KNOTS = np.arange(256.0)


def exact_pairs(curve, log_ratio=LOG_RATIO, codes=KNOTS[5:248:3]):
    """Return pairs that satisfy ``g(z_main) - g(z_auxiliary) = log_ratio`` for a curve ``(256,)``."""
    partner = np.interp(curve[codes.astype(int)] - log_ratio, curve, KNOTS)
    seen = (partner >= 5) & (partner <= 247)
    codes, partner = codes[seen], partner[seen]
    return np.column_stack([codes, partner, np.full(len(codes), 100.0), np.full(len(codes), log_ratio)])


def error(found, truth, codes=slice(5, 251)):
    """Return the RMS difference of ln X over the codes 5 to 250."""
    return np.sqrt(((found.log_exposure - truth.log_exposure)[:, codes] ** 2).mean())


CURVES = {
    "linear": ResponseCurve.gamma(1.0),
    "gamma 1.8": ResponseCurve.gamma(1.8),
    "gamma 2.6": ResponseCurve.gamma(2.6),
    "sRGB": ResponseCurve.srgb(),
    "S": Camera(response="s-shaped").response_curve(3),
}


@pytest.mark.parametrize("truth", CURVES.values(), ids=CURVES)
@pytest.mark.parametrize("log_ratio", [LOG_RATIO, -LOG_RATIO], ids=["long-short", "short-long"])
def test_exact_pairs_give_the_curve(truth, log_ratio):
    fitted = fit_parametric_response([exact_pairs(g, log_ratio) for g in truth.log_exposure])
    assert fitted is not None
    curve, residual = fitted
    assert error(curve, truth) < 0.025
    assert residual < 0.01
    assert curve.is_monotone
    np.testing.assert_array_equal(curve.log_exposure[:, 128], 0)


def test_pairs_of_several_exposure_ratios_are_joined():
    """Codes of one ratio leave room: X and X times any function of period ln 8 fit as well."""
    truth = ResponseCurve.gamma(2.0, 1)
    rows = [exact_pairs(truth.log_exposure[0], np.log(ratio), KNOTS[5:248:20]) for ratio in (2.0, 5.0, 1 / 3)]
    fitted = fit_parametric_response([np.concatenate(rows)])
    assert fitted is not None
    assert error(fitted[0], truth) < 0.01


def test_wrong_pairs_are_outvoted():
    truth = ResponseCurve.srgb()
    rng = np.random.default_rng(1)
    samples = [exact_pairs(g, codes=KNOTS[5:248]) for g in truth.log_exposure]
    for rows in samples:
        wrong = rng.random(len(rows)) < 0.25
        rows[wrong, 1] = rng.uniform(10, 240, wrong.sum())
    fitted = fit_parametric_response(samples)
    assert fitted is not None
    assert error(fitted[0], truth) < 0.03
    trusting = fit_parametric_response(samples, config=ParametricResponseConfig(outlier_scale=10.0))
    assert trusting is not None
    assert error(trusting[0], truth) > 2 * error(fitted[0], truth)


@pytest.mark.parametrize("camera", [Camera(response=name) for name in ("linear", "gamma", "srgb", "s-shaped")],
                         ids=lambda camera: camera.response)  # fmt: skip
def test_noisy_codes_of_a_simulated_camera_give_its_curve(camera):
    rng = np.random.default_rng(2)
    scene = np.exp(rng.uniform(-6, 2, (200, 300, 3))).astype(np.float32)
    times = (1.0, 0.125)
    main, auxiliary = (expose(scene, time, camera, seed).codes for seed, time in enumerate(times))
    samples = []
    for c in range(3):
        counts = np.histogram2d(main[..., c].ravel(), auxiliary[..., c].ravel(), np.arange(257) - 0.5)[0]
        samples.append(median_code_pairs(counts.astype(int), np.log(times[0] / times[1])))
    fitted = fit_parametric_response(samples)
    assert fitted is not None
    assert error(fitted[0], camera.response_curve(3)) < 0.035


def test_an_empty_channel_follows_the_others():
    truth = ResponseCurve.gamma(2.2)
    samples = [exact_pairs(truth.log_exposure[0]), np.zeros((0, 4)), exact_pairs(truth.log_exposure[2])]
    fitted = fit_parametric_response(samples)
    assert fitted is not None
    assert error(fitted[0], truth) < 0.02


def test_the_tie_draws_channels_together():
    truth = [ResponseCurve.gamma(2.0, 1).log_exposure[0], ResponseCurve.gamma(2.4, 1).log_exposure[0]]
    samples = [exact_pairs(g) for g in (truth[0], truth[1], truth[1])]
    free, tied = (
        fit_parametric_response(samples, config=ParametricResponseConfig(tie=tie, outlier_scale=10.0))
        for tie in (0.0, 1000.0)
    )
    assert free is not None
    assert tied is not None
    assert np.abs(free[0].log_exposure[0, 10] - truth[0][10]) < 0.02
    apart = [np.abs(np.diff(fitted[0].log_exposure[:, 10])).max() for fitted in (free, tied)]
    assert apart[1] < 0.02 * apart[0]


def test_degree_0_mixes_a_gamma_and_the_srgb_curve():
    truth = ResponseCurve.gamma(1.5, 1)
    config = ParametricResponseConfig(degree=0)
    fitted = fit_parametric_response([exact_pairs(truth.log_exposure[0])], config=config)
    assert fitted is not None
    u = np.log((KNOTS + 0.5) / 128.5)
    basis = np.column_stack([u, ResponseCurve.srgb(1).log_exposure[0]])
    share, *_ = np.linalg.lstsq(basis, fitted[0].log_exposure[0], rcond=None)
    np.testing.assert_allclose(basis @ share, fitted[0].log_exposure[0], atol=2e-6)


def test_pairs_with_few_pixels_count_less():
    right = exact_pairs(ResponseCurve.gamma(2.2, 1).log_exposure[0])
    wrong = exact_pairs(ResponseCurve.gamma(1.6, 1).log_exposure[0])
    config = ParametricResponseConfig(outlier_scale=10.0)  # a plain mean
    found = []
    for pixels in (1.0, 100.0):
        wrong[:, 2] = pixels
        fitted = fit_parametric_response([np.concatenate([right, wrong])], config=config)
        assert fitted is not None
        found.append(error(fitted[0], ResponseCurve.gamma(2.2, 1)))
    assert found[0] < 0.05 < found[1]


def test_what_no_pair_decides_is_srgb():
    codes = KNOTS[20:100]
    rows = np.column_stack([codes, codes, np.full(80, 100.0), np.full(80, 1.0)])  # equal codes: no equation at all
    fitted = fit_parametric_response([rows, rows, rows])
    assert fitted is not None
    np.testing.assert_allclose(fitted[0].log_exposure, ResponseCurve.srgb().log_exposure, atol=2e-6)


def test_too_few_pairs_and_falling_relations_give_none():
    rows = exact_pairs(ResponseCurve.gamma(2.2, 1).log_exposure[0])
    assert fit_parametric_response([rows[:7]]) is None
    assert fit_parametric_response([rows[:3], rows[3:5], rows[5:7]]) is None
    assert fit_parametric_response([rows[:8]]) is not None
    exchanged = rows[:, [1, 0, 2, 3]]  # the brighter view has the darker codes
    assert fit_parametric_response([exchanged]) is None


def test_a_curve_beyond_all_bounds_gives_none():
    """Codes that differ by 1 at a ratio of 256 would ask for ln X of several hundred."""
    codes = KNOTS[20:240]
    rows = np.column_stack([codes, codes - 1, np.full(220, 100.0), np.full(220, np.log(256))])
    assert fit_parametric_response([rows]) is None


@given(
    channels=st.sampled_from([1, 3]),
    pairs=st.integers(0, 40),
    log_ratio=st.floats(-12, 12),
    seed=st.integers(0, 1000),
    degree=st.integers(0, 8),
)
def test_whatever_comes_out_rises_and_is_0_in_the_middle(channels, pairs, log_ratio, seed, degree):
    rng = np.random.default_rng(seed)
    samples = [
        np.column_stack(
            [rng.uniform(0, 255, (pairs, 2)), rng.integers(1, 10**6, pairs), np.full(pairs, log_ratio)]
        )
        for _ in range(channels)
    ]
    if seed % 2:
        for rows in samples:
            rows[:, :2].sort(axis=1)
    fitted = fit_parametric_response(samples, config=ParametricResponseConfig(degree=degree))
    if fitted is None:
        return
    curve, residual = fitted
    assert curve.channels == channels
    assert curve.is_monotone
    np.testing.assert_array_equal(curve.log_exposure[:, 128], 0)
    assert np.isfinite(residual)


def test_median_code_pairs_by_hand():
    counts = np.zeros((256, 256), int)
    counts[100, 200], counts[100, 201] = 60, 40
    counts[30, 90] = 39  # too few
    counts[50, 240], counts[50, 255] = 80, 20  # one in five is clipped: still used
    counts[60, 230], counts[60, 255] = 79, 21
    counts[3, 20] = 500  # out of range itself
    found = median_code_pairs(counts, 1.5)
    expected = [
        # Half of the 80 + 20 pixels is 50: 50 / 80 through the pixels of code 240, which spans 239.5 to 240.5.
        [50, 239.5 + 50 / 80, 100, 1.5],
        [100, 199.5 + 50 / 60, 100, 1.5],
        # The other way round: every partner is a single code, whose middle it is. The columns keep their places.
        [100, 200, 60, 1.5],
        [100, 201, 40, 1.5],
        [60, 230, 79, 1.5],
        [50, 240, 80, 1.5],
    ]
    np.testing.assert_allclose(found, expected)


def test_a_median_out_of_range_is_left_out():
    counts = np.zeros((256, 256), int)
    counts[100, 3] = 50
    config = ParametricResponseConfig(most_outside=1.0)
    assert len(median_code_pairs(counts, 1.0, config=config)) == 0
    config = ParametricResponseConfig(most_outside=1.0, lowest_code=3)
    np.testing.assert_allclose(median_code_pairs(counts, 1.0, config=config), [[100, 3, 50, 1]] * 2)


def test_mid_rank_pairs_by_hand():
    main, auxiliary = np.zeros(256, int), np.zeros(256, int)
    main[50] = 200  # a coarse code: all of 79 to 81, and so their middle
    auxiliary[79], auxiliary[81] = 100, 100
    # 79 has the rank 1/4; 49 has 0 and 50 has 1/2, so it pairs with 49.5. 81 has 3/4; 51 has 1: 50.5.
    expected = [[50, 80, 200, 0.7], [49.5, 79, 100, 0.7], [50.5, 81, 100, 0.7]]
    np.testing.assert_allclose(mid_rank_pairs(main, auxiliary, 0.7), expected)


def test_mid_rank_pairs_leave_out_rare_and_extreme_codes():
    main, auxiliary = np.zeros(256, int), np.zeros(256, int)
    main[[2, 5, 100, 150, 252]] = [100, 50, 100, 39, 61]
    auxiliary[[3, 1, 120, 180, 253]] = [50, 100, 100, 39, 61]  # code 5 of the main view pairs with 3
    np.testing.assert_allclose(mid_rank_pairs(main, auxiliary, 1.0), [[100, 120, 100, 1]] * 2)
    config = ParametricResponseConfig(fewest_pixels=39, highest_code=254)
    np.testing.assert_allclose(
        mid_rank_pairs(main, auxiliary, 1.0, config=config)[:3],
        [[100, 120, 100, 1], [150, 180, 39, 1], [252, 253, 61, 1]],
    )


def test_empty_histograms_give_no_pairs():
    empty = np.zeros(256, int)
    assert mid_rank_pairs(empty, empty, 1.0).shape == (0, 4)
    assert median_code_pairs(np.zeros((256, 256), int), 1.0).shape == (0, 4)
