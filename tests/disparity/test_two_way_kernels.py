import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Disparity, DisparityFlag
from stereohdr.disparity import _two_way_kernels as kernels
from stereohdr.disparity.two_way import fill_disparity

from reference import two_way as twin


def disparity_map(rng, shape):
    """Values in steps of a quarter: halves must be rounded alike."""
    return (rng.integers(-8, 24, shape) / 4).astype(np.float32)


def test_the_flags_are_those_of_the_package():
    assert kernels.MATCHED == DisparityFlag.MATCHED
    assert kernels.OCCLUDED == DisparityFlag.OCCLUDED
    assert kernels.MISMATCHED == DisparityFlag.MISMATCHED


@given(seed=st.integers(0, 999), height=st.integers(1, 4), width=st.integers(1, 16), sign=st.sampled_from([-1, 1]))
def test_kernels_equal_their_twins(seed, height, width, sign):
    rng = np.random.default_rng(seed)
    shape = (height, width)
    own, other = disparity_map(rng, shape), disparity_map(rng, shape)
    own_confirmed, other_confirmed = rng.random((2, *shape)) < rng.random()

    confirmed = np.empty(shape, bool)
    kernels.confirm(own, other, sign, 1.5, confirmed)
    np.testing.assert_array_equal(confirmed, twin.confirm(own, other, sign, 1.5))

    margins = rng.integers(0, 200, (2, *shape)).astype(np.uint16)
    settings = (np.float32(1.5), np.float32(0.6), np.float32(40))
    values, confidence = np.empty(shape, np.float32), np.empty(shape, np.float32)
    runs = (own, other, *margins, own_confirmed, other_confirmed, settings)
    kernels.combine(*runs, values, confidence)
    expected = twin.combine(*runs)
    np.testing.assert_array_equal(values, expected[0])
    np.testing.assert_allclose(confidence, expected[1], rtol=1e-6)

    flags = np.empty(shape, np.uint8)
    kernels.mark(own_confirmed, other, other_confirmed, sign, flags)
    np.testing.assert_array_equal(flags, twin.mark(own_confirmed, other, other_confirmed, sign))

    np.testing.assert_array_equal(fill_disparity(Disparity(own, flags)), twin.fill_disparity(own, flags))
