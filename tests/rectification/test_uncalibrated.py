import numpy as np
import pytest
from stereo_rigs import HEIGHT, WIDTH, camera, rig

from stereohdr.errors import InputError
from stereohdr.rectification.features import Matches
from stereohdr.rectification.uncalibrated import differences, epipolar_inliers, epipole_in_picture, estimate_rig

pytest.importorskip("cv2")

SIZES = ((WIDTH, HEIGHT), (WIDTH, HEIGHT))


def matches_of(calibration, n=900, noise=0.2, wrong=0.15, seed=0):
    """Where both cameras see random points, with noise in pixels and a share of wrong matches."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform((0, 0), (WIDTH, HEIGHT), (n, 2))
    rays = calibration.left.to_rays(pixels)
    depth = rng.uniform(1.2, 6.0, (n, 1))
    points = np.concatenate([rays, np.ones((n, 1))], axis=1) * depth
    moved = points @ calibration.rotation.T + calibration.translation
    right = calibration.right.to_pixels(moved[:, :2] / moved[:, 2:])
    right += rng.normal(0, noise, right.shape)
    lost = rng.random(n) < wrong
    right[lost] = rng.uniform((0, 0), (WIDTH, HEIGHT), (lost.sum(), 2))
    ok = np.isfinite(right).all(axis=1) & (right >= 0).all(axis=1) & (right < (WIDTH, HEIGHT)).all(axis=1)
    return Matches(pixels[ok], right[ok])


def exact(calibration):
    return matches_of(calibration, noise=0, wrong=0, seed=5)


def rows_left(found, truth):
    """Vertical differences in pixels of exact matches, all over the picture, after the rectification found."""
    return np.abs(differences(found.calibration, exact(truth), focal=found.calibration.left.focal)[:, 1])


TURNED = {"left": (0.5, 1.5, -1.0), "right": (-1.0, -1.0, 1.5)}
WIDE = camera(232.0, (-0.22, 0.065))
RIGS = {
    "turned": (rig(**TURNED), "pose and lens"),
    "typical lens": (rig(**TURNED, cameras=(camera(1.2 * WIDTH),) * 2), "pose"),
    "wide and bent": (rig(**TURNED, cameras=(WIDE, WIDE)), "pose and lens"),
    "two lenses": (rig(**TURNED, cameras=(camera(340), camera(520))), "pose, lens and zoom"),
    "parallel": (rig(), "as it is"),
    "toed in": (rig((0, 5, 0), (0, -5, 0)), "pose"),
}


@pytest.mark.parametrize("name", RIGS)
def test_rows_agree_again(name):
    truth, model = RIGS[name]
    found = estimate_rig(matches_of(truth), SIZES)
    assert found.model == model
    rows = rows_left(found, truth)
    assert np.median(rows) < 0.15
    assert np.percentile(rows, 98) < 0.4
    assert len(found.matches) > 250


def test_known_lenses_leave_only_the_pose():
    truth = rig(**TURNED, cameras=(WIDE, camera(340)))
    found = estimate_rig(matches_of(truth), SIZES, lenses=(truth.left, truth.right))
    assert (found.model, found.calibration.left) == ("pose", truth.left)
    assert np.percentile(rows_left(found, truth), 98) < 0.2
    disparity = differences(found.calibration, exact(truth), focal=232.0)[:, 0]
    expected = differences(truth, exact(truth), focal=232.0)[:, 0]
    # What vertical differences tell of vergence is little, but the estimate knows how little.
    assert abs(np.median(disparity - expected)) < 4 * found.infinity_deviation
    assert np.std(disparity - expected) < 0.5


def test_half_of_the_matches_may_be_wrong():
    truth, _ = RIGS["turned"]
    found = estimate_rig(matches_of(truth, wrong=0.5, n=1200), SIZES)
    assert np.percentile(rows_left(found, truth), 98) < 0.5


def test_the_same_matches_give_the_same_rig():
    matches = matches_of(RIGS["typical lens"][0], n=300)
    one, other = (estimate_rig(matches, SIZES).calibration for _ in range(2))
    assert one.rotation is not None
    assert one.rotation.tobytes() == other.rotation.tobytes()
    assert one.left.distortion == other.left.distortion


def test_wrong_matches_are_thrown_out():
    truth, _ = RIGS["turned"]
    matches = matches_of(truth, wrong=0.3)
    rows = np.abs(differences(truth, matches, focal=360.0)[:, 1])
    kept = epipolar_inliers(matches, SIZES)
    assert kept[rows < 1].mean() > 0.98
    assert kept[rows > 20].mean() < 0.1


@pytest.mark.parametrize("count", [0, 5, 30])
def test_too_few_matches(count):
    matches = matches_of(RIGS["turned"][0], wrong=0)[np.arange(count)]
    with pytest.raises(InputError, match="points of the two photos match, at least 40"):
        estimate_rig(matches, SIZES)


def test_chance_is_no_match():
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="points of the two photos match"):
        estimate_rig(Matches(*rng.uniform(0, 270, (2, 90, 2))), SIZES)


def test_the_same_picture_twice():
    points = np.random.default_rng(0).uniform(0, 350, (200, 2))
    noise = np.random.default_rng(1).normal(0, 0.05, points.shape)
    with pytest.raises(InputError, match="same picture from the same place"):
        estimate_rig(Matches(points, points + noise), SIZES)


def test_where_epipolar_lines_meet():
    ahead = rig()
    forward = type(ahead)(ahead.left, ahead.right, np.eye(3), np.array([0.02, 0, -0.4]))
    assert epipole_in_picture(exact(forward), SIZES)
    assert not epipole_in_picture(exact(RIGS["turned"][0]), SIZES)
    assert not epipole_in_picture(exact(forward)[np.arange(5)], SIZES)
