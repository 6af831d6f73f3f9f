import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.config import LatticeConfig
from stereohdr.segmentation import boundary_map, superpixel_lattice
from stereohdr.segmentation._kernels import lattice_paths

from conftest import smooth_codes
from reference import segmentation as twin


@given(
    height=st.integers(1, 20),
    width=st.integers(1, 40),
    pitch=st.integers(2, 8),
    tolerance=st.integers(0, 7),
    seed=st.integers(0, 5),
)
def test_paths_equal_the_twin(height, width, pitch, tolerance, seed):
    tolerance = min(tolerance, pitch - 1)
    cost = np.random.default_rng(seed).uniform(0.02, 1.02, (height, width))
    np.testing.assert_array_equal(
        lattice_paths(cost, pitch, tolerance), twin.lattice_paths(cost, pitch, tolerance)
    )


def test_paths_in_a_flat_image_stay_on_the_nominal_lines():
    paths = lattice_paths(np.full((9, 20), 0.5), 6, 4)
    np.testing.assert_array_equal(paths, np.tile([[6], [12], [18]], (1, 9)))


def test_path_follows_a_cheap_diagonal_within_its_tolerance():
    cost = np.ones((12, 13))
    for y in range(12):
        cost[y, min(6 + y, 12)] = 0.02
    path = lattice_paths(cost, 6, 4)[0]
    np.testing.assert_array_equal(path[:5], [6, 7, 8, 9, 10])
    assert path.max() == 10


@given(seed=st.integers(0, 30))
def test_paths_start_nominal_never_cross_and_keep_their_tolerance(seed):
    cost = np.random.default_rng(seed).uniform(0, 1, (30, 50))
    paths = lattice_paths(cost, 6, 4)
    assert len(paths) == 8
    np.testing.assert_array_equal(paths[:, 0], 6 * np.arange(1, 9))
    assert (np.diff(paths, axis=0) >= 1).all()
    assert (np.abs(np.diff(paths, axis=1)) <= 1).all()
    assert (np.abs(paths - 6 * np.arange(1, 9)[:, None]) <= 4).all()


def test_boundary_map_is_high_on_a_step_of_one_channel_only():
    colours = np.zeros((20, 20, 3))
    colours[:, 10:, 2] = 100
    boundary = boundary_map(colours)
    assert boundary[10, 9] == boundary[10, 10] == boundary.max() > 0.9
    assert boundary[10, 2] < 1e-6
    np.testing.assert_array_equal(boundary_map(np.full((5, 7, 3), 80.0)), 0)


def test_labels_count_paths_above_and_left():
    labels, shape = superpixel_lattice(np.full((13, 20, 3), 7.0))
    assert shape == (3, 4)
    expected = np.array([[0] * 6 + [1] * 6 + [2] * 6 + [3] * 2])
    np.testing.assert_array_equal(labels[0:6], np.repeat(expected, 6, axis=0))
    np.testing.assert_array_equal(labels[12:13], expected + 8)


def test_cell_borders_follow_an_edge_beside_the_nominal_line():
    colours = np.zeros((24, 24, 3))
    colours[:, 14:] = 200  # nominal lines at 6, 12, 18
    labels, _ = superpixel_lattice(colours)
    inner = labels[6:18]
    assert not np.intersect1d(inner[:, :13], inner[:, 15:]).size


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (5, 5), (6, 7)])
def test_awkward_sizes_give_contiguous_grids(size):
    rng = np.random.default_rng(0)
    labels, shape = superpixel_lattice(smooth_codes(rng, *size))
    assert shape == ((size[0] - 1) // 6 + 1, (size[1] - 1) // 6 + 1)
    assert labels.min() >= 0
    assert labels.max() < shape[0] * shape[1]


def test_other_pitches_work():
    labels, shape = superpixel_lattice(np.zeros((20, 30, 1)), config=LatticeConfig(pitch=10, tolerance=2))
    assert shape == (2, 3)
    assert labels[0, 9] == 0
    assert labels[0, 10] == 1
