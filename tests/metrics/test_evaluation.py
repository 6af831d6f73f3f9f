import sys

import numpy as np
import pytest

from stereohdr import Disparity, DisparityFlag, InputError, Photo, ResponseCurve
from stereohdr.errors import ConfigError, StereoHdrWarning
from stereohdr.metrics import aligning_scale
from stereohdr.metrics.evaluation import evaluate
from stereohdr.metrics.hdrvdp2 import hdrvdp2
from stereohdr.metrics.protocol import Protocol
from stereohdr.metrics.pu21 import pu21_psnr
from stereohdr.metrics.radiometric import log2_rmse, response_rmse, share_off
from stereohdr.metrics.stereo import bad_share, end_point_error


@pytest.fixture(scope="module")
def images():
    rng = np.random.default_rng(0)
    reference = rng.lognormal(0, 1, (40, 48, 3)).astype(np.float32)
    return (reference * rng.lognormal(0, 0.1, reference.shape)).astype(np.float32), reference


def test_the_reference_is_shown_with_its_99th_percentile_at_100_cd(images):
    test, reference = images
    shown_test, shown_reference, report = Protocol().show(test, reference)
    luminance = shown_reference @ [0.2126, 0.7152, 0.0722]
    assert np.percentile(luminance, 99) == pytest.approx(100, rel=1e-5)
    ratio = (shown_reference @ [0.2126, 0.7152, 0.0722]) / (shown_test @ [0.2126, 0.7152, 0.0722])
    assert np.median(ratio) == pytest.approx(1, rel=1e-5)
    for word in ("30 pixels per degree", "rgb-bt.709", "p99", "100 cd/m2", "aligned"):
        assert word in report


def test_a_common_factor_on_the_test_is_aligned_away_or_not(images):
    test, reference = images
    one, other = (Protocol().show(t, reference)[0] for t in (test, test * np.float32(7)))
    np.testing.assert_allclose(one, other, rtol=1e-5)
    unaligned = Protocol(align=False, peak_luminance=0)
    shown_test, shown_reference, report = unaligned.show(test, reference)
    np.testing.assert_allclose(shown_test, test)
    np.testing.assert_allclose(shown_reference, reference)
    assert "not aligned" in report
    assert "absolute" in report


def test_the_main_photo_says_which_pixels_align():
    reference = np.ones((20, 20, 1), np.float32)
    test = reference.copy()
    test[:, :5] = 0.5
    codes = np.zeros((20, 20, 1), np.uint8)
    codes[:, :5] = 128
    assert aligning_scale(test, reference) == pytest.approx(1)
    assert aligning_scale(test, reference, Photo(codes, 1.0)) == pytest.approx(2)


def test_scores_are_those_of_the_single_metrics(images):
    test, reference = images
    shown = Protocol().show(test, reference)
    result = evaluate(test, reference)
    vdp = hdrvdp2(shown[0], shown[1], encoding="rgb-bt.709", pixels_per_degree=30)
    assert result.scores["hdrvdp2"] == {"q": vdp.q, "q_mos": vdp.q_mos, "p_det": vdp.p_det, "c_max": vdp.c_max}
    assert result.scores["pu21_psnr"] == pu21_psnr(shown[0], shown[1])
    assert result.scores["protocol"]["encoding"] == "rgb-bt.709"
    assert result.scores["protocol"]["report"] == result.report
    assert result.hdrvdp2 is not None


def test_equal_images_score_best(images):
    scores = evaluate(images[1], images[1]).scores
    assert scores["hdrvdp2"]["q"] == pytest.approx(100)
    assert scores["pu21_psnr"] > 150  # the aligning factor is 1 up to rounding
    exact = evaluate(images[1], images[1], protocol=Protocol(align=False), metrics=["pu21"]).scores
    assert exact["pu21_psnr"] is None  # infinite
    assert scores["pu21_ssim"] == pytest.approx(1)
    assert scores["log2_rmse"] == pytest.approx(0, abs=1e-6)
    assert scores["share_off_third_stop"] == 0


def test_grey_images_are_luminance(images):
    grey = images[0][..., :1], images[1][..., :1]
    assert evaluate(*grey, metrics=["hdrvdp2"]).scores["protocol"]["encoding"] == "luminance"


@pytest.mark.parametrize(
    ("test", "reference", "message"),
    [
        (np.ones((20, 20, 3)), np.ones((20, 21, 3)), "shapes"),
        (np.full((20, 20, 3), np.nan), np.ones((20, 20, 3)), "test image must be finite"),
        (np.ones((20, 20, 3)), -np.ones((20, 20, 3)), "reference image must be finite and not negative"),
        (np.ones((20, 20, 3)), np.zeros((20, 20, 3)), "black"),
    ],
)
def test_images_that_cannot_be_compared(test, reference, message):
    with pytest.raises(InputError, match=message):
        evaluate(test, reference)


def test_unknown_metrics_and_protocols_are_refused(images):
    with pytest.raises(ConfigError, match="unknown metric best"):
        evaluate(*images, metrics=["best"])
    with pytest.raises(ConfigError, match="none"):
        evaluate(*images, metrics=[])
    for wrong in ({"pixels_per_degree": 0}, {"peak_luminance": -1}, {"peak_percentile": 101}):
        with pytest.raises(ConfigError):
            Protocol(**wrong)


def test_colorvideovdp_is_left_out_with_a_reason_where_it_is_missing(images, monkeypatch):
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    with pytest.warns(StereoHdrWarning, match=r"stereohdr\[cvvdp\]"):
        scores = evaluate(*images, metrics=["pu21", "cvvdp"]).scores
    assert "cvvdp_jod" not in scores


def test_share_off_counts_both_directions():
    error = np.array([[0.5, -0.5, 0.1, 0.2]])
    assert share_off(error) == 0.5
    assert share_off(error, stops=0.15) == 0.75
    assert share_off(error, mask=np.array([[True, False, True, True]])) == pytest.approx(1 / 3)
    assert log2_rmse(error) == pytest.approx(np.sqrt((0.25 + 0.25 + 0.01 + 0.04) / 4))


def test_response_error_counts_codes_5_to_250():
    truth = ResponseCurve.srgb(3)
    shifted = truth.log_exposure.copy()
    shifted[:, 5:251] += 0.2
    shifted[:, :5] -= 9
    assert response_rmse(ResponseCurve(shifted), truth) == pytest.approx(0.2)
    with pytest.raises(InputError, match="channels"):
        response_rmse(truth, ResponseCurve.srgb(1))


def test_disparity_errors_by_region():
    def disparity(values, flags):
        return Disparity(np.array([values], np.float32), np.array([flags], np.uint8))

    known, unknown = DisparityFlag.MATCHED, DisparityFlag.NOT_COMPUTED
    truth = disparity([10, 10, 10, 10, 10], [known, known, known, known, unknown])
    estimate = disparity([10, 11.5, 13, 0, 50], [known, known, known, unknown, known])
    assert bad_share(estimate, truth, threshold=1) == pytest.approx(2 / 3)
    assert bad_share(estimate, truth, threshold=2) == pytest.approx(1 / 3)
    assert end_point_error(estimate, truth) == pytest.approx(1.5)
    first_two = np.array([[True, True, False, False, False]])
    assert end_point_error(estimate, truth, region=first_two) == pytest.approx(0.75)
    assert np.isnan(bad_share(estimate, truth, threshold=1, region=~first_two & False))
