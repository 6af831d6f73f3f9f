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


def test_a_hole_is_never_kept_and_does_not_count_in_its_neighbours_patch():
    main = np.random.default_rng(2).uniform(1, 2, (6, 6)).astype(np.float32)
    warped, arrived = main.copy(), everywhere((6, 6))
    warped[2, 3] = 0
    arrived[2, 3] = False
    np.testing.assert_array_equal(reject_uncertain(main, warped, arrived), arrived)


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
            there = arrived[patch]
            if arrived[y, x]:
                bits = [v[patch][there] >= v[patch][there].mean() * (1 - 1e-4) for v in (main, warped)]
                expected[y, x] = (bits[0] == bits[1]).all()
    np.testing.assert_array_equal(reject_uncertain(main, warped, arrived), expected)
