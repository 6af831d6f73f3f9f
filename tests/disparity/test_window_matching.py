import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import DisparityFlag
from stereohdr.config import BilateralWindowConfig, WindowMatchingConfig
from stereohdr.disparity import correlation_volume, left_right_check, match_windows
from stereohdr.disparity._kernels import correlation_rows, patch_vectors, winner_rows

from reference import disparity as twin

THREE = WindowMatchingConfig(window=3)


def views(height=40, width=60, shift=6):
    rng = np.random.default_rng(2)
    scene = rng.uniform(1, 2, (height, width + shift)).astype(np.float32)
    return np.ascontiguousarray(scene[:, shift:]), np.ascontiguousarray(scene[:, :width])


@given(
    seed=st.integers(0, 500),
    height=st.integers(1, 5),
    width=st.integers(1, 9),
    radius=st.integers(1, 2),
    levels=st.sampled_from([1, 2, 1000]),
    range_factor=st.sampled_from([0.0, 2.0]),
)
def test_kernels_equal_the_twins(seed, height, width, radius, levels, range_factor):
    rng = np.random.default_rng(seed)
    images = rng.integers(0, levels, (2, height, width)).astype(np.float32) / np.float32(levels)
    auxiliary, main = (np.pad(image + 0.1, radius, mode="edge").astype(np.float32) for image in images)
    weights = rng.uniform(0.5, 1, (2 * radius + 1, 2 * radius + 1))
    disparities = int(rng.integers(1, width + 1))
    got, expected = np.empty((2, height, width, disparities), dtype=np.float32)
    correlation_rows(auxiliary, main, weights, range_factor, 0, height, got)
    twin.correlation_rows(auxiliary, main, weights, range_factor, 0, height, expected)
    np.testing.assert_allclose(got, expected, atol=2e-6)
    vectors, expected_vectors = np.empty((2, weights.size, width), dtype=np.float32)
    patch_vectors(main, weights, range_factor, 0, vectors)
    twin.patch_vectors(main, weights, range_factor, 0, expected_vectors)
    np.testing.assert_allclose(vectors, expected_vectors, atol=1e-6)
    rounded = np.where(got >= -1, np.rint(got * 3), -2).astype(np.float32)  # many ties
    maps, expected_maps = np.full((2, 2, height, width), -1, dtype=np.int32)
    winner_rows(rounded, 0, maps[0], maps[1])
    twin.winner_rows(rounded, 0, expected_maps[0], expected_maps[1])
    np.testing.assert_array_equal(maps, expected_maps)


def test_correlation_by_hand():
    auxiliary = np.array([[1, 0, 0], [0, 2, 0], [0, 0, 0]], dtype=np.float32)
    main = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 0]], dtype=np.float32)
    # Sums over the nine pixels around the centre: a 3, a^2 5, m 1, m^2 1, a m 2.
    covariance, power_a, power_m = 2 - 3 * 1 / 9, 5 - 3**2 / 9, 1 - 1 / 9
    volume = correlation_volume(auxiliary, main, max_disparity=0, config=THREE)
    assert volume[1, 1, 0] == pytest.approx(covariance / np.sqrt(power_a * power_m), abs=1e-6)


def test_gain_and_offset_do_not_matter_and_flat_patches_correlate_with_nothing():
    auxiliary, main = views()
    volume = correlation_volume(auxiliary, main, max_disparity=10, config=THREE)
    np.testing.assert_allclose(volume[5:-5, 5:40, 6], 1, atol=1e-5)
    scaled = correlation_volume(auxiliary * 300 + 7, main, max_disparity=10, config=THREE)
    np.testing.assert_allclose(scaled, volume, atol=1e-4)
    flat = correlation_volume(np.full_like(main, 0.1), main, max_disparity=10, config=THREE)
    assert set(np.unique(flat)) == {0.0, -2.0}
    assert (flat[:, -1, 1:] == -2).all()


def test_a_bright_lamp_does_not_cost_the_dark_its_digits():
    """Sums of squares would: the dark texture is 1e-5 of the lamp, its square 1e-10."""
    auxiliary, main = (1e-5 * view for view in views())
    auxiliary[:, 30:] = 1.0
    main[:, 36:] = 1.0
    volume = correlation_volume(auxiliary, main, max_disparity=10)
    np.testing.assert_allclose(volume[5:-5, 5:25, 6], 1, atol=1e-4)


def test_faint_texture_on_a_bright_wall_is_seen():
    auxiliary, main = (1 + 1e-4 * view for view in views())
    of_main, _ = match_windows(auxiliary, main, max_disparity=10)
    assert (of_main.values[:, 10:] == 6).mean() > 0.98


def test_bilateral_weights_keep_a_step_out_of_the_window():
    """The wall left of the step is at disparity 6 in both; what is right of it differs between the views."""
    auxiliary, main = (np.log(view) for view in views())
    rng = np.random.default_rng(5)
    auxiliary[:, 30:] = 3 + rng.uniform(0, 0.7, auxiliary[:, 30:].shape)
    main[:, 36:] = 3 + rng.uniform(0, 0.7, main[:, 36:].shape)
    plain, weighted = (
        correlation_volume(auxiliary, main, max_disparity=10, bilateral=bilateral)[5:-5, 27:30, 6]
        for bilateral in (None, BilateralWindowConfig())
    )
    assert weighted.min() > 0.99
    assert plain.min() < weighted.min() - 0.005


@pytest.mark.parametrize("bilateral", [None, BilateralWindowConfig()])
def test_a_shift_is_found_in_both_views_and_confirmed(bilateral):
    auxiliary, main = views()
    of_main, of_auxiliary = match_windows(auxiliary, main, max_disparity=20, bilateral=bilateral)
    assert (of_main.values[:, 6:] == 6).mean() > 0.99
    assert (of_auxiliary.values[:, :-6] == 6).mean() > 0.99
    assert (of_main.flags[:, 6:] == DisparityFlag.MATCHED).mean() > 0.99
    assert (of_main.flags[:, :6] == DisparityFlag.OCCLUDED).mean() > 0.5


def test_left_right_check_by_hand():
    of_main = np.array([[0, 0, 2, 1]])
    of_auxiliary = np.array([[2, 3 - 1, 1, 0]])
    # Main 0 -> auxiliary 0, which says 2; 1 -> 1, which says 2; 2 -> 0: 2; 3 -> 2: 1.
    checked_main, checked_auxiliary = left_right_check(of_main, of_auxiliary)
    matched, occluded = DisparityFlag.MATCHED, DisparityFlag.OCCLUDED
    np.testing.assert_array_equal(checked_main.flags, [[occluded, occluded, matched, matched]])
    # Auxiliary 0 -> main 2: 2; 1 -> 3: 1, differs by 1; 2 -> 3: 1; 3 -> 3: 1, differs by 1.
    np.testing.assert_array_equal(checked_auxiliary.flags, [[matched] * 4])
    strict = left_right_check(of_main, of_auxiliary, tolerance=0)[1]
    np.testing.assert_array_equal(strict.flags, [[matched, occluded, matched, occluded]])
    np.testing.assert_array_equal(checked_main.values, of_main)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_and_strips_equal_the_whole_volume(threads):
    rng = np.random.default_rng(1)
    auxiliary, main = rng.uniform(1, 2, (2, 21, 33)).astype(np.float32)
    volume = correlation_volume(auxiliary, main, max_disparity=9)
    expected = np.zeros((2, 21, 33), dtype=np.int32)
    winner_rows(volume, 0, expected[0], expected[1])
    of_main, of_auxiliary = match_windows(auxiliary, main, max_disparity=9, threads=threads)
    np.testing.assert_array_equal(of_main.values, expected[0])
    np.testing.assert_array_equal(of_auxiliary.values, expected[1])


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1)])
def test_tiny_views(size):
    image = np.ones(size, dtype=np.float32)
    for disparity in match_windows(image, image, max_disparity=size[1] - 1):
        assert (disparity.values == 0).all()
        assert (disparity.flags == DisparityFlag.MATCHED).all()
