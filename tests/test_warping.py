import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Disparity, DisparityFlag
from stereohdr.warping import warp_forward


def disparity_of(values, valid=None):
    values = np.asarray(values, dtype=np.float32)
    valid = np.ones(values.shape, dtype=bool) if valid is None else valid
    flags = np.where(valid, DisparityFlag.MATCHED, DisparityFlag.NOT_COMPUTED).astype(np.uint8)
    return Disparity(values, flags)


def test_pixels_move_right_by_their_disparity_and_the_nearest_wins():
    radiance = np.array([[[1.0], [2.0], [3.0], [4.0]]], dtype=np.float32)
    warped, arrived = warp_forward(radiance, disparity_of([[2, 1, 0, 1]]))
    # 1 -> x 2 (d 2), 2 -> x 2 (d 1, hidden), 3 -> x 2 (d 0, hidden), 4 -> x 4 (outside).
    np.testing.assert_array_equal(warped[0, :, 0], [0, 0, 1, 0])
    np.testing.assert_array_equal(arrived, [[False, False, True, False]])


def test_pixels_without_disparity_stay_behind():
    radiance = np.ones((1, 3, 1), dtype=np.float32)
    _, arrived = warp_forward(radiance, disparity_of([[0, 1, 0]], np.array([[False, True, False]])))
    np.testing.assert_array_equal(arrived, [[False, False, True]])


@given(seed=st.integers(0, 200), height=st.integers(1, 5), width=st.integers(1, 12))
def test_equals_a_z_buffer_written_as_a_loop(seed, height, width):
    rng = np.random.default_rng(seed)
    radiance = rng.random((height, width, 3)).astype(np.float32)
    disparity = disparity_of(rng.integers(0, 6, (height, width)), rng.random((height, width)) < 0.8)
    expected, nearest = np.zeros_like(radiance), np.full((height, width), -1.0)
    for y in range(height):
        for x in range(width):
            d = int(disparity.values[y, x])
            if disparity.valid[y, x] and x + d < width and d > nearest[y, x + d]:
                nearest[y, x + d] = d
                expected[y, x + d] = radiance[y, x]
    warped, arrived = warp_forward(radiance, disparity)
    np.testing.assert_array_equal(warped, expected)
    np.testing.assert_array_equal(arrived, nearest >= 0)
