import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr.config import HighlightsConfig
from stereohdr.restoration.highlights import Evidence, restore_highlights

CLIP = 1.0


def scene(seed=0, height=40, width=60, channels=3):
    """Return smooth positive radiance, about half of it above `CLIP`; the channels are alike, but not equal."""
    rng = np.random.default_rng(seed)
    common = ndimage.gaussian_filter(rng.normal(size=(height, width, 1)), (5, 5, 0)) * 10
    own = ndimage.gaussian_filter(rng.normal(size=(height, width, channels)), (5, 5, 0)) * 3
    return np.exp(common + own).astype(np.float32)


def clip(radiance):
    return np.minimum(radiance, np.float32(CLIP)), radiance >= CLIP


def nothing(main):
    return Evidence(np.zeros_like(main), np.zeros(main.shape, bool))


def rms_error(found, truth, where):
    return np.sqrt(np.mean(np.log(found[where] / truth[where]) ** 2))


@pytest.mark.parametrize("channels", [1, 3])
def test_what_the_auxiliary_view_measured_is_put_in(channels):
    truth = scene(channels=channels)
    main, clipped = clip(truth)
    assert 0.2 < clipped.mean() < 0.8
    measured = Evidence(truth, np.ones(truth.shape, bool))
    found = restore_highlights(main, clipped, measured, nothing(main))
    assert found.dtype == np.float32
    assert rms_error(found, truth, clipped) < 0.005
    np.testing.assert_array_equal(found[~clipped], main[~clipped])


def test_a_wrong_level_of_the_auxiliary_view_leaves_no_seam():
    """It is 10 % brighter throughout: at the rim the main view's level counts, its own farther inside."""
    row = 1.0 + 2.0 * np.exp(-(((np.arange(61) - 30) / 12) ** 2))
    truth = np.broadcast_to(row[None, :, None], (20, 61, 1)).astype(np.float32)
    main, clipped = np.minimum(truth, 1.5), truth >= 1.5
    measured = Evidence(1.1 * truth, np.ones(truth.shape, bool))
    found = restore_highlights(main, clipped, measured, nothing(main), config=HighlightsConfig(level_error=0.3))
    rim = np.flatnonzero(clipped[10, :, 0])[0]
    inside = np.log(found[10, rim, 0] / found[10, rim - 1, 0])
    assert inside == pytest.approx(np.log(row[rim] / row[rim - 1]), abs=0.03)
    assert found[10, 30, 0] == pytest.approx(3.3, rel=0.05)


def test_nothing_known_keeps_the_main_view_exactly():
    truth = scene(1, channels=1)
    main, clipped = clip(truth)
    np.testing.assert_array_equal(restore_highlights(main, clipped, nothing(main), nothing(main)), main)
    white = np.full((5, 6, 3), CLIP, np.float32)
    everything = np.ones(white.shape, bool)
    np.testing.assert_array_equal(restore_highlights(white, everything, nothing(white), nothing(white)), white)


def test_nothing_clipped_changes_nothing():
    main = scene(2)
    evidence = Evidence(10 * main, np.ones(main.shape, bool))
    found = restore_highlights(main, np.zeros(main.shape, bool), evidence, evidence)
    np.testing.assert_array_equal(found, main)


def test_a_darker_auxiliary_view_never_darkens_and_equal_is_unchanged():
    main = np.full((12, 12, 1), CLIP, np.float32)
    main[:3] = 0.2
    clipped = main == CLIP
    for factor in (0.3, 1.0):
        evidence = Evidence(np.float32(factor) * main, np.ones(main.shape, bool))
        np.testing.assert_array_equal(restore_highlights(main, clipped, evidence, nothing(main)), main)


@pytest.mark.parametrize("green", [0.2, 0.6])
def test_clipped_channels_follow_the_others_without_any_auxiliary_view(green):
    """A coloured spot: blue, and green if it is not clipped itself, show its shape where red is clipped."""
    y, x = np.mgrid[:31, :31] - 15
    spot = np.exp(1.5 * np.exp(-(x**2 + y**2) / 60))
    truth = (spot[..., None] * [0.6, green, 0.1]).astype(np.float32)
    main, clipped = clip(truth)
    assert clipped[..., 0].sum() > 60
    assert not clipped[..., 2].any()
    assert clipped[..., 1].any() == (green > 0.5)
    found = restore_highlights(main, clipped, nothing(main), nothing(main))
    assert rms_error(found, truth, clipped) < 0.4 * rms_error(main, truth, clipped)
    grey = restore_highlights(main[..., :1], clipped[..., :1], nothing(main[..., :1]), nothing(main[..., :1]))
    np.testing.assert_array_equal(grey, main[..., :1])


def test_the_bound_takes_part_in_the_fit():
    """Held at their clip value, dark neighbours lift what is to be ten times as bright as they."""
    evidence = np.full((12, 40, 1), 3.0, np.float32)
    evidence[:, :20] = 0.3
    main = np.full(evidence.shape, CLIP, np.float32)
    everywhere = np.ones(main.shape, bool)
    found = restore_highlights(main, everywhere, Evidence(evidence, everywhere), nothing(main))
    np.testing.assert_array_equal(found[:, :18], CLIP)
    assert found[6, 20, 0] > 3.5
    assert found[6, 35, 0] == pytest.approx(3.0, rel=0.01)


def test_unseen_highlights_are_taken_to_be_like_those_seen():
    """Two windows of the same brightness, one of which the auxiliary view sees."""
    truth = np.full((30, 60, 1), 0.5, np.float32)
    truth[5:25, 5:25] = truth[5:25, 35:55] = 4.0
    main, clipped = clip(truth)
    seen = np.zeros(truth.shape, bool)
    seen[:, :30] = True
    found = restore_highlights(main, clipped, Evidence(truth, seen), nothing(main))
    assert found[8:22, 8:22].min() > 3.8
    unseen = np.log(found[12:18, 42:48, 0])
    assert unseen.min() > 0.5 * np.log(4)
    assert unseen.max() < 1.1 * np.log(4)
    seen[9:] = False  # 80 pixels are hardly a basis
    few = restore_highlights(main, clipped, Evidence(truth, seen), nothing(main))
    assert np.log(few[12:18, 42:48]).max() < 0.5 * np.log(4)


def test_how_far_unseen_highlights_rise_depends_on_how_many_channels_are_clipped():
    truth = np.full((70, 280, 3), 0.5, np.float32)
    truth[5:65, 5:65] = truth[5:65, 75:135] = 6.0  # white windows
    truth[5:65, 145:205, 0] = truth[5:65, 215:275, 0] = 1.5  # red panels
    main, clipped = clip(truth)
    seen = np.zeros(truth.shape, bool)
    seen[:, :70] = seen[:, 140:210] = True
    found = restore_highlights(main, clipped, Evidence(truth, seen), nothing(main))
    np.testing.assert_allclose(found[25:45, 95:115, 0], 6.0, rtol=0.25)
    np.testing.assert_allclose(found[25:45, 235:255, 0], 1.5, rtol=0.25)


def test_measured_pixels_count_more_than_borrowed_ones():
    truth = np.full((20, 20, 1), 3.0, np.float32)
    main, clipped = clip(truth)
    usable = np.ones(truth.shape, bool)
    left = usable & (np.arange(20)[None, :, None] < 10)
    found = restore_highlights(main, clipped, Evidence(truth, left), Evidence(3 * truth, usable))
    np.testing.assert_allclose(found[:, :8], 3.0, rtol=0.02)
    assert found[:, 17:].min() > 5
    borrowed = restore_highlights(main, clipped, nothing(main), Evidence(3 * truth, usable))
    np.testing.assert_allclose(borrowed, 9.0, rtol=0.02)


def test_each_channel_uses_its_own_evidence():
    truth = np.full((16, 16, 3), 4.0, np.float32)
    truth[..., 1] = 2.0
    main, clipped = clip(truth)
    usable = np.zeros(truth.shape, bool)
    usable[..., 1] = True
    found = restore_highlights(main, clipped, Evidence(truth, usable), nothing(main))
    np.testing.assert_allclose(found[..., 1], 2.0, rtol=0.01)
    np.testing.assert_allclose(found[..., [0, 2]], 1.0)


@given(
    height=st.integers(1, 9),
    width=st.integers(1, 9),
    channels=st.sampled_from([1, 3]),
    share=st.sampled_from([0.0, 0.3, 1.0]),
    spread=st.sampled_from([0.1, 3.0, 12.0]),
    seed=st.integers(0, 999),
)
def test_any_evidence_gives_finite_radiance_that_is_nowhere_darker(height, width, channels, share, spread, seed):
    rng = np.random.default_rng(seed)
    shape = (height, width, channels)
    main = np.exp(rng.normal(0, spread, shape)).astype(np.float32)
    clipped = rng.random(shape) < share
    measured, borrowed = (
        Evidence((np.exp(rng.normal(0, spread, shape)) * (rng.random(shape) < 0.8)).astype(np.float32),
                 rng.random(shape) < 0.5)
        for _ in range(2)
    )  # fmt: skip
    found = restore_highlights(main, clipped, measured, borrowed)
    assert np.isfinite(found).all()
    assert (found >= main).all()
    np.testing.assert_array_equal(found[~clipped], main[~clipped])
    changed = found != main
    assert (found[changed] > 1.0009 * main[changed]).all()
