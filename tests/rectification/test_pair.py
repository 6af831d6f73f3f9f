"""Whole pairs: photos of a known world at 16 times the exposure, by cameras that stand in a known way."""

from dataclasses import replace

import numpy as np
import pytest
from stereo_rigs import FOCAL, HEIGHT, WIDTH, World, camera, degrees, photo, photographed, rig

from stereohdr import Photo, StereoHdrWarning
from stereohdr.errors import InputError
from stereohdr.rectification import StereoCalibration, rectified_photos, rectify_pair

pytest.importorskip("cv2")

TURNED = {"left": (0.5, 1.5, -1.0), "right": (-1.0, -1.0, 1.5)}
WIDE = (camera(240.0, (-0.2,)), camera(240.0, (-0.2,)))


def true_partners(world, cameras, left=(0, 0, 0), right=(0, 0, 0)):
    """Pixels of both photos at which the same points of the world fall, all over the common part."""
    x, y = np.meshgrid(np.linspace(-60, WIDTH + 60, 50), np.linspace(-60, HEIGHT + 60, 40))
    at = []
    for model, angles, column in (
        (cameras[0], left, x + world.disparity(x, y)),
        (cameras[1], right, x),
    ):
        rays = np.stack(
            [(column - (WIDTH - 1) / 2) / FOCAL, (y - (HEIGHT - 1) / 2) / FOCAL, np.ones_like(x)], axis=-1
        )
        turned = rays @ degrees(*angles)
        at.append(model.to_pixels(turned[..., :2] / turned[..., 2:]).reshape(-1, 2))
    inside = np.all([(p >= 0).all(axis=1) & (p <= (WIDTH - 1, HEIGHT - 1)).all(axis=1) for p in at], axis=0)
    return at[0][inside], at[1][inside]


@pytest.fixture(scope="module")
def turned(world: World):
    photos = photographed(world, **TURNED, bits=12)
    return photos, rectify_pair(*photos)


def test_a_turned_pair_is_brought_onto_common_rows(world, turned):
    (left, _), found = turned
    geometry, report = found.rectification, found.rectification.report
    one, other = true_partners(world, (camera(), camera()), **TURNED)
    at_left, at_right = geometry.left.from_photo(one), geometry.right.from_photo(other)
    rows = np.abs(at_left[:, 1] - at_right[:, 1])
    assert np.median(rows) < 0.1
    assert rows.max() < 0.5
    disparity = at_left[:, 0] - at_right[:, 0]
    assert disparity.min() > 0
    assert report["disparity_min"] == pytest.approx(disparity.min(), abs=1.5)
    assert report["disparity_max"] == pytest.approx(disparity.max(), abs=1.5)
    assert disparity.max() < found.largest_disparity
    assert report["dy_median"] < 0.1
    assert report["dy_p95"] < 0.6
    assert report["held_out"] > 300
    assert report["inliers"] > 2 * report["held_out"]
    assert report["source"] == "pictures"
    assert report["size"] == list(geometry.size) == [found.left.width, found.left.height]
    assert (found.left.white, found.left.exposure_time) == (4095 * 16, left.exposure_time)
    assert found.valid_left.all()
    assert found.valid_right.all()


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_pixels_hold_what_the_world_has_there(world, turned, side):
    _, found = turned
    image = getattr(found, side)
    x, y = np.meshgrid(np.arange(5, image.width - 5, 7), np.arange(5, image.height - 5, 7))

    def error(shift):
        at = found.rectification.view(side).to_photo(np.stack([x + shift, y], axis=-1).astype(float))
        rays = camera().to_rays(at)
        own = np.concatenate([rays, np.ones((*x.shape, 1))], axis=-1) @ degrees(*TURNED[side]).T
        slopes = own[..., :2] / own[..., 2:]
        px, py = FOCAL * slopes[..., 0] + (WIDTH - 1) / 2, FOCAL * slopes[..., 1] + (HEIGHT - 1) / 2
        share = image.codes[y, x] / image.white
        usable = (share > 0.05).all(axis=-1) & (share < 0.9).all(axis=-1)
        assert usable.mean() > 0.2
        return np.log2(share[usable] / (world.radiance(side, px, py)[usable] * image.exposure_time))

    assert abs(np.median(error(0.0))) < 0.03
    assert np.median(np.abs(error(0.0))) < 0.08
    assert np.median(np.abs(error(0.5))) > 0.2  # half a pixel beside, all is different


def test_everything_is_repeated_byte_for_byte(turned):
    photos, found = turned
    again = rectify_pair(*photos)
    assert again.rectification.report == found.rectification.report
    assert again.left.codes.tobytes() == found.left.codes.tobytes()
    assert again.right.codes.tobytes() == found.right.codes.tobytes()


def test_other_photos_of_the_rig_are_rectified_the_same_way(turned):
    photos, found = turned
    again = rectified_photos(*photos, found.rectification)
    np.testing.assert_array_equal(again.left.codes, found.left.codes)
    smaller = replace(photos[0], codes=photos[0].codes[:-1])
    with pytest.raises(InputError, match=r"left.png: is 360x269, the rectification is for 360x270"):
        rectified_photos(smaller, photos[1], found.rectification)


def test_bent_lenses_are_straightened(world):
    found = rectify_pair(*photographed(world, **TURNED, cameras=WIDE))
    one, other = true_partners(world, WIDE, **TURNED)
    view = found.rectification
    rows = np.abs(view.left.from_photo(one)[:, 1] - view.right.from_photo(other)[:, 1])
    assert np.median(rows) < 0.15
    assert np.percentile(rows, 99) < 0.6
    assert view.report["model"] == "pose and lens"


def test_a_rectified_pair_stays_as_it_is(world):
    left, right = photographed(world)
    found = rectify_pair(left, right)
    assert found.rectification.report["model"] == "as it is"
    assert found.rectification.disparity_offset == 0
    np.testing.assert_array_equal(found.left.codes, left.codes.astype(np.uint16) * 256)
    np.testing.assert_array_equal(found.right.codes, right.codes.astype(np.uint16) * 256)


def test_negative_disparities_are_shifted(world):
    left, right = photographed(world)
    shifted = replace(right, codes=np.roll(right.codes, 20, axis=1)[:, 25:])  # 12 to 40 px become -3 to 25
    found = rectify_pair(replace(left, codes=left.codes[:, 25:]), shifted)
    report = found.rectification.report
    assert report["disparity_offset"] < -8
    assert report["disparity_min"] > 2
    # Fewer columns, but those that are left are the photos' own.
    codes = found.left.codes // 256
    start = WIDTH - 25 - found.left.width
    assert any(np.array_equal(codes, left.codes[:, 25 + x : 25 + x + codes.shape[1]]) for x in (0, start))


def test_calibration_alone_and_lenses_alone(world):
    truth = rig(**TURNED, cameras=WIDE)
    photos = photographed(world, **TURNED, cameras=WIDE)
    found = rectify_pair(*photos, calibration=truth)
    assert found.rectification.report["source"] == "calibration"
    assert found.rectification.report["dy_median"] < 0.15
    assert found.rectification.disparity_offset == 0
    one, other = true_partners(world, WIDE, **TURNED)
    view = found.rectification
    rows = view.left.from_photo(one)[:, 1] - view.right.from_photo(other)[:, 1]
    assert np.abs(rows).max() < 1e-6
    only_lenses = StereoCalibration(*WIDE)
    with pytest.raises(InputError, match="lenses of the cameras but not how they stand"):
        rectify_pair(*photos, calibration=only_lenses)
    found = rectify_pair(*photos, calibration=only_lenses, pose_from_pictures=True)
    assert found.rectification.report["source"] == "calibration and pictures"
    view = found.rectification
    rows = view.left.from_photo(one)[:, 1] - view.right.from_photo(other)[:, 1]
    assert np.abs(rows).max() < 0.3


def test_a_calibration_that_no_longer_fits_is_doubted(world):
    photos = photographed(world, left=(0.6, 0, 0))
    with pytest.warns(StereoHdrWarning, match=r"rows of the two views differ by .* px.*calibrate them again"):
        found = rectify_pair(*photos, calibration=rig())
    assert found.rectification.report["dy_median"] > 2


def test_without_crop_masks_say_where_nothing_is(world):
    found = rectify_pair(*photographed(world, **TURNED), calibration=rig(**TURNED), crop=False)
    assert found.left.width > WIDTH - 5
    for image, valid in ((found.left, found.valid_left), (found.right, found.valid_right)):
        assert 0.7 < valid.mean() < 1
        assert (image.codes[~valid] == 0).all()
        assert (image.codes[valid] > 0).mean() > 0.99


def test_either_main_view(world):
    cameras = (camera(), camera(470.0))
    photos = photographed(world, cameras=cameras)
    calibration = rig(cameras=cameras)
    for main, focal in (("left", 360.0), ("right", 470.0)):
        assert rectify_pair(*photos, main=main, calibration=calibration).rectification.focal == focal


def test_cameras_of_different_size(world):
    wide = camera(320.0, size=(320, 240))
    left, right = photographed(world, cameras=(camera(), wide))
    assert (right.width, right.height) == (320, 240)
    found = rectify_pair(left, right)
    assert found.rectification.report["dy_median"] < 0.15
    assert (found.left.width, found.left.height) == (found.right.width, found.right.height)


@pytest.mark.parametrize(
    ("calibration", "words"),
    [
        (rig(cameras=(camera(size=(640, 480)), camera())), "left.png: is 360x270, .* left camera is for 640x480"),
        (
            rig(cameras=(camera(), camera(size=(240, 180)))),
            "right.png: is 360x270, .* right camera is for 240x180",
        ),
        (
            rig(cameras=(replace(camera(centre=(960.0, 600.0)), size=None), camera())),
            r"left camera of the calibration has its centre at \(960, 600\)",
        ),
        (rig((0, 8, 0), (0, -8, 0)), "look 16 degrees apart"),
        (rig().exchanged(), "stands to the left of the left one"),
    ],
)
def test_calibrations_that_do_not_fit(calibration, words):
    black = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    with pytest.raises(InputError, match=words):
        rectify_pair(Photo(black, name="left.png"), Photo(black, name="right.png"), calibration=calibration)


def test_a_calibrated_pair_without_texture_is_rectified_unmeasured():
    grey = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    found = rectify_pair(Photo(grey), Photo(grey), calibration=rig((0.5, 0, 0)))
    assert found.rectification.report["dy_median"] is None
    assert found.rectification.report["disparity_max"] is None
    assert found.largest_disparity is None
    assert (found.left.codes == 90 * 256).all()


def test_views_more_than_15_degrees_apart(world):
    with pytest.raises(InputError, match=r"look (1[6-9]|2[0-9]) degrees apart"):
        rectify_pair(*photographed(world, left=(0, 10, 0), right=(0, -9, 0)))


def test_the_same_photo_twice(world):
    left, _ = photographed(world)
    with pytest.raises(InputError, match="same picture from the same place"):
        rectify_pair(left, left)


def test_exchanged_photos(world):
    left, right = photographed(world, times=(0.25, 0.25))
    with pytest.raises(InputError, match="look exchanged"):
        rectify_pair(right, left)
    left, right = photographed(world, **TURNED, times=(0.25, 0.25))
    with pytest.raises(InputError, match=r"look exchanged|to the left of the left one"):
        rectify_pair(right, left)


def test_photos_without_texture(world):
    left, _ = photographed(world)
    flat = Photo(np.full((HEIGHT, WIDTH, 3), 90, np.uint8), 1.0)
    with pytest.raises(InputError, match="only 0 points of the two photos match"):
        rectify_pair(left, flat)


def test_forward_motion(world):
    left = photo(world.seen("left", camera()), 0.5, seed=1)
    # The world moves away from a point inside of the picture, near points faster: a camera that moves ahead.
    x, y = np.meshgrid(np.arange(float(WIDTH)), np.arange(float(HEIGHT)))
    depth = world.disparity(x, y) / 25.0
    x, y = 190 + (x - 190) * (1 - 0.25 * depth), 130 + (y - 130) * (1 - 0.25 * depth)
    right = photo(world.radiance("left", x, y), 0.03, seed=2)
    with pytest.raises(InputError, match=r"stand before the other|stands before or above"):
        rectify_pair(left, right)


def test_one_camera_above_the_other(world):
    left = photo(world.seen("left", camera()), 0.5, seed=1)
    x, y = np.meshgrid(np.arange(float(WIDTH)), np.arange(float(HEIGHT)))
    right = photo(world.radiance("left", x, y + world.disparity(x, y)), 0.03, seed=2)
    with pytest.raises(InputError, match="above the other"):
        rectify_pair(left, right)


def test_different_channels(world):
    left, right = photographed(world)
    with pytest.raises(InputError, match="differ in channels"):
        rectify_pair(left, replace(right, codes=right.codes[..., :1]))
