import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.config import TwoWayConfig
from stereohdr.disparity import tiled
from stereohdr.disparity.semiglobal import Bands
from stereohdr.disparity.tiled import MatchingPlan, match_within, plan_matching
from stereohdr.disparity.two_way import match_two_ways
from stereohdr.metrics.stereo import bad_share
from stereohdr.model import Disparity, DisparityFlag
from stereohdr.radiance import luminance
from stereohdr.simulation.scenes import poles

GIB = 2**30


def noisy_views(seed, height, width):
    """Views without a common row of many, so that some rows have no match at all."""
    rng = np.random.default_rng(seed)
    scene = np.exp(rng.normal(size=(height, width + 5))).astype(np.float32)
    auxiliary = scene[:, :width].copy()
    auxiliary[height // 2 :] = np.exp(rng.normal(size=(height - height // 2, width)))
    return scene[:, 5:], auxiliary


def arrays(views):
    return [(view.disparity.values, view.disparity.flags, view.confidence) for view in views]


def assert_equal_views(got, expected):
    for one, other in zip(arrays(got), arrays(expected), strict=True):
        for a, b in zip(one, other, strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("height", "strips"), [(130, 2), (130, 5), (97, 4), (64, 2), (33, 2), (20, 1)])
@pytest.mark.parametrize("runs", [1, 2])
def test_strips_change_nothing(height, strips, runs):
    main, auxiliary = noisy_views(1, height, 60)
    settings = {"disparities": (-2, 20), "config": TwoWayConfig(runs=runs)}
    whole = match_two_ways(main, auxiliary, **settings)
    assert_equal_views(match_within(main, auxiliary, MatchingPlan(strips, False, 0), **settings), whole)


@pytest.mark.parametrize("coarse_to_fine", [False, True])
def test_threads_do_not_change_a_byte(coarse_to_fine):
    main, auxiliary = noisy_views(2, 100, 90)
    plan = MatchingPlan(3, coarse_to_fine, 0)
    one, *others = (match_within(main, auxiliary, plan, disparities=(0, 70), threads=n) for n in (1, 2, 4))
    for other in others:
        assert_equal_views(other, one)


def test_coarse_to_fine_with_few_disparities_tries_them_all():
    main, auxiliary = noisy_views(3, 70, 80)
    whole = match_two_ways(main, auxiliary, disparities=(0, 31))
    assert_equal_views(match_within(main, auxiliary, MatchingPlan(2, True, 0), disparities=(0, 31)), whole)


def test_coarse_to_fine_keeps_thin_poles():
    scene = poles(960, 720, supersampling=1)
    rows = slice(200, 520)
    main, auxiliary = (luminance(view[rows]) for view in (scene.radiance_left, scene.radiance_right))
    disparities = 0, 95
    truth = Disparity(scene.disparity_left.values[rows], scene.disparity_left.flags[rows])
    seen = truth.flags == DisparityFlag.MATCHED
    pole = seen & (truth.values > 20)  # the wall has 15
    assert 0.01 < pole.mean() < 0.03
    whole, _ = match_two_ways(main, auxiliary, disparities=disparities)
    fine, _ = match_within(main, auxiliary, MatchingPlan(2, True, 0), disparities=disparities)
    assert (fine.disparity.values != whole.disparity.values).any()
    for region, more in ((seen, 0.003), (pole, 0.01)):
        bad, bad_in_bands = (
            bad_share(match.disparity, truth, threshold=2, region=region) for match in (whole, fine)
        )
        assert bad < 0.05
        assert bad_in_bands <= bad + more


def test_bands_hold_what_is_near_with_slack_in_whole_vectors():
    sampled = np.full((16, 130), 50.0, dtype=np.float32)  # of 128 rows: 4 rows of blocks, 5 columns
    sampled[1, 70] = 180.4
    bands = tiled._bands_around(sampled, (128, 130), (0, 255))
    assert bands.lowest.shape == bands.count.shape == (4, 5)
    # 180.4 is in block (0, 2) and seen from those around it: 34 to 197 are 164 disparities, in 6 vectors 192, 14
    # more on either side. Elsewhere 34 to 66 are 33: in 2 vectors 64, 15 more below and 16 above.
    near = np.zeros((4, 5), dtype=bool)
    near[:2, 1:4] = True
    np.testing.assert_array_equal(bands.lowest, np.where(near, 20, 19))
    np.testing.assert_array_equal(bands.count, np.where(near, 192, 64))


@given(
    height=st.integers(1, 90),
    width=st.integers(1, 90),
    lowest=st.integers(-40, 40),
    count=st.integers(1, 150),
    seed=st.integers(0, 99),
)
def test_bands_stay_in_the_range_and_hold_what_was_found(height, width, lowest, count, seed):
    highest = lowest + count - 1
    rows = len(range(min(4, height - 1), height, 8))
    sampled = np.random.default_rng(seed).uniform(lowest, highest, (rows, width)).astype(np.float32)
    bands = tiled._bands_around(sampled, (height, width), (lowest, highest))
    assert bands.lowest.min() >= lowest
    assert (bands.lowest + bands.count - 1).max() <= highest
    assert (bands.count >= min(32, count)).all()
    for row, column in np.ndindex(bands.lowest.shape):
        found = sampled[4 * row : 4 * row + 4, 32 * column : 32 * column + 32]
        assert (found >= bands.lowest[row, column]).all()
        assert (found <= bands.lowest[row, column] + bands.count[row, column]).all()


def test_strips_in_bands_are_as_high_as_memory_allows():
    strips = [(0, 64), (64, 128), (128, 150)]
    lowest = np.zeros((5, 4), dtype=np.int64)
    short, full = Bands(32, lowest, lowest + 32), Bands(32, lowest, lowest + 256)
    assert tiled._fewer_strips((150, 100), strips, (short, short), (0, 255)) == [(0, 150)]
    assert tiled._fewer_strips((150, 100), strips, (short, full), (0, 255)) == strips


def test_a_plan_is_the_first_that_fits():
    # 695x555, 120 disparities: 100 MB for the volume alone.
    assert plan_matching((555, 695), (0, 119)).strips == 1
    whole = plan_matching((555, 695), (0, 119), memory=GIB)
    assert whole == plan_matching((555, 695), (0, 119))
    assert 2 * 555 * 695 * 128 < whole.bytes < 1.75 * 2 * 555 * 695 * 128
    less = plan_matching((555, 695), (0, 119), memory=whole.bytes - 1)
    assert (less.strips, less.coarse_to_fine) == (2, False)
    large = plan_matching((4000, 6000), (0, 511), memory=3 * GIB)
    assert large.coarse_to_fine
    assert large.bytes < 3 * GIB
    assert plan_matching((4000, 6000), (0, 511), memory=64 * GIB).coarse_to_fine  # the same on every machine
    assert not plan_matching((4000, 6000), (0, 200), memory=3 * GIB).coarse_to_fine


def test_a_plan_that_fits_nowhere_says_what_the_least_is():
    least = plan_matching((4000, 6000), (0, 511), memory=1)
    assert least.bytes > 1
    assert plan_matching((4000, 6000), (0, 511), memory=least.bytes).bytes <= least.bytes
    assert plan_matching((20, 60), (0, 5), memory=1).bytes == plan_matching((20, 60), (0, 5)).bytes


@pytest.mark.parametrize(("height", "width", "count", "strips"), [(300, 500, 150, 1), (520, 700, 120, 4)])
def test_the_memory_is_as_planned(height, width, count, strips):
    main, auxiliary = noisy_views(4, height, width)
    disparities = 0, count - 1
    planned = tiled._bytes((height, width), disparities, tiled._strip_height(height, strips), 2)
    match_within(main[:40], auxiliary[:40], MatchingPlan(1, False, 0), disparities=disparities)  # compiles
    tracemalloc.start()
    match_within(main, auxiliary, MatchingPlan(strips, False, 0), disparities=disparities)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak == pytest.approx(planned, rel=0.15)


def test_strips_are_no_larger_than_is_fast_and_cover_all_disparities():
    shape, disparities = (1080, 1920), (0, 255)
    plan = plan_matching(shape, disparities)
    assert plan.strips == 3
    assert not plan.coarse_to_fine
    whole = plan_matching(shape, disparities, memory=2**40)
    assert whole == plan
    assert plan_matching((4000, 6000), (0, 200)).strips > 8
