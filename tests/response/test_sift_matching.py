import sys
from dataclasses import replace

import numpy as np
import pytest

from stereohdr import Photo, StereoPair
from stereohdr.config import ResponseConfig
from stereohdr.errors import MissingDependencyError, ResponseError
from stereohdr.response import estimate_response, sift_sample_pairs
from stereohdr.simulation import Camera, expose_pair, room

from conftest import make_pair

SIFT = ResponseConfig(samples="sift")


@pytest.fixture(scope="module")
def pair():
    pytest.importorskip("skimage")
    scene = room(width=360, height=270)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    return expose_pair(scene.radiance_left / scale, scene.radiance_right / scale, (1.0, 0.25), Camera(), 3)


def test_samples_of_a_room_follow_the_camera(pair):
    samples = sift_sample_pairs(pair, max_disparity=60)
    for pairs in samples:
        assert len(pairs) >= 20
        assert pairs.min() >= 1
        assert pairs.max() <= 254
        assert (pairs[:, 0] >= pairs[:, 1]).mean() > 0.9  # the main view is exposed longer


def test_the_curve_is_near_the_cameras(pair):
    found = estimate_response(pair, config=SIFT, max_disparity=60).log_exposure
    by_histogram = estimate_response(pair).log_exposure
    codes = np.arange(30, 230)
    assert np.sqrt(((found - by_histogram)[:, codes] ** 2).mean()) < 0.4


def test_columns_follow_the_main_view(pair):
    swapped = StereoPair(pair.left, pair.right, main="right")
    for one, other in zip(sift_sample_pairs(pair), sift_sample_pairs(swapped), strict=True):
        np.testing.assert_array_equal(one, other[:, ::-1])


def test_only_plausible_disparities_count(pair):
    every = len(sift_sample_pairs(pair)[0])
    assert len(sift_sample_pairs(pair, max_disparity=3)[0]) < 0.7 * every
    exchanged = StereoPair(pair.right, pair.left)
    assert len(sift_sample_pairs(exchanged)[0]) < 0.3 * every


def test_16_bit_codes_give_the_samples_of_their_knots():
    pytest.importorskip("skimage")
    wall = make_pair(60, 90)
    deep = StereoPair(
        *(replace(p, codes=p.codes.astype(np.uint16) * 257, white_level=65535) for p in (wall.left, wall.right))
    )
    for one, other in zip(sift_sample_pairs(wall), sift_sample_pairs(deep), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (50, 1), (20, 20)])
def test_too_little_to_match_is_said(size):
    pytest.importorskip("skimage")
    rng = np.random.default_rng(0)
    flat = np.full((*size, 3), 90, np.uint8)
    photos = Photo(flat, 0.1), Photo(flat + rng.integers(0, 2, flat.shape).astype(np.uint8), 0.4)
    with pytest.raises(ResponseError, match="hardly any SIFT features match"):
        estimate_response(StereoPair(*photos), config=SIFT)


def test_a_channel_without_samples_takes_the_mean_of_the_others(pair):
    codes = [photo.codes.copy() for photo in (pair.left, pair.right)]
    for view in codes:
        view[..., 2] = 0
    dark = StereoPair(replace(pair.left, codes=codes[0]), replace(pair.right, codes=codes[1]))
    curve = estimate_response(dark, config=SIFT).log_exposure
    np.testing.assert_allclose(curve[2], curve[:2].mean(axis=0))


def test_a_missing_scikit_image_is_said(pair, monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage", None)
    with pytest.raises(MissingDependencyError, match=r"stereohdr\[demo\]"):
        estimate_response(pair, config=SIFT)
