import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.config import RejectionConfig
from stereohdr.restoration import reject_uncertain


def everywhere(shape):
    return np.ones(shape, dtype=bool)


def test_equal_structure_is_kept_whatever_the_level():
    main = np.random.default_rng(0).uniform(1, 2, (8, 9)).astype(np.float32)
    assert reject_uncertain(main, main * np.float32(3), everywhere(main.shape)).all()


def test_the_bits_by_hand():
    main = np.array([[1, 1, 1], [1, 9, 1], [1, 1, 1]], dtype=np.float32)
    same = np.array([[2, 2.5, 2], [2, 8, 2], [2.5, 2, 2]], dtype=np.float32)  # only the centre is above the mean
    other = np.array([[2, 9, 2], [2, 8, 2], [2.5, 2, 2]], dtype=np.float32)  # one more pixel is
    assert reject_uncertain(main, same, everywhere((3, 3)))[1, 1]
    assert not reject_uncertain(main, other, everywhere((3, 3)))[1, 1]


def test_rounding_in_a_flat_patch_does_not_flip_bits():
    flat = np.full((5, 5), 0.1, dtype=np.float32)
    noisy = flat * (1 + np.random.default_rng(1).uniform(-1e-6, 1e-6, (5, 5)).astype(np.float32))
    assert reject_uncertain(flat, noisy, everywhere((5, 5))).all()
    assert not reject_uncertain(flat, noisy, everywhere((5, 5)), config=RejectionConfig(tolerance=0)).all()


def test_a_hole_is_never_kept_and_its_neighbours_only_where_the_main_view_is_dark():
    main = np.full((5, 9), 2.0, dtype=np.float32)
    main[2, 6] = 0.1  # dark in both views
    warped, arrived = main.copy(), everywhere((5, 9))
    warped[2, 2] = warped[2, 6] = 7.0  # what stands in a hole does not matter
    arrived[2, 2] = arrived[2, 6] = False
    kept = reject_uncertain(main, warped, arrived)
    expected = everywhere((5, 9))
    expected[1:4, 1:4] = False  # around the bright hole
    expected[2, 6] = False
    np.testing.assert_array_equal(kept, expected)


def test_rejection_can_be_switched_off():
    rng = np.random.default_rng(3)
    main, warped = rng.random((2, 6, 6)).astype(np.float32)
    arrived = rng.random((6, 6)) < 0.5
    kept = reject_uncertain(main, warped, arrived, config=RejectionConfig(enabled=False))
    np.testing.assert_array_equal(kept, arrived)


@given(seed=st.integers(0, 100), height=st.integers(1, 6), width=st.integers(1, 6))
def test_equals_the_definition_pixel_by_pixel(seed, height, width):
    rng = np.random.default_rng(seed)
    main, warped = rng.integers(1, 5, (2, height, width)).astype(np.float32)
    arrived = rng.random((height, width)) < 0.8
    expected = np.zeros((height, width), dtype=bool)
    for y in range(height):
        for x in range(width):
            patch = np.s_[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2]
            if arrived[y, x]:
                views = main[patch], np.where(arrived[patch], warped[patch], 0)
                bits = [v >= v.mean(dtype=float) * (1 - 1e-4) for v in views]
                expected[y, x] = (bits[0] == bits[1]).all()
    np.testing.assert_array_equal(reject_uncertain(main, warped, arrived), expected)
