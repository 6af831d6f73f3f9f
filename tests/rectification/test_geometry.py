import numpy as np
import pytest
from stereo_rigs import HEIGHT, WIDTH, camera, degrees, rig

from stereohdr.errors import InputError
from stereohdr.rectification import StereoCalibration
from stereohdr.rectification.geometry import (
    _largest_rectangle,
    check_pose,
    rectification_of,
    rectifying_rotations,
    rotation_angle,
    vergence_degrees,
)

SIZES = ((WIDTH, HEIGHT), (WIDTH, HEIGHT))


def seen(calibration, points):
    """Pixels of both cameras at which points ``(N, 3)`` of the left camera's frame fall."""
    moved = points @ calibration.rotation.T + calibration.translation
    return (
        calibration.left.to_pixels(points[:, :2] / points[:, 2:]),
        calibration.right.to_pixels(moved[:, :2] / moved[:, 2:]),
    )


def scene_points(n=200, seed=0):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1.0, 5.0, n)
    return np.stack([*(rng.uniform(-0.3, 0.3, (2, n)) * depth), depth], axis=1)


LENSES = {
    "none": (camera(), camera()),
    "two kinds": (camera(380, (-0.25, 0.05, 0.001, 0)), camera(350, (0.02, 0.01), "fisheye")),
}


@pytest.mark.parametrize("cameras", LENSES.values(), ids=LENSES)
@pytest.mark.parametrize("main", ["left", "right"])
def test_rows_agree_and_disparity_tells_depth(cameras, main):
    calibration = rig((1, 3, -2), (-2, -2, 1.5), cameras)
    found = rectification_of(calibration, SIZES, main=main, disparity_offset=7)
    points = scene_points()
    left, right = seen(calibration, points)
    at_left, at_right = found.left.from_photo(left), found.right.from_photo(right)
    np.testing.assert_allclose(at_left[:, 1], at_right[:, 1], atol=1e-6)
    depth = (points @ rectifying_rotations(calibration)[0].T)[:, 2]
    np.testing.assert_allclose(at_left[:, 0] - at_right[:, 0], found.focal * 0.1 / depth - 7, atol=1e-6)
    assert found.focal == (calibration.left if main == "left" else calibration.right).focal
    np.testing.assert_allclose(found.left.to_photo(at_left), left, atol=1e-6)


def test_both_photos_cover_the_crop_and_it_cannot_grow():
    found = rectification_of(rig((1, 3, -2), (-2, -2, 1.5), LENSES["two kinds"]), SIZES)
    width, height = found.size
    x, y = np.meshgrid(np.arange(-1.0, width + 1), np.arange(-1.0, height + 1))
    covered = found.left.covers(np.stack([x, y], axis=-1)) & found.right.covers(np.stack([x, y], axis=-1))
    assert covered[1:-1, 1:-1].all()
    for side in (covered[0, 1:-1], covered[-1, 1:-1], covered[1:-1, 0], covered[1:-1, -1]):
        assert not side.all()


def test_without_crop_all_that_either_covers_is_there():
    calibration = rig((1, 3, -2), (-2, -2, 1.5))
    whole = rectification_of(calibration, SIZES, crop=False)
    corners = np.array([[0, 0], [WIDTH - 1, 0], [0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1]], dtype=float)
    for view in (whole.left, whole.right):
        at = view.from_photo(corners)
        assert (at > -1).all()
        assert (at < np.array(whole.size)).all()


def test_a_parallel_rig_stays_as_it_is():
    found = rectification_of(rig(), SIZES)
    assert found.size == (WIDTH, HEIGHT)
    pixels = np.array([[0.0, 0.0], [17, 200], [WIDTH - 1, HEIGHT - 1]])
    for view in (found.left, found.right):
        np.testing.assert_allclose(view.to_photo(pixels), pixels, atol=1e-9)


def test_an_offset_moves_the_right_view_by_whole_pixels():
    found = rectification_of(rig(), SIZES, disparity_offset=12)
    assert found.size == (WIDTH - 12, HEIGHT)
    origin = np.zeros(2)
    np.testing.assert_allclose(found.left.to_photo(origin) - found.right.to_photo(origin), [12, 0], atol=1e-9)


def test_wide_lenses_do_not_make_huge_frames():
    wide = camera(120, (0.02, 0, 0, 0), "fisheye")
    for crop in (True, False):
        width, height = rectification_of(rig(cameras=(wide, wide)), SIZES, crop=crop).size
        assert WIDTH <= width <= 2 * WIDTH + 1
        assert HEIGHT <= height <= 2 * HEIGHT + 1


def test_each_view_is_turned_as_little_as_can_be():
    calibration = rig((0, 2, 0), (0, -2, 0))
    turns = [np.degrees(rotation_angle(rotation)) for rotation in rectifying_rotations(calibration)]
    np.testing.assert_allclose(turns, [2, 2], atol=1e-9)
    assert vergence_degrees(calibration) == pytest.approx(4)


def pose(rotation, baseline):
    baseline = np.asarray(baseline, dtype=float)
    return StereoCalibration(camera(), camera(), rotation, -rotation @ baseline)


@pytest.mark.parametrize(
    ("calibration", "words"),
    [
        (rig((0, 8, 0), (0, -8, 0)), "look 16 degrees apart"),
        (pose(np.eye(3), [0, 0.1, 0]), "above the other"),
        (pose(np.eye(3), [0.01, -0.1, 0]), "above the other"),
        (pose(np.eye(3), [-0.1, 0, 0]), "to the left of the left one"),
        (pose(np.eye(3), [0, 0, 0.1]), "turned by 90 degrees"),
        (pose(np.eye(3), [0.1, 0, 0.1]), "turned by 45 degrees"),
        (pose(degrees(0, 0, 90), [0.1, 0, 0]), "turned by 90 degrees"),
    ],
)
def test_rigs_that_are_no_stereo_pair(calibration, words):
    with pytest.raises(InputError, match=words):
        check_pose(calibration)


def test_fifteen_degrees_are_just_accepted():
    check_pose(rig((0, 7.45, 0), (0, -7.45, 0)))


def test_views_without_a_common_part():
    with pytest.raises(InputError, match="hardly a pixel in common"):
        rectification_of(rig(), SIZES, disparity_offset=WIDTH - 5)


def test_poses_that_are_none():
    one = camera()
    with pytest.raises(InputError, match="both a rotation and a translation"):
        StereoCalibration(one, one, np.eye(3))
    with pytest.raises(InputError, match="not a rotation"):
        StereoCalibration(one, one, 2 * np.eye(3), [-0.1, 0, 0])  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="not a rotation"):
        StereoCalibration(one, one, np.diag([1.0, 1, -1]), [-0.1, 0, 0])  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="not all 0"):
        StereoCalibration(one, one, np.eye(3), [0, 0, 0])  # pyright: ignore[reportArgumentType]


def test_exchanging_twice_changes_nothing():
    calibration = rig((1, 2, 0), (0, -1, 1), LENSES["two kinds"])
    other = calibration.exchanged()
    assert other.left is calibration.right
    assert other.baseline[0] < 0
    again = other.exchanged()
    np.testing.assert_allclose(again.rotation, calibration.rotation)
    np.testing.assert_allclose(again.translation, calibration.translation)


@pytest.mark.parametrize("seed", range(20))
def test_largest_rectangle_against_all_rectangles(seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((7, 9)) < rng.uniform(0.5, 0.95)
    columns, rows = np.cumsum(rng.integers(1, 4, 9)), np.cumsum(rng.integers(1, 4, 7))

    def area(x0, y0, x1, y1):
        return (x1 - x0 + 1) * (y1 - y0 + 1)

    every = [
        area(columns[x0], rows[y0], columns[x1], rows[y1])
        for y0 in range(7)
        for y1 in range(y0, 7)
        for x0 in range(9)
        for x1 in range(x0, 9)
        if mask[y0 : y1 + 1, x0 : x1 + 1].all()
    ]
    found = _largest_rectangle(mask, columns, rows)
    assert found is not None
    assert area(*found) == max(every)
    x0, y0, x1, y1 = found
    inside = np.ix_((rows >= y0) & (rows <= y1), (columns >= x0) & (columns <= x1))
    assert mask[inside].all()


def test_no_rectangle_in_nothing():
    assert _largest_rectangle(np.zeros((3, 4), bool), np.arange(4), np.arange(3)) is None
