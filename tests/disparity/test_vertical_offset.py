import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr.disparity.vertical_offset import level_rows, level_strip, rows_behind, vertical_offset


def texture(seed, height, width):
    rng = np.random.default_rng(seed)
    return np.exp(ndimage.gaussian_filter(rng.normal(size=(height, width)), 1.2) * 3)


def shifted_views(rows, columns, *, height=60, width=90, seed=0):
    """Return two views; what the main view sees at (y, x) is at (y + rows, x - columns) in the auxiliary one."""
    scene = texture(seed, height + 40, width + 40)
    y, x = np.mgrid[20 : 20 + height, 20 : 20 + width].astype(float)
    main = ndimage.map_coordinates(scene, [y, x], order=3)
    auxiliary = ndimage.map_coordinates(scene, [y - rows, x + columns], order=3)
    return (np.maximum(view, 1e-3).astype(np.float32) for view in (main, auxiliary))


def grid_points(height=60, width=90, step=3):
    return np.stack(np.mgrid[0:height:step, 0:width:step], axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("rows", [0.0, 0.5, -0.5, 1.0, -1.0, 1.4, 2.0, -2.0])
def test_a_known_offset_is_measured_at_any_exposure(rows):
    main, auxiliary = shifted_views(rows, 6)
    points = grid_points()
    found = vertical_offset(main, 20 * auxiliary**1.2, points, np.full(len(points), 6.0), uncertainty=1)
    assert found == pytest.approx(rows, abs=0.06)


@pytest.mark.parametrize("wrong", [0, 2, -2])
def test_disparities_may_be_wrong_by_the_uncertainty(wrong):
    main, auxiliary = shifted_views(1.0, 6)
    points = grid_points()
    disparities = np.full(len(points), 6.0 + wrong)
    assert vertical_offset(main, auxiliary, points, disparities, uncertainty=2) == pytest.approx(1, abs=0.06)
    if wrong:
        found = vertical_offset(main, auxiliary, points, disparities, uncertainty=0)
        assert abs(found - 1) > 0.06


def test_places_that_disagree_are_outvoted():
    main, auxiliary = shifted_views(1.0, 6)
    other = next(shifted_views(0.0, 0, seed=5))
    auxiliary[:, :35] = other[:, :35]
    points = grid_points()
    found = vertical_offset(main, auxiliary, points, np.full(len(points), 6.0), uncertainty=1)
    assert found == pytest.approx(1, abs=0.06)


def test_places_that_match_badly_do_not_count():
    """Most places show something else in the auxiliary view."""
    main, auxiliary = shifted_views(1.0, 0)
    auxiliary[:, :72] = next(shifted_views(0.0, 0, seed=5))[:, :72]
    points = grid_points(step=2)
    found = vertical_offset(main, auxiliary, points, np.zeros(len(points)), uncertainty=0)
    assert found == pytest.approx(1, abs=0.06)


def test_places_with_the_strongest_vertical_structure_are_looked_at():
    main, auxiliary = shifted_views(1.0, 0, height=80)
    level = next(shifted_views(0.0, 0, height=80, seed=3))
    main[:, :50], auxiliary[:, :50] = level[:, :50] ** 0.2, level[:, :50] ** 0.2  # weak, and not shifted
    points = grid_points(80, step=1)
    found = vertical_offset(main, auxiliary, points, np.zeros(len(points)), uncertainty=0)
    assert found == pytest.approx(1, abs=0.06)


def test_without_a_majority_there_is_no_answer():
    """Three layers: the median is the offset of a third of the places, as it would be of chance matches."""
    main = next(shifted_views(0.0, 0))
    layers = [list(shifted_views(rows, 0))[1] for rows in (-2.0, 0.8, 2.0)]
    auxiliary = np.concatenate([layer[:, 30 * n : 30 * n + 30] for n, layer in enumerate(layers)], axis=1)
    points = grid_points()
    disparities = np.zeros(len(points))
    assert vertical_offset(main, auxiliary, points, disparities, uncertainty=0) == 0
    points = points[(points[:, 1] > 20) & (points[:, 1] < 70)]  # now the middle layer has the majority
    found = vertical_offset(main, auxiliary, points, np.zeros(len(points)), uncertainty=0)
    assert found == pytest.approx(0.8, abs=0.06)


def test_unrelated_views_say_nothing():
    main, _ = shifted_views(0.0, 0, seed=1)
    other, _ = shifted_views(0.0, 0, seed=2)
    points = grid_points(step=1)
    assert vertical_offset(main, other, points, np.full(len(points), 6.0), uncertainty=3) == 0


def test_an_offset_beyond_reach_is_not_taken_for_the_end_of_the_reach():
    main, auxiliary = shifted_views(3.0, 6)
    points = grid_points()
    assert vertical_offset(main, auxiliary, points, np.full(len(points), 6.0), uncertainty=1) == 0


def test_fewer_than_40_clear_places_say_nothing():
    main, auxiliary = shifted_views(1.0, 6)
    points = np.argwhere(np.ones((40, 60), bool))[::40] + np.array([10, 20])
    disparities = np.full(len(points), 6.0)
    assert vertical_offset(main, auxiliary, points, disparities, uncertainty=1) == pytest.approx(1, abs=0.06)
    few = slice(0, 39)
    assert vertical_offset(main, auxiliary, points[few], disparities[few], uncertainty=1) == 0


def test_vertical_edges_alone_say_nothing_about_rows():
    main = np.tile(texture(3, 1, 90), (60, 1)).astype(np.float32)
    points = grid_points()
    assert vertical_offset(main, main, points, np.zeros(len(points)), uncertainty=1) == pytest.approx(0, abs=1e-6)
    flat = np.full((60, 90), 2.0, np.float32)
    assert vertical_offset(flat, flat, points, np.zeros(len(points)), uncertainty=1) == 0


@given(
    height=st.integers(1, 20),
    width=st.integers(1, 20),
    uncertainty=st.integers(0, 12),
    disparity=st.floats(-30, 30),
)
def test_small_images_and_far_partners_are_no_trouble(height, width, uncertainty, disparity):
    view = texture(1, height, width).astype(np.float32)
    points = grid_points(height, width, 1)
    found = vertical_offset(view, view, points, np.full(len(points), disparity), uncertainty=uncertainty)
    assert np.isfinite(found)


def test_level_rows_by_hand():
    image = np.float32([[0, 0], [10, 100], [20, 200], [40, 0]])
    np.testing.assert_allclose(level_rows(image, 0.25), [[2.5, 25], [12.5, 125], [25, 150], [40, 0]])
    np.testing.assert_allclose(level_rows(image, -1.0), [[0, 0], [0, 0], [10, 100], [20, 200]])
    np.testing.assert_allclose(level_rows(image, 9.0), [[40, 0]] * 4)
    assert level_rows(image, 0.0) is image
    colour = np.stack([image, 2 * image], axis=2)
    np.testing.assert_array_equal(level_rows(colour, 0.25)[..., 1], 2 * level_rows(image, 0.25))
    assert level_rows(image, 0.3).dtype == np.float32


@pytest.mark.parametrize("offset", [0.0, 0.25, -0.4, 1.0, -2.6, 40.0, -40.0])
def test_rows_are_levelled_strip_by_strip(offset):
    image = np.random.default_rng(0).random((30, 4), dtype=np.float32)
    expected = level_rows(image, offset)
    for strip in ((0, 30), (0, 7), (7, 8), (23, 30)):
        first, stop = rows_behind(strip, offset, 30)
        assert 0 <= first < stop <= 30
        assert stop - first <= strip[1] - strip[0] + 1
        part = level_strip(image[first:stop], offset, strip, 30)
        np.testing.assert_array_equal(part, expected[slice(*strip)])


def test_tall_images_are_levelled_without_seams():
    image = np.arange(200, dtype=np.float32)[:, None]  # more rows than a strip
    np.testing.assert_allclose(level_rows(image, 0.25)[:-1, 0], np.arange(199) + 0.25)


def test_levelling_by_the_measured_offset_brings_the_rows_together():
    main, auxiliary = shifted_views(1.0, 0)
    points = grid_points()
    offset = vertical_offset(main, auxiliary, points, np.zeros(len(points)), uncertainty=1)
    levelled = level_rows(auxiliary, offset)
    assert np.median(np.abs(np.log(levelled / main))) < 0.1 * np.median(np.abs(np.log(auxiliary / main)))
