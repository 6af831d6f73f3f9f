"""What method `robust` plans to take, against what it takes."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from stereohdr import RobustConfig, StereoPair, fuse, fuse_other_view
from stereohdr.config import SurveyConfig
from stereohdr.disparity.tiled import plan_matching
from stereohdr.errors import MemoryLimitError
from stereohdr.memory import PROCESS_BYTES, Budget, parse_size
from stereohdr.methods.robust_plan import plan_robust

from conftest import make_pair

LONG_SHORT, SHORT_LONG = (0.64, 0.04), (0.02, 0.32)
MIB = 2**20
SMALL_SURVEY = RobustConfig(survey=SurveyConfig(width=32))


def wall(times, *, height=200, width=240, channels=3):
    """A pair with clipped pixels, also in corners, so that all rows and columns are to be restored."""
    pair = make_pair(height, width, times=times, channels=channels)
    codes = pair.left.codes.copy()
    codes[0, 0] = codes[-1, -1] = 255
    return StereoPair(type(pair.left)(codes, times[0], name="left.png"), pair.right)


def traced_peak(*arguments, **options):
    """Return the result of `fuse`, and the most memory that its arrays took beside the pair."""
    fuse(*arguments, **options)  # compiles, imports, and fills caches
    tracemalloc.start()
    try:
        result = fuse(*arguments, **options)
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("keep_stages", [False, True])
@pytest.mark.parametrize("main", ["left", "right"])
@pytest.mark.parametrize(
    ("times", "channels"), [(LONG_SHORT, 3), (SHORT_LONG, 3), (LONG_SHORT, 1), (SHORT_LONG, 1)]
)
def test_the_estimate_holds_and_is_not_far_off(times, channels, main, keep_stages):
    pair = wall(times, height=500, width=700, channels=channels)
    pair = StereoPair(pair.left, pair.right, main=main)
    # So few disparities that the stages after the matching take the most.
    result, peak = traced_peak(pair, config=RobustConfig(max_disparity=10), keep_stages=keep_stages)
    planned = result.statistics["memory_estimate"] - PROCESS_BYTES
    photos = pair.left.codes.nbytes + pair.right.codes.nbytes
    assert planned / 1.5 < peak + photos < 1.05 * planned


def test_the_survey_counts_where_it_takes_the_most():
    pair = make_pair(1200, 300)
    result, peak = traced_peak(pair, config=RobustConfig(max_disparity=None))
    planned = result.statistics["memory_estimate"] - PROCESS_BYTES
    photos = pair.left.codes.nbytes + pair.right.codes.nbytes
    assert planned / 1.5 < peak + photos < 1.05 * planned


def test_a_budget_says_what_is_held_when_the_other_view_is_made():
    pair = wall(LONG_SHORT)
    result = fuse(pair)
    less, more = (
        fuse_other_view(pair, result, memory=Budget(2**40, held)).statistics["memory_estimate"]
        for held in (0, MIB)
    )
    assert more == less + MIB


@pytest.mark.parametrize("known", [False, True])
def test_what_takes_the_most_is_named(known):
    pair = wall(LONG_SHORT)
    clipped = np.zeros((200, 240), dtype=bool)
    disparities = None if known else (0, 100)
    budget = Budget(limit=2**40, held=7)
    plan, matching = plan_robust(pair, disparities, SMALL_SURVEY, budget, clipped=clipped, keep_stages=False)
    assert plan.limit == 2**40
    assert plan.stage == ("the result" if known else "matching")
    if known:
        assert plan.estimate == 7 + (14 + 23 * 3) * clipped.size
    else:
        assert matching == plan_matching((200, 240), (0, 100))
        assert plan.estimate == 7 + 8 * clipped.size + matching.bytes
    clipped[3:50, 20:90] = True  # with the pixels around: 49 rows, 72 columns
    for threads, at_once in ((1, 1), (2, 2), (8, 3)):
        plan, _ = plan_robust(
            pair, None, SMALL_SURVEY, budget, clipped=clipped, keep_stages=False, threads=threads
        )
        box = at_once * 49 * (28 * 240 + 72 * 72)
        assert plan.estimate == 7 + max((14 + 23 * 3) * 48_000, (20 + 11 * 3) * 48_000 + box)


@pytest.mark.parametrize("times", [LONG_SHORT, SHORT_LONG])
def test_a_limit_that_asks_for_strips_changes_no_byte(times):
    pair = wall(times)
    config = replace(SMALL_SURVEY, max_disparity=100)
    whole = fuse(pair, config=config, memory="4GiB")
    assert whole.statistics["matching_strips"] == 1
    limit = int(whole.statistics["memory_estimate"]) - 4 * MIB
    strips = fuse(pair, config=config, memory=limit)
    assert strips.statistics["matching_strips"] > 1
    assert strips.statistics["coarse_to_fine"] == 0
    assert strips.statistics["memory_estimate"] <= limit
    for name in ("radiance", "source", "weight", "confidence"):
        np.testing.assert_array_equal(getattr(strips, name), getattr(whole, name))
    np.testing.assert_array_equal(strips.disparity.values, whole.disparity.values)
    np.testing.assert_array_equal(strips.main_disparity.values, whole.main_disparity.values)


def test_what_does_not_fit_is_refused_with_what_would():
    pair = wall(LONG_SHORT)
    with pytest.raises(
        MemoryLimitError, match=r"^left\.png and right need about \d+MiB .*limit is 260MiB"
    ) as refusal:
        fuse(pair, memory=260 * MIB)
    needed = str(refusal.value).partition("about ")[2].split()[0]
    result = fuse(pair, memory=needed)
    assert result.statistics["memory_estimate"] <= parse_size(needed)


def test_the_first_result_counts_when_the_other_view_is_made():
    pair = wall(LONG_SHORT)
    result = fuse(pair)
    other = fuse_other_view(pair, result)
    photos = (
        pair.left.codes.nbytes + pair.right.codes.nbytes
    )  # the pair is held twice, the second time in a mirror
    held = result.radiance.nbytes + result.source.nbytes + result.weight.nbytes + result.confidence.nbytes
    held += sum(d.values.nbytes + d.flags.nbytes for d in (result.disparity, result.main_disparity))
    again = fuse(
        StereoPair(pair.left, pair.right, main="right"),
        response=result.response,
        checks=False,
        memory=Budget(2**40, 0),
    )
    assert other.statistics["memory_estimate"] == again.statistics["memory_estimate"] + held
    assert again.statistics["memory_estimate"] > PROCESS_BYTES + 2 * photos
    with pytest.raises(MemoryLimitError):
        fuse_other_view(pair, result, memory=int(other.statistics["memory_estimate"]) - 20 * MIB)


def test_coarse_to_fine_is_said(monkeypatch):
    from stereohdr.disparity import tiled

    monkeypatch.setattr(tiled, "MOST_CELLS", 0)
    pair = wall(LONG_SHORT)
    config = RobustConfig(max_disparity=100)
    whole = fuse(pair, config=config)
    fine = fuse(pair, config=config, memory=int(whole.statistics["memory_estimate"]) - 4 * MIB)
    assert fine.statistics["coarse_to_fine"] == 1
    again = fuse(pair, config=config, memory=int(whole.statistics["memory_estimate"]) - 4 * MIB)
    np.testing.assert_array_equal(fine.radiance, again.radiance)
