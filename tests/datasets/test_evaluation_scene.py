from dataclasses import replace

import numpy as np
import pytest

from stereohdr import Disparity, Photo, ResponseCurve, StereoPair
from stereohdr.datasets import (
    EvaluationScene,
    StereoBracket,
    bracket_scene,
    channel_mask,
    luminance_mask,
    visible_in_auxiliary,
)
from stereohdr.errors import InputError


def make_scene(codes, *, dtype: type = np.uint8, white=None, **more):
    codes = np.asarray(codes, dtype)
    pair = StereoPair(Photo(codes, 1.0, white), Photo(codes, 4.0, white))
    shape = pair.left.codes.shape
    fields = {
        "name": "test",
        "pair": pair,
        "reference": np.ones(shape, np.float32),
        "reference_clipped": np.zeros(shape[:2], bool),
        "max_disparity": 1,
    }
    return EvaluationScene(**{**fields, **more})


def test_masks_by_luminance_and_by_channel():
    # Only red is white; grey at both limits of the paper; grey at both limits of a channel.
    row = [[255, 100, 100], [4, 4, 4], [251, 251, 251], [248, 248, 248], [247, 247, 247], [5, 5, 5]]
    scene = make_scene([row])
    assert luminance_mask(scene).tolist() == [[False, True, True, False, False, False]]
    assert channel_mask(scene).tolist() == [[True, True, True, True, False, False]]


def test_masks_scale_with_the_white_level():
    scene = make_scene([[[4095], [3983], [3982], [80], [81], [2000]]], dtype=np.uint16, white=4095)
    assert channel_mask(scene).tolist() == [[True, True, False, True, False, False]]


def test_visibility_is_what_the_flags_say():
    codes = np.full((1, 4, 1), 9)
    assert visible_in_auxiliary(make_scene(codes)) is None
    truth = Disparity(np.ones((1, 4), np.float32), np.array([[0, 1, 2, 1]], np.uint8))
    visible = visible_in_auxiliary(make_scene(codes, disparity_main=truth))
    assert visible is not None
    assert visible.tolist() == [[False, True, False, True]]


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("reference", np.ones((3, 4, 1), np.float32), "reference has shape"),
        ("reference", np.zeros((4, 6, 1), np.float32), "positive and finite"),
        ("reference", np.full((4, 6, 1), np.nan, np.float32), "positive and finite"),
        ("reference_clipped", np.zeros((4, 6, 1), bool), "reference_clipped has shape"),
        ("max_disparity", 6, "1 to 5"),
        ("max_disparity", 0, "1 to 5"),
        (
            "disparity_auxiliary",
            Disparity(np.zeros((4, 5), np.float32), np.zeros((4, 5), np.uint8)),
            "disparity_auxiliary has shape",
        ),
    ],
)
def test_what_does_not_fit_is_refused(field, value, words):
    with pytest.raises(InputError, match=f"scene test: .*{words}"):
        make_scene(np.full((4, 6, 1), 9), **{field: value})


def small_bracket(*, rectified):
    rng = np.random.default_rng(0)
    radiance = rng.uniform(2, 60, (8, 12, 1))

    def photos(side):
        times = (4.0, 1.0) if side == "left" else (1.0, 4.0)
        return tuple(Photo(np.rint(radiance * time).astype(np.uint8), time, name=side) for time in times)

    return StereoBracket("rig", photos("left"), photos("right"), ResponseCurve.gamma(1.0, 1), rectified)


def test_a_stereo_bracket_sorts_its_photos():
    bracket = small_bracket(rectified=False)
    assert [photo.exposure_time for photo in bracket.left] == [1.0, 4.0]
    assert bracket.photo("right", 4.001).exposure_time == 4.0
    with pytest.raises(InputError, match="no photo at 2 s; there are 1, 4 s"):
        bracket.photo("left", 2.0)
    with pytest.raises(InputError, match="no photo of the right camera"):
        StereoBracket("rig", bracket.left, ())


def test_a_scene_is_made_of_a_rectified_bracket_only():
    raw = small_bracket(rectified=False)
    with pytest.raises(InputError, match="rig: the two views are not rectified"):
        bracket_scene(raw, main="right", exposures=(4.0, 1.0), max_disparity=3)
    scene = bracket_scene(replace(raw, rectified=True), main="right", exposures=(4.0, 1.0), max_disparity=3)
    assert scene.pair.main == "right"
    assert scene.pair.exposures == (4.0, 1.0)
    truth = raw.right[0].codes / 128
    np.testing.assert_allclose(scene.reference, truth, rtol=0.2)
    assert scene.response is raw.response
