import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Photo
from stereohdr.config import MergingConfig
from stereohdr.segmentation import auxiliary_interest, main_interest, merge_superpixels, segment_photo
from stereohdr.segmentation._kernels import merge_graph
from stereohdr.segmentation.merging import superpixel_means

from conftest import smooth_codes
from reference import segmentation as twin


@given(
    nodes=st.integers(1, 30),
    edges=st.integers(0, 80),
    scale=st.sampled_from([0.0, 5.0, 150.0]),
    minimum_size=st.integers(1, 4),
    seed=st.integers(0, 1000),
)
def test_graph_merging_equals_the_twin(nodes, edges, scale, minimum_size, seed):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, nodes, edges).astype(np.int32)
    second = rng.integers(0, nodes, edges).astype(np.int32)
    weight = np.sort(np.round(rng.uniform(0, 60, edges)))
    got = merge_graph(first, second, weight, nodes, scale, minimum_size)
    np.testing.assert_array_equal(got, twin.merge_graph(first, second, weight, nodes, scale, minimum_size))


def test_two_flat_areas_become_two_segments_and_a_weak_step_none():
    means = np.zeros((6, 10, 3))
    means[:, 5:] = 200
    segments = merge_superpixels(means)
    assert segments.max() == 1
    assert (segments[:, :5] == 0).all()
    assert (segments[:, 5:] == 1).all()
    means[:, 5:] = 0.5  # below k / 30 inside each half
    assert merge_superpixels(means).max() == 0


def test_the_merging_threshold_is_k_over_the_number_of_superpixels():
    means = np.zeros((1, 2, 1))
    means[0, 1] = 150  # two single super-pixels merge up to a distance of k
    assert merge_superpixels(means).max() == 0
    means[0, 1] = 150.01
    assert merge_superpixels(means).max() == 1


def test_diagonal_neighbours_are_connected():
    means = np.full((2, 2, 1), 255.0)
    means[0, 0] = means[1, 1] = 0
    segments = merge_superpixels(means, config=MergingConfig(scale=1.0))
    np.testing.assert_array_equal(segments, [[0, 1], [1, 0]])


def test_minimum_size_removes_small_segments():
    means = np.zeros((3, 3, 1))
    means[1, 1] = 250
    assert merge_superpixels(means, config=MergingConfig(scale=10)).max() == 1
    assert merge_superpixels(means, config=MergingConfig(scale=10, minimum_size=2)).max() == 0


def test_empty_cells_take_a_neighbours_mean():
    labels = np.array([[0, 0, 3, 3]], dtype=np.int32)  # cells 1 and 2 of a 2x2 grid are empty
    colours = np.array([[[10.0], [20.0], [40.0], [60.0]]])
    means = superpixel_means(colours, labels, (2, 2))
    np.testing.assert_array_equal(means[..., 0], [[15, 15], [15, 50]])


def test_segments_do_not_depend_on_the_bit_depth():
    codes = np.rint(smooth_codes(np.random.default_rng(1), 40, 50)).astype(np.uint8)
    deep = Photo(codes.astype(np.uint16) * 16, 0.1, 255 * 16)
    for shallow, same in zip(segment_photo(Photo(codes, 0.1)), segment_photo(deep), strict=True):
        np.testing.assert_array_equal(shallow, same)


def test_interest_is_every_segment_with_a_pixel_of_s():
    segments = np.array([[0, 0, 1, 1, 2]], dtype=np.int32)
    s = np.array([[False, False, False, True, False]])
    np.testing.assert_array_equal(main_interest(segments, s), [[False, False, True, True, False]])
    assert not main_interest(segments, np.zeros_like(s)).any()


@given(seed=st.integers(0, 50), width=st.integers(1, 12), reach=st.integers(0, 11))
def test_auxiliary_interest_reaches_left_by_the_largest_disparity(seed, width, reach):
    main = np.random.default_rng(seed).random((3, width)) < 0.2
    expected = np.zeros_like(main)
    for y, x in np.argwhere(main):
        for d in range(reach + 1):
            if x - d >= 0:
                expected[y, x - d] = True
    np.testing.assert_array_equal(auxiliary_interest(main, max_disparity=reach), expected)
