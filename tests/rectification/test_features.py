import sys

import numpy as np
import pytest
from stereo_rigs import World, camera, photo

from stereohdr import Photo
from stereohdr.errors import MissingDependencyError
from stereohdr.rectification import features
from stereohdr.rectification.features import match_features, normalised_view

pytest.importorskip("cv2")


def test_the_normalised_view_does_not_depend_on_the_exposure(world: World):
    radiance = world.seen("left", camera())
    # The darker exposure clips nothing, the brighter one clips a quarter.
    dark, bright = (photo(radiance, time, bits=12) for time in (0.03, 0.48))
    seen = [normalised_view(view).astype(float) for view in (dark, bright)]
    both = (bright.codes[..., 0] < 4000) & (dark.codes[..., 0] > 40)
    assert both.mean() > 0.3
    assert np.corrcoef(seen[0][both], seen[1][both])[0, 1] > 0.95
    plain = dark.codes.astype(float).mean(axis=2) * (255 / 4095)
    assert seen[0][both].std() > 10 * plain[both].std()
    assert 0.5 < seen[0][both].std() / seen[1][both].std() < 2


def test_matches_across_sixteen_times_the_exposure(world: World):
    left = photo(world.radiance("left", *np.meshgrid(np.arange(300.0), np.arange(200.0))), 0.5, seed=1)
    right = photo(world.radiance("left", *np.meshgrid(np.arange(300.0) + 20, np.arange(200.0) - 7)), 0.03, seed=2)
    matches = match_features(left, right)
    assert len(matches) > 300
    shift = matches.left - matches.right
    good = np.abs(shift - [20, -7]).max(axis=1) < 1
    assert good.mean() > 0.97
    assert np.abs(np.median(shift, axis=0) - [20, -7]).max() < 0.02


def test_reduced_photos_give_positions_of_the_full_ones(world: World, monkeypatch):
    view = photo(world.seen("left", camera()), 0.1)
    monkeypatch.setattr(features, "LARGEST_PIXELS", view.height * view.width // 4)
    other = Photo(np.roll(view.codes, (4, 10), axis=(0, 1)))
    matches = match_features(view, other)
    inner = (matches.right > 20).all(axis=1)
    assert inner.sum() > 100
    assert np.abs(np.median((matches.right - matches.left)[inner], axis=0) - [10, 4]).max() < 0.05


def test_features_are_shared_out_over_the_picture(world: World, monkeypatch):
    monkeypatch.setattr(features, "MOST_FEATURES", 480)
    view = photo(world.seen("left", camera()), 0.1)
    at, descriptors = features._features(view)
    assert len(at) == len(descriptors) <= 480
    counts = np.histogram2d(at[:, 1], at[:, 0], bins=(6, 8), range=((0, view.height), (0, view.width)))[0]
    assert counts.min() >= 5


def test_nearest_neighbours_against_all_distances():
    rng = np.random.default_rng(0)
    of, among = rng.integers(0, 256, (2, 1500, 128)).astype(np.float32)[:, :1300]
    best, ratio = features._nearest(of, among)
    squares = ((of[:40, None].astype(np.float64) - among[None]) ** 2).sum(axis=2)
    order = np.sort(squares, axis=1)
    np.testing.assert_array_equal(best[:40], squares.argmin(axis=1))
    np.testing.assert_allclose(ratio[:40], np.sqrt(order[:, 0] / order[:, 1]), rtol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (40, 40)])
def test_pictures_without_features(shape):
    flat = Photo(np.full((*shape, 3), 90, np.uint8))
    assert len(match_features(flat, flat)) == 0


def test_a_missing_opencv_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    flat = Photo(np.full((40, 40), 90, np.uint8))
    with pytest.raises(MissingDependencyError, match=r"needs OpenCV; install stereohdr\[calib\]"):
        match_features(flat, flat)
