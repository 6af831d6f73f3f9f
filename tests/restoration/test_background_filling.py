import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Disparity, DisparityFlag
from stereohdr.restoration import fill_from_background
from stereohdr.restoration._kernels import nearest_background

from reference import restoration as twin


@given(
    seed=st.integers(0, 500),
    height=st.integers(1, 5),
    width=st.integers(1, 9),
    known=st.sampled_from([0.0, 0.2, 0.6, 1.0]),
)
def test_sources_equal_the_twin(seed, height, width, known):
    rng = np.random.default_rng(seed)
    disparity = rng.integers(0, 3, (height, width)).astype(np.float32)
    valid = rng.random((height, width)) < known
    hole = ~valid & (rng.random((height, width)) < 0.8)
    got, expected = np.empty((2, height, width), dtype=np.int32)
    nearest_background(disparity, valid, hole, got)
    twin.nearest_background(disparity, valid, hole, expected)
    np.testing.assert_array_equal(got, expected)


def test_the_side_of_smaller_disparity_fills_and_rows_do_not_mix():
    matched, occluded = int(DisparityFlag.MATCHED), int(DisparityFlag.OCCLUDED)
    flags = np.array(
        [[matched, occluded, occluded, matched, occluded], [occluded] * 5, [matched] + [occluded] * 3 + [matched]],
        dtype=np.uint8,
    )
    # The occluded pixels' own disparity, 0, must not count.
    values = np.array([[9, 0, 0, 4, 0], [0] * 5, [4, 0, 0, 0, 4]], dtype=np.float32)
    warped = np.arange(1, 16, dtype=np.float32).reshape(3, 5, 1)
    holes = flags == occluded
    holes[0, 1] = False
    filled, found = fill_from_background(warped, Disparity(values, flags), holes)
    np.testing.assert_array_equal(filled[..., 0], [[1, 2, 4, 4, 4], [6, 7, 8, 9, 10], [11, 11, 11, 15, 15]])
    np.testing.assert_array_equal(found, holes & (np.arange(3) != 1)[:, None])
