import numpy as np
import pytest

from stereohdr.errors import ConfigError, InputError
from stereohdr.metrics.pu21 import COEFFICIENTS, pu21_encode, pu21_psnr, pu21_ssim
from stereohdr.radiance import luminance

PUBLISHED_ENDS = {
    "banding": (-1.5580e-07, 520.4673),
    "banding_glare": (5.4705e-10, 595.3939),
    "peaks": (1.3674e-07, 380.9853),
    "peaks_glare": (-9.7360e-08, 407.5066),
}
"""Encoded 0.005 and 10000 cd/m2, as published with the encoding."""


@pytest.mark.parametrize("variant", COEFFICIENTS)
def test_the_ends_of_the_range_are_the_published_ones(variant):
    low, high = pu21_encode(np.array([0.005, 10000.0]), variant=variant)
    assert low == pytest.approx(max(PUBLISHED_ENDS[variant][0], 0), abs=1e-6)
    assert high == pytest.approx(PUBLISHED_ENDS[variant][1], abs=1e-3)
    np.testing.assert_array_equal(pu21_encode(np.array([0.0, 1e6]), variant=variant), [low, high])


def test_the_encoding_rises_and_is_256_at_100_cd():
    luminance = np.logspace(np.log10(0.006), 4, 200)
    assert (np.diff(pu21_encode(luminance)) > 0).all()
    assert pu21_encode(np.array(100.0)) == pytest.approx(256, abs=1)


def test_psnr_by_hand():
    reference = np.full((4, 4, 1), 50.0)
    test = reference.copy()
    test[0, 0] = 80.0
    step = pu21_encode(np.array(80.0)) - pu21_encode(np.array(50.0))
    expected = 10 * np.log10(256**2 / (step**2 / 16))
    assert pu21_psnr(test, reference) == pytest.approx(expected, rel=1e-12)
    assert pu21_psnr(reference, reference) == np.inf


def test_only_the_luminance_counts():
    grey = np.full((12, 12, 3), 20.0)
    coloured = grey.copy()
    coloured[..., 0] += 7.152
    coloured[..., 1] -= 2.126  # same luminance
    assert pu21_psnr(coloured, grey) > 100
    coloured[..., 1] += 2.126
    expected = 20 * np.log10(256 / (pu21_encode(np.array(20 + 0.2126 * 7.152)) - pu21_encode(np.array(20.0))))
    assert pu21_psnr(coloured, grey) == pytest.approx(expected, rel=1e-4)


def test_ssim_equals_scikit_images():
    metrics = pytest.importorskip("skimage.metrics")
    rng = np.random.default_rng(0)
    reference = rng.lognormal(2, 1, (40, 50, 3))
    test = reference * rng.lognormal(0, 0.2, reference.shape)
    expected = metrics.structural_similarity(
        pu21_encode(luminance(test)),
        pu21_encode(luminance(reference)),
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=256.0,
    )
    assert pu21_ssim(test, reference) == pytest.approx(expected, rel=1e-9)
    assert pu21_ssim(reference, reference) == pytest.approx(1.0)
    assert pu21_ssim(reference[:5, :5], reference[:5, :5]) == pytest.approx(1.0)


def test_wrong_input_is_refused():
    with pytest.raises(ConfigError, match="unknown PU21 variant"):
        pu21_encode(np.ones(3), variant="dark")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="cannot compare"):
        pu21_psnr(np.ones((3, 3, 1)), np.ones((3, 4, 1)))
