import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Disparity, DisparityFlag, warping
from stereohdr.warping import warp_backward

from reference import warping as twin


def case(seed, height, width, channels):
    rng = np.random.default_rng(seed)
    image = rng.random((height, width, channels)).astype(np.float32)
    values = (rng.uniform(-4, 8, (height, width)) * rng.choice([0, 1], (height, width))).astype(np.float32)
    flags = rng.choice([DisparityFlag.MATCHED, DisparityFlag.OCCLUDED], (height, width)).astype(np.uint8)
    return image, Disparity(values, flags)


@given(
    seed=st.integers(0, 999),
    height=st.integers(1, 4),
    width=st.integers(1, 12),
    channels=st.sampled_from([1, 3]),
)
def test_backward_warping_equals_the_twin(seed, height, width, channels):
    image, disparity = case(seed, height, width, channels)
    warped, arrived = warp_backward(image, disparity)
    expected = twin.warp_backward(image, disparity.values, disparity.flags == DisparityFlag.MATCHED)
    np.testing.assert_allclose(warped, expected[0], atol=1e-6)
    np.testing.assert_array_equal(arrived, expected[1])


@pytest.mark.parametrize("threads", [1, 3])
def test_views_of_other_arrays_and_threads_make_no_difference(threads, monkeypatch):
    image, disparity = case(1, 30, 20, 3)
    whole = warp_backward(image, disparity)
    monkeypatch.setattr(warping, "STRIP_ROWS", 7)
    flipped = image[:, ::-1].copy()[:, ::-1]
    in_strips = warp_backward(flipped, disparity, threads=threads)
    for got, expected in zip(in_strips, whole, strict=True):
        np.testing.assert_array_equal(got, expected)
