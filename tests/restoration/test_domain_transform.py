import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.config import DomainTransformConfig
from stereohdr.restoration import edge_preserving_filter
from stereohdr.restoration._kernels import pass_across, pass_down

from reference import restoration as twin


@given(
    seed=st.integers(0, 100), height=st.integers(1, 8), width=st.integers(1, 8), channels=st.sampled_from([1, 3])
)
def test_passes_equal_the_twin(seed, height, width, channels):
    rng = np.random.default_rng(seed)
    image = rng.random((height, width, channels)).astype(np.float32)
    across, down = rng.random((2, height, width)).astype(np.float32)
    got, expected = image.copy(), image.astype(np.float64)
    middle = height // 2
    for start, stop in ((0, middle), (middle, height)):
        pass_across(got, across[start:stop], start)
    middle = width // 2
    for start, stop in ((0, middle), (middle, width)):
        pass_down(got, np.ascontiguousarray(down[:, start:stop]), start)
    twin.recursive_pass(expected, across, down)
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-6)


def test_one_row_by_hand():
    config = DomainTransformConfig(spatial_sigma=2.0, range_sigma=0.5, iterations=1)
    image = np.array([[[1.0], [0.0]]], dtype=np.float32)
    guide = np.array([[[0.0], [0.25]]], dtype=np.float32)
    sigma = 2.0 * np.sqrt(3) / np.sqrt(3)  # N = 1
    v = np.exp(-np.sqrt(2) / sigma) ** (1 + 2.0 / 0.5 * 0.25)
    forth = np.array([1.0, v])
    back = np.array([(1 - v) * forth[0] + v * forth[1], forth[1]])
    got = edge_preserving_filter(image, guide, config=config)[0, :, 0]
    np.testing.assert_allclose(got, back, rtol=1e-6)


def test_the_distance_is_the_sum_over_guide_channels():
    image = np.array([[[1.0], [0.0]]], dtype=np.float32)
    split = np.array([[[0.0, 0.0], [0.0002, 0.0003]]], dtype=np.float32)
    joined = np.array([[[0.0], [0.0005]]], dtype=np.float32)
    np.testing.assert_allclose(
        edge_preserving_filter(image, split), edge_preserving_filter(image, joined), rtol=1e-5
    )


def test_constant_images_stay_and_the_range_is_kept():
    rng = np.random.default_rng(1)
    guide = rng.random((20, 30, 3)).astype(np.float32) * np.float32(1e-3)
    np.testing.assert_allclose(
        edge_preserving_filter(np.full((20, 30, 1), 0.7, np.float32), guide), 0.7, rtol=1e-5
    )
    step = (rng.random((20, 30, 1)) < 0.5).astype(np.float32)
    smooth = edge_preserving_filter(step, guide)
    assert smooth.min() >= 0
    assert smooth.max() <= 1 + 1e-6


def test_an_edge_of_the_guide_stops_the_smoothing():
    image = np.zeros((30, 60, 1), dtype=np.float32)
    image[:, 30:] = 1
    flat = np.zeros((30, 60, 3), dtype=np.float32)
    edge = flat.copy()
    edge[:, 30:] = 1.0
    np.testing.assert_allclose(edge_preserving_filter(image, edge), image, atol=1e-6)
    assert edge_preserving_filter(image, flat)[15, 28, 0] > 0.3


@pytest.mark.parametrize("scale", [1e3, 1e6])
def test_on_a_wrong_radiance_scale_the_filter_is_the_identity(scale):
    rng = np.random.default_rng(0)
    guide = rng.uniform(0.002, 0.006, (20, 20, 3)).astype(np.float32) * np.float32(scale)
    image = rng.random((20, 20, 3)).astype(np.float32)
    np.testing.assert_allclose(edge_preserving_filter(image, guide), image, atol=2e-2)


@pytest.mark.parametrize("threads", [2, 3])
def test_the_same_bytes_for_any_number_of_threads(threads):
    rng = np.random.default_rng(3)
    image, guide = rng.random((2, 150, 140, 3)).astype(np.float32)
    one = edge_preserving_filter(image, guide, threads=1)
    assert one.tobytes() == edge_preserving_filter(image, guide, threads=threads).tobytes()
