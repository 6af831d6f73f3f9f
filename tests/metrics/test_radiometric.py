import numpy as np
import pytest

from stereohdr import InputError, Photo
from stereohdr.metrics import aligning_scale, log2_error, log2_rmse


def test_errors_are_stops_of_luminance():
    reference = np.ones((1, 3, 3), dtype=np.float32)
    test = reference * np.array([[[1.0], [2.0], [0.25]]], dtype=np.float32)
    np.testing.assert_allclose(log2_error(test, reference), [[0, 1, -2]], atol=1e-6)
    np.testing.assert_allclose(log2_error(test, reference, scale=2.0), [[1, 2, -1]], atol=1e-6)
    green = reference.copy()
    green[0, 0, 1] = 2.0
    assert log2_error(green, reference)[0, 0] == pytest.approx(np.log2(1 + 0.7152), abs=1e-6)


def test_rmse_by_hand():
    error = np.array([[3.0, 4.0, 100.0]])
    assert log2_rmse(error, np.array([[True, True, False]])) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(log2_rmse(error, np.zeros((1, 3), bool)))


def test_only_well_exposed_pixels_align():
    codes = np.array([[[128] * 3, [128] * 3, [128] * 3, [255, 128, 128], [10] * 3]], dtype=np.uint8)
    reference = np.full((1, 5, 3), 6.0, dtype=np.float32)
    test = reference / np.array([[[2.0], [2.0], [3.0], [50.0], [50.0]]], dtype=np.float32)
    assert aligning_scale(test, reference, Photo(codes, 1.0)) == pytest.approx(2.0)
    clipped = Photo(np.zeros((1, 5, 3), np.uint8), 1.0)
    assert aligning_scale(test, reference, clipped) == pytest.approx(3.0)


def test_images_that_cannot_be_compared():
    ones = np.ones((2, 2, 3), np.float32)
    with pytest.raises(InputError, match="shapes"):
        log2_error(ones, np.ones((2, 3, 3), np.float32))
    with pytest.raises(InputError, match="the reference image"):
        log2_error(ones, np.zeros_like(ones))
