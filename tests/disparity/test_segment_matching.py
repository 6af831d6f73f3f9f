import numpy as np
import pytest

from stereohdr import DisparityFlag
from stereohdr.disparity import (
    aggregate_in_segments,
    census_transform,
    estimate_disparity,
    segment_matching,
    select_candidates,
    similarity_volume,
    winner_takes_all,
)

from conftest import smooth_codes


def views(height=70, width=60, shift=6):
    rng = np.random.default_rng(2)
    scene = smooth_codes(rng, height, width + shift, 1)[..., 0] + rng.uniform(0, 80, (height, width + shift))
    scene = (scene + 5).astype(np.float32)
    return np.ascontiguousarray(scene[:, shift:]), np.ascontiguousarray(scene[:, :width])


def test_a_shift_is_found_and_only_the_interest_is_computed():
    auxiliary, main = views()
    segments = np.zeros(auxiliary.shape, dtype=np.int32)
    interest = np.zeros(auxiliary.shape, dtype=bool)
    interest[10:50, :40] = True
    disparity = estimate_disparity(auxiliary, main, segments, interest, max_disparity=20)
    np.testing.assert_array_equal(disparity.flags == DisparityFlag.MATCHED, interest)
    assert (disparity.values[interest] == 6).mean() > 0.99
    assert (disparity.values[~interest] == 0).all()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("strip_rows", [7, 48, 1000])
def test_strips_and_threads_equal_the_steps_on_the_whole_image(threads, strip_rows, monkeypatch):
    auxiliary, main = views()
    rng = np.random.default_rng(0)
    segments = rng.integers(0, 3, auxiliary.shape).astype(np.int32)
    interest = rng.random(auxiliary.shape) < 0.5
    volume = similarity_volume(census_transform(auxiliary), census_transform(main), max_disparity=15)
    found = select_candidates(volume, interest)
    expected = winner_takes_all(aggregate_in_segments(volume, segments, found), found)
    monkeypatch.setattr(segment_matching, "STRIP_ROWS", (strip_rows, strip_rows))
    got = estimate_disparity(auxiliary, main, segments, interest, max_disparity=15, threads=threads)
    np.testing.assert_array_equal(got.values, np.maximum(expected, 0))
    np.testing.assert_array_equal(got.valid, expected >= 0)


def test_partners_never_lie_outside_the_main_view():
    auxiliary, main = views(width=30)
    segments = np.zeros(auxiliary.shape, dtype=np.int32)
    everywhere = np.ones(auxiliary.shape, dtype=bool)
    disparity = estimate_disparity(auxiliary, main, segments, everywhere, max_disparity=29)
    assert (np.arange(30) + disparity.values <= 29).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1)])
def test_tiny_views(size):
    image = np.ones(size, dtype=np.float32)
    disparity = estimate_disparity(
        image, image, np.zeros(size, dtype=np.int32), np.ones(size, dtype=bool), max_disparity=0
    )
    assert disparity.valid.all()
    assert (disparity.values == 0).all()
