import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr import Disparity, DisparityFlag
from stereohdr.config import TwoWayConfig
from stereohdr.disparity import two_way
from stereohdr.disparity.semiglobal import SemiGlobalMatch
from stereohdr.disparity.two_way import (
    confirmed_left_right,
    fill_disparity,
    given_match,
    hidden,
    match_two_ways,
    partner_columns,
)

MATCHED, OCCLUDED, MISMATCHED = DisparityFlag.MATCHED, DisparityFlag.OCCLUDED, DisparityFlag.MISMATCHED


def semiglobal_match(values, margin=40):
    """Return the match of a one-row view with these disparities."""
    values = np.float32([values])
    zeros = np.zeros_like(values)
    margins = np.broadcast_to(np.uint16(margin), values.shape)
    return SemiGlobalMatch(values, zeros.astype(np.uint16), margins, zeros.astype(np.uint8))


def flipped(match):
    return SemiGlobalMatch(*(getattr(match, name)[:, ::-1]
                             for name in ("disparity", "cost", "margin", "matching_cost")))  # fmt: skip


def flagged(values, flags):
    return Disparity(np.float32(values), np.array(flags, np.uint8))


def two_layers(seed=0, height=50, width=120):
    """Return views of a wall at disparity 3 and of a panel at 10.5 before it, columns 50 to 79 of the main view.

    The panel hides columns 43 to 49 of the main view's wall from the auxiliary view.
    """
    rng = np.random.default_rng(seed)
    wall, panel = (
        np.exp(ndimage.gaussian_filter(rng.normal(size=(height, width + 40)), (1.0, 1.5)) * 3) for _ in range(2)
    )
    y, x = np.mgrid[:height, :width].astype(float)
    main, auxiliary = wall[:, :width].copy(), wall[:, 3 : width + 3].copy()
    main[:, 50:80] = panel[:, 50:80]
    auxiliary[:, 40:70] = ndimage.map_coordinates(panel, [y[:, 40:70], x[:, 40:70] + 10.5], order=3)
    return main.astype(np.float32), np.maximum(auxiliary, 1e-3).astype(np.float32)


def test_the_partner_is_the_nearest_column_inside():
    values = np.float32([[0.4, 0.6, -1.0, 3.6, 0.0, 2.5]])
    column, inside = partner_columns(values, sign=-1)
    # x - d: -0.4, 0.4, 3, -0.6, 4, 2.5.
    np.testing.assert_array_equal(column, [[0, 0, 3, 0, 4, 3]])
    np.testing.assert_array_equal(inside, [[False, True, True, False, True, True]])
    mirrored, _ = partner_columns(values[:, ::-1], sign=1)
    np.testing.assert_array_equal(5 - mirrored[:, ::-1], column)
    column, inside = partner_columns(values, sign=1)
    # x + d: 0.4, 1.6, 1, 6.6, 4, 7.5.
    np.testing.assert_array_equal(column, [[0, 2, 1, 5, 4, 5]])
    np.testing.assert_array_equal(inside, [[True, True, True, False, True, False]])


def test_left_and_right_confirm_each_other_within_the_tolerance():
    main = semiglobal_match([1, 1, 1, 3, 1])
    auxiliary = semiglobal_match([2.5, 2.6, 1, 1, -9])
    of_main, of_auxiliary = confirmed_left_right(main, auxiliary, tolerance=1.5)
    # Main pixel 1 meets 2.5, 2 meets 2.6, 3 meets 2.5 (at column 0), 4 meets 1. Pixel 0 has no partner.
    np.testing.assert_array_equal(of_main, [[False, True, False, True, True]])
    # Auxiliary pixel 0 (2.5) goes to column 2, 1 to 4 (rounded 3.6), 2 and 3 to 3 and 4.
    np.testing.assert_array_equal(of_auxiliary, [[True, False, False, True, False]])


def test_unmatched_pixels_take_the_farther_neighbour_of_their_row():
    disparity = flagged(
        [[9, 5, 9, 9, 2, 9], [9, -1, 9, 4, 9, 9], [9, 9, 9, 9, 9, 9]],
        [
            [OCCLUDED, MATCHED, MISMATCHED, OCCLUDED, MATCHED, OCCLUDED],
            [OCCLUDED, MATCHED, OCCLUDED, MATCHED, MISMATCHED, 0],
            [OCCLUDED] * 6,
        ],
    )
    found = fill_disparity(disparity)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found[:2], [[5, 5, 2, 2, 2, 2], [-1, -1, -1, 4, 4, 4]])
    np.testing.assert_array_equal(found[2], 3)  # the median of 5, 2, -1 and 4
    nothing = flagged(np.full((2, 3), 7), np.full((2, 3), OCCLUDED))
    np.testing.assert_array_equal(fill_disparity(nothing), 0)


def test_what_lies_behind_something_nearer_is_hidden():
    of_main = flagged([[0, 1, 1, 1, 2.6]], [[MATCHED, OCCLUDED, MISMATCHED, MATCHED, MATCHED]])
    of_auxiliary = flagged([[4, 2.1, 9, 3, 0]], [[MATCHED, MATCHED, OCCLUDED, MATCHED, MATCHED]])
    # Seen at x - d: column 0 (4), 0 (4), 1 (2.1), 2 (not matched), 1 (2.1).
    np.testing.assert_array_equal(hidden(of_main, of_auxiliary, tolerance=1.0), [[True, True, True, False, False]])
    np.testing.assert_array_equal(
        hidden(of_main, of_auxiliary, tolerance=3.0), [[True, False, False, False, False]]
    )


class Answering:
    """Stands for a `StripMatcher`, with a known answer for the whole image."""

    def __init__(self, answer):
        self.answer = answer

    def rows_around(self, strip):
        return strip

    def cells(self, strip):
        return 0

    def match(self, strip, *views, scratch):
        return self.answer


def test_two_runs_by_hand(monkeypatch):
    """See the arrays as x of the main view going to x - d, and x of the auxiliary view to x + d.

    =================  =======================================================================================
    main pixel         found
    =================  =======================================================================================
    0                  its partner is outside
    1                  its partner (column 0) has 4; no confirmed auxiliary pixel comes here
    2                  its partner (column 0) has 4, but the confirmed auxiliary pixel 1 comes here
    3                  confirmed in the second run only
    4                  confirmed in the first run only
    5                  confirmed in both, which disagree by 2
    6                  confirmed in both, which differ by 1
    =================  =======================================================================================
    """
    first = (semiglobal_match([1, 1, 2, -1, 1, 1, 1], 40), semiglobal_match([4, 1, 1, 1, 1, 1, 1], 80))
    second = (semiglobal_match([1, 1, 2, 1.25, -5, 3, 2], 120), semiglobal_match([4, 1, 2, 1, 1, 1, 1], 360))
    answers = [first, (flipped(second[1]), flipped(second[0]))]
    monkeypatch.setattr(two_way, "StripMatcher", lambda *shape, **settings: Answering(answers.pop(0)))
    view = np.ones((1, 7), np.float32)
    main, auxiliary = match_two_ways(view, view, disparities=(0, 3))

    np.testing.assert_array_equal(
        main.disparity.flags, [[OCCLUDED, OCCLUDED, MISMATCHED, MATCHED, MATCHED, MATCHED, MATCHED]]
    )
    np.testing.assert_array_equal(main.disparity.values, np.float32([[1.25, 1.25, 1.25, 1.25, 1, 1, 1]]))
    # margin / (margin + 40): 1/2 in the first run, 3/4 in the second; 0.6 for a single run.
    np.testing.assert_allclose(main.confidence, [[0, 0, 0, 0.6 * 0.75, 0.6 * 0.5, 0.6 * 0.5, 0.5]], rtol=1e-6)

    # Auxiliary pixels 1 and 5 are confirmed in both runs, 3 and 4 in the first; main pixel 3 comes to 2.
    np.testing.assert_array_equal(
        auxiliary.disparity.flags, [[OCCLUDED, MATCHED, MISMATCHED, MATCHED, MATCHED, MATCHED, OCCLUDED]]
    )
    np.testing.assert_array_equal(auxiliary.disparity.values, [[1] * 7])
    # Its own run is the second: margin 360 gives 9/10, and 80 gives 2/3.
    np.testing.assert_allclose(auxiliary.confidence, [[0, 0.9, 0, 0.4, 0.4, 0.9, 0]], rtol=1e-6)


def test_one_run_by_hand(monkeypatch):
    answer = (semiglobal_match([1, 1, 2, -1, 1, 1, 1], 40), semiglobal_match([4, 1, 1, 1, 1, 1, 1], 80))
    monkeypatch.setattr(two_way, "StripMatcher", lambda *shape, **settings: Answering(answer))
    view = np.ones((1, 7), np.float32)
    config = TwoWayConfig(runs=1, one_run=0.5, usual_margin=120)
    main, auxiliary = match_two_ways(view, view, disparities=(0, 3), config=config)
    np.testing.assert_array_equal(
        main.disparity.flags, [[OCCLUDED, OCCLUDED, MISMATCHED, OCCLUDED, MATCHED, MATCHED, MATCHED]]
    )
    np.testing.assert_array_equal(main.disparity.values, [[1] * 7])
    np.testing.assert_allclose(main.confidence, [[0, 0, 0, 0, 0.125, 0.125, 0.125]])
    np.testing.assert_allclose(auxiliary.confidence, [[0, 0.2, 0, 0.2, 0.2, 0.2, 0]], rtol=1e-6)


@pytest.mark.parametrize("runs", [1, 2])
def test_both_layers_are_found_and_what_is_hidden_is_background(runs):
    main, auxiliary = two_layers()
    of_main, of_auxiliary = match_two_ways(main, auxiliary, disparities=(0, 16), config=TwoWayConfig(runs=runs))
    truth = np.full(main.shape, 3.0)
    truth[:, 50:80] = 10.5
    seen = np.ones(main.shape, bool)
    seen[:, 43:50] = seen[:, :3] = False
    matched = of_main.disparity.flags == MATCHED
    assert matched[seen].mean() > 0.97
    assert (np.abs(of_main.disparity.values - truth)[matched & seen] < 0.6).mean() > 0.97
    hidden = np.zeros(main.shape, bool)
    hidden[:, 44:48] = True
    assert (of_main.disparity.flags == OCCLUDED)[hidden].mean() > 0.8
    assert np.median(of_main.disparity.values[hidden]) == pytest.approx(3, abs=0.5)
    assert (of_main.disparity.values[hidden] < 5).mean() > 0.9
    assert (of_main.disparity.flags[:, :2] == OCCLUDED).all()
    # The auxiliary view does not see what the panel hides on its right.
    assert (of_auxiliary.disparity.flags[:, 72:76] == OCCLUDED).mean() > 0.8
    assert (of_auxiliary.disparity.values[:, 72:76] < 5).mean() > 0.9
    assert (np.abs(of_auxiliary.disparity.values[:, 44:66] - 10.5) < 0.6).mean() > 0.97
    assert (of_main.confidence[~matched] == 0).all()
    assert (of_main.confidence[matched] > 0).mean() > 0.99


def test_confidence_tells_right_from_wrong():
    main, auxiliary = two_layers(1)
    other = two_layers(2)[1]
    auxiliary[25:] = other[25:]  # unrelated
    found, _ = match_two_ways(main, auxiliary, disparities=(0, 16))
    related, unrelated = found.confidence[:20], found.confidence[30:]
    assert np.median(related) > 0.7
    assert np.median(unrelated) < 0.45
    assert (related > 0.6).mean() > 2.5 * (unrelated > 0.6).mean()


def test_in_a_mirror_the_views_change_places():
    main, auxiliary = two_layers(3)
    of_main, of_auxiliary = match_two_ways(main, auxiliary, disparities=(-2, 14))
    first, second = match_two_ways(auxiliary[:, ::-1], main[:, ::-1], disparities=(-2, 14))
    for found, expected in ((first, of_auxiliary), (second, of_main)):
        mirrored = found.mirrored()
        np.testing.assert_array_equal(mirrored.disparity.values, expected.disparity.values)
        np.testing.assert_array_equal(mirrored.disparity.flags, expected.disparity.flags)
        np.testing.assert_array_equal(mirrored.confidence, expected.confidence)


def test_the_second_run_changes_something():
    main, auxiliary = two_layers(4)
    one, two = (
        match_two_ways(main, auxiliary, disparities=(0, 16), config=TwoWayConfig(runs=runs))[0] for runs in (1, 2)
    )
    assert (one.disparity.values != two.disparity.values).any()
    assert (two.disparity.flags == MATCHED).sum() >= (one.disparity.flags == MATCHED).sum()


@given(
    height=st.integers(1, 6),
    width=st.integers(1, 12),
    lowest=st.integers(-5, 3),
    count=st.integers(1, 9),
    kind=st.sampled_from(["noise", "flat", "steps"]),
    runs=st.sampled_from([1, 2]),
    seed=st.integers(0, 99),
)
def test_any_views_give_finite_values_and_flags_that_agree(height, width, lowest, count, kind, runs, seed):
    lowest = max(min(lowest, width - 1), 2 - width - count)
    rng = np.random.default_rng(seed)
    shape = (2, height, width)
    views = {
        "noise": rng.uniform(1e-9, 1e9, shape),
        "flat": np.full(shape, 2.0),
        "steps": rng.choice([1e-30, 1.0, 1e30], shape),
    }[kind].astype(np.float32)
    matches = match_two_ways(*views, disparities=(lowest, lowest + count - 1), config=TwoWayConfig(runs=runs))
    for match in matches:
        values, flags = match.disparity.values, match.disparity.flags
        assert values.dtype == match.confidence.dtype == np.float32
        assert flags.dtype == np.uint8
        assert np.isin(flags, (MATCHED, OCCLUDED, MISMATCHED)).all()
        if (flags == MATCHED).any():
            assert values.min() >= lowest - 0.5
            assert values.max() <= lowest + count - 0.5
        else:
            assert (values == 0).all()
        assert ((match.confidence > 0) <= (flags == MATCHED)).all()
        assert (match.confidence <= 1).all()


def test_a_given_disparity_is_carried_to_the_main_view():
    known = flagged([[1, 1, 2, 7, 0]], [[MATCHED, MATCHED, MATCHED, OCCLUDED, MATCHED]])
    of_main, of_auxiliary = given_match(known)
    # 0 -> 1, 1 -> 2, 2 -> 4, 4 -> 4 (behind the 2 of pixel 2); columns 0 and 3 get nothing.
    np.testing.assert_array_equal(of_main.disparity.values, [[1, 1, 1, 1, 2]])
    np.testing.assert_array_equal(of_main.disparity.flags, [[OCCLUDED, MATCHED, MATCHED, OCCLUDED, MATCHED]])
    np.testing.assert_array_equal(of_main.confidence, [[0, 1, 1, 0, 1]])
    np.testing.assert_array_equal(of_auxiliary.disparity.values, [[1, 1, 2, 0, 0]])
    np.testing.assert_array_equal(of_auxiliary.disparity.flags, known.flags)
    np.testing.assert_array_equal(of_auxiliary.confidence, [[1, 1, 1, 0, 1]])
