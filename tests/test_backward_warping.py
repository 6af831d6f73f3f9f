import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Disparity, DisparityFlag
from stereohdr.warping import auxiliary_view_disparity, main_view_disparity, warp_backward

MATCHED, OCCLUDED = int(DisparityFlag.MATCHED), int(DisparityFlag.OCCLUDED)


def test_whole_and_fractional_disparities_by_hand():
    image = np.array([[[1.0], [2.0], [4.0], [8.0]]], dtype=np.float32)
    values = np.array([[0, 1, 0.5, 0.25]], dtype=np.float32)
    warped, arrived = warp_backward(image, Disparity(values, np.full((1, 4), MATCHED, np.uint8)))
    np.testing.assert_array_equal(warped[0, :, 0], [1, 1, 3, 7])
    assert arrived.all()


def test_pixels_without_a_partner_stay_empty():
    image = np.ones((1, 3, 2), dtype=np.float32)
    flags = np.array([[MATCHED, OCCLUDED, MATCHED]], dtype=np.uint8)
    warped, arrived = warp_backward(image, Disparity(np.array([[0.5, 0, 0]], dtype=np.float32), flags))
    np.testing.assert_array_equal(arrived, [[False, False, True]])  # x = -0.5 is outside
    np.testing.assert_array_equal(warped[0, :, 0], [0, 0, 1])


@given(seed=st.integers(0, 200), height=st.integers(1, 4), width=st.integers(1, 9))
def test_whole_disparities_fetch_pixels_as_they_are(seed, height, width):
    rng = np.random.default_rng(seed)
    image = rng.random((height, width, 3)).astype(np.float32)
    d = np.minimum(rng.integers(0, 5, (height, width)), np.arange(width))
    warped, arrived = warp_backward(image, Disparity(d.astype(np.float32), np.full(d.shape, MATCHED, np.uint8)))
    assert arrived.all()
    np.testing.assert_array_equal(warped, image[np.arange(height)[:, None], np.arange(width) - d])


def test_a_map_is_carried_over_with_the_nearest_in_front_and_back():
    of_auxiliary = Disparity(np.array([[2, 1, 0, 0]], dtype=np.float32), np.full((1, 4), MATCHED, np.uint8))
    of_main = main_view_disparity(of_auxiliary)
    # 0 -> 2 (d 2, in front), 1 -> 2 (d 1), 2 -> 2 (d 0), 3 -> 3; nothing arrives at 0 and 1.
    np.testing.assert_array_equal(of_main.values, [[0, 0, 2, 0]])
    np.testing.assert_array_equal(of_main.valid, [[False, False, True, True]])
    hidden = Disparity(of_auxiliary.values, np.array([[OCCLUDED, MATCHED, MATCHED, MATCHED]], dtype=np.uint8))
    np.testing.assert_array_equal(main_view_disparity(hidden).values, [[0, 0, 1, 0]])
    back = auxiliary_view_disparity(of_main)
    np.testing.assert_array_equal(back.values, [[2, 0, 0, 0]])
    np.testing.assert_array_equal(back.valid, [[True, False, False, True]])
