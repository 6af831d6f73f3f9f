import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.config import AggregationConfig, CandidateConfig
from stereohdr.disparity import aggregate_in_segments, select_candidates, winner_takes_all
from stereohdr.disparity.aggregation import support_weights

from reference import disparity as twin


def random_volume(seed, rows, width, disparities):
    rng = np.random.default_rng(seed)
    volume = rng.integers(20, 49, (rows, width, disparities)).astype(np.uint8)
    outside = np.arange(width)[:, None] + np.arange(disparities) >= width
    volume[:, outside] = 0
    return volume


@given(
    rows=st.integers(1, 8),
    width=st.integers(1, 12),
    disparities=st.integers(1, 12),
    box=st.sampled_from([1, 3, 5]),
    share=st.sampled_from([0.1, 0.5, 1.0]),
    levels=st.sampled_from([1, 3, 29]),
    seed=st.integers(0, 100),
)
def test_candidates_equal_the_twin(rows, width, disparities, box, share, levels, seed):
    disparities = min(disparities, width)
    volume = random_volume(seed, rows, width, disparities) // np.uint8(levels)
    first, last = seed % rows, rows
    wanted = np.random.default_rng(seed).random((last - first, width)) < 0.7
    config = CandidateConfig(share=share, box=box)
    got = select_candidates(volume, wanted, first_row=first, config=config)
    expected = np.empty_like(got)
    twin.candidate_rows(volume, wanted, box // 2, first, expected)
    np.testing.assert_array_equal(got, expected)


def test_candidates_are_local_maxima_best_first_and_ties_go_to_the_smaller():
    volume = np.zeros((1, 20, 10), dtype=np.uint8)
    volume[0, 0] = [5, 3, 9, 9, 1, 9, 2, 7, 7, 6]
    wanted = np.zeros((1, 20), dtype=bool)
    wanted[0, 0] = True
    config = CandidateConfig(share=0.4, box=1)  # four candidates
    got = select_candidates(volume, wanted, config=config)
    np.testing.assert_array_equal(got[0, 0], [2, 5, 7, 0])
    assert (got[0, 1:] == -1).all()


def test_number_of_candidates_is_ten_percent_of_the_largest_disparity():
    assert CandidateConfig().count(120) == 12
    assert CandidateConfig().count(3) == 1
    assert CandidateConfig().count(0) == 1


@given(
    rows=st.integers(1, 7),
    width=st.integers(1, 12),
    radius=st.integers(0, 4),
    segments=st.integers(1, 4),
    seed=st.integers(0, 100),
)
def test_aggregation_equals_the_twin(rows, width, radius, segments, seed):
    rng = np.random.default_rng(seed)
    disparities = min(6, width)
    volume = random_volume(seed, rows, width, disparities)
    labels = rng.integers(0, segments, (rows, width)).astype(np.int32)
    wanted = rng.random((rows, width)) < 0.8
    found = select_candidates(volume, wanted, config=CandidateConfig(share=0.5, box=3))
    config = AggregationConfig(radius=radius, sigma=3.0)
    got = aggregate_in_segments(volume, labels, found, config=config)
    expected = np.empty_like(got)
    twin.aggregate_rows(volume, labels, found, support_weights(config), 0, 0, expected)
    np.testing.assert_allclose(got, expected, rtol=1e-5)


@pytest.mark.parametrize("radius", [7, 8, 9])
def test_aggregation_in_windows_of_several_vectors_equals_the_twin(radius):
    rng = np.random.default_rng(radius)
    volume = random_volume(1, 11, 45, 7)
    labels = (np.arange(45) // 9 + rng.integers(0, 2, (11, 45))).astype(np.int32)
    found = select_candidates(volume[3:], np.ones((5, 45), dtype=bool), config=CandidateConfig(share=0.8, box=3))
    config = AggregationConfig(radius=radius, sigma=5.0)
    got = aggregate_in_segments(volume, labels, found, first_image_row=3, first_row=3, config=config)
    expected = np.empty_like(got)
    twin.aggregate_rows(volume, labels, found, support_weights(config), 3, 3, expected)
    np.testing.assert_allclose(got, expected, rtol=1e-5)


def test_aggregation_by_hand_with_two_segments():
    volume = np.array([[[10, 20], [30, 40], [50, 0]]], dtype=np.uint8)
    labels = np.array([[0, 0, 1]], dtype=np.int32)
    found = np.array([[[0, 1], [0, 1], [0, -1]]], dtype=np.int16)
    scores = aggregate_in_segments(volume, labels, found, config=AggregationConfig(radius=1, sigma=1.0))
    w = np.exp(-1.0)
    expected = [
        [(10 + 30 * w) / (1 + w), (20 + 40 * w) / (1 + w)],
        [(30 + 10 * w) / (1 + w), (40 + 20 * w) / (1 + w)],
        [50, -1],
    ]
    np.testing.assert_allclose(scores[0], expected, rtol=1e-6)


def test_neighbours_without_a_partner_are_left_out_of_the_mean():
    volume = np.array([[[8, 6], [8, 6], [8, 0]]], dtype=np.uint8)
    labels = np.zeros((1, 3), dtype=np.int32)
    found = np.array([[[-1, -1], [0, 1], [-1, -1]]], dtype=np.int16)
    scores = aggregate_in_segments(volume, labels, found, config=AggregationConfig(radius=1))
    np.testing.assert_allclose(scores[0, 1], [8, 6])


def test_weights_decay_with_the_distance_and_nearly_not_with_sigma_squared():
    weights = support_weights(AggregationConfig())
    assert weights.shape == (35, 35)
    assert weights[17, 17] == 1
    np.testing.assert_allclose(weights[17, 34], np.exp(-1), rtol=1e-6)
    np.testing.assert_allclose(weights[20, 21], np.exp(-5 / 17), rtol=1e-6)
    literal = support_weights(AggregationConfig(squared_sigma=True))
    np.testing.assert_allclose(literal[17, 34], np.exp(-17 / 289), rtol=1e-6)


def test_winner_takes_all_prefers_the_smaller_disparity_on_a_tie():
    candidates = np.array([[[7, 3, 5], [4, -1, -1], [-1, -1, -1]]], dtype=np.int16)
    scores = np.array([[[9.0, 9.0, 1.0], [2.0, -1, -1], [-1, -1, -1]]], dtype=np.float32)
    np.testing.assert_array_equal(winner_takes_all(scores, candidates), [[3, 4, -1]])
