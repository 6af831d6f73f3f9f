import math

import numpy as np
import pytest

from stereohdr import Photo, ResponseCurve
from stereohdr.inspection import pair_facts, photo_facts
from stereohdr.simulation import Camera, expose, room


def test_shares_and_levels_by_hand():
    codes = np.full((10, 10, 3), 100, np.uint8)
    codes[0] = 0  # 10 % black
    codes[1:3, :, 0] = 255  # 20 % with one channel at its end
    facts = photo_facts(Photo(codes, 1 / 60, f_number=4, iso=400, exposure_source="file", camera="Acme"))
    assert (facts.black_share, facts.white_share) == (pytest.approx(0.1), pytest.approx(0.2))
    assert (facts.bits, facts.white_level, facts.highest_code, facts.clips_at) == (8, 255, 255, 255)
    assert facts.exposure_value == pytest.approx(math.log2(16 * 60) - 2)
    assert not facts.linear
    assert facts.note is None


def test_a_real_clip_point_below_the_white_level_is_found():
    rng = np.random.default_rng(0)
    codes = np.minimum(rng.integers(0, 6000, (80, 80)), 4000).astype(np.uint16)
    facts = photo_facts(Photo(codes, white_level=4095))
    assert facts.clips_at == 4000
    assert facts.white_share == pytest.approx((codes > 4000 * 250 / 255).mean())
    assert "give the white level 4095" in (photo_facts(Photo(codes)).note or "")


def test_black_is_less_dark_in_eight_bits():
    eight, deep = np.full((4, 4), 3, np.uint8), np.full((4, 4), 3 * 257, np.uint16)
    assert photo_facts(Photo(eight)).black_share == 1
    assert photo_facts(Photo(deep)).black_share == 0


@pytest.fixture(scope="module")
def views():
    scene = room(width=160, height=120)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    return scene.radiance_left / scale, scene.radiance_right / scale


def shot(view, time, **stated):
    """Take a photo; `stated` is the exposure time that it claims, where that is another one."""
    return Photo(expose(view, time, Camera(), 0).codes, stated.get("stated", time))


def test_a_good_pair(views):
    facts = pair_facts(shot(views[0], 0.5), shot(views[1], 0.125))
    assert facts.usable
    assert facts.problems == facts.notes == ()
    assert facts.exposure_ratio == pytest.approx(4)
    assert facts.estimated_ratio == pytest.approx(4, rel=0.15)
    assert facts.estimate_assumes == "srgb"
    assert facts.overlap > 0.6


def test_exposures_that_contradict_the_photos(views):
    facts = pair_facts(shot(views[0], 0.5, stated=0.125), shot(views[1], 0.125, stated=0.5))
    assert not facts.usable
    assert "the exposures contradict the photos" in facts.problems[0]


def test_unknown_and_equal_exposures(views):
    unknown = pair_facts(shot(views[0], 0.5, stated=None), shot(views[1], 0.125))
    assert not unknown.usable
    assert "the exposure time is not known" in unknown.problems[0]
    assert unknown.exposure_ratio is None
    assert unknown.estimated_ratio == pytest.approx(4, rel=0.15)
    equal = pair_facts(shot(views[0], 0.5), shot(views[1], 0.5))
    assert not equal.usable
    assert equal.exposure_ratio == 1


def test_what_is_lost_in_both_views():
    codes = np.full((20, 20), 120, np.uint8)
    codes[:10] = 255
    other = codes.copy()
    other[10:] = 200
    facts = pair_facts(Photo(codes, 0.1), Photo(other, 0.3))
    assert facts.white_in_both == pytest.approx(0.5, abs=0.01)
    assert facts.overlap == pytest.approx(0.5, abs=0.01)
    assert facts.black_in_both == 0


def test_too_little_in_common_is_a_problem():
    ramp = np.linspace(0, 255, 400).reshape(20, 20)
    dark, bright = np.clip(ramp - 246, 0, 255), np.clip(ramp + 246, 0, 255)
    facts = pair_facts(Photo(dark.astype(np.uint8), 0.1), Photo(bright.astype(np.uint8), 6.0))
    assert not facts.usable
    assert any("well exposed in both views; choose exposures closer together" in text for text in facts.problems)


def test_stated_times_are_compared_with_linear_codes():
    light = np.random.default_rng(0).uniform(0.05, 0.9, (60, 80, 3))
    photos = [
        Photo(np.rint(light * share * 4095).astype(np.uint16), time, 4095, response=ResponseCurve.linear(3))
        for share, time in ((1.0, 1.0), (0.25, 0.1))
    ]
    facts = pair_facts(*photos)
    assert facts.usable
    assert facts.notes == ("the exposures say a ratio of 10, the photos 4; check the times",)


def test_photos_of_different_size(views):
    other = Photo(np.zeros((8, 8, 3), np.uint8), 1.0)
    assert any("differ in size" in text for text in pair_facts(shot(views[0], 0.5), other).problems)
