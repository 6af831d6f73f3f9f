import math

import numpy as np
import pytest

from stereohdr.errors import InputError
from stereohdr.model import DisparityFlag
from stereohdr.simulation.scenes import SCENES, poles, room, slanted_plane


@pytest.fixture(scope="module")
def small_room():
    return room(200, 150)


@pytest.fixture(scope="module")
def default_poles():
    return poles()


def luminance(radiance):
    return radiance @ np.array([0.2126, 0.7152, 0.0722], np.float32)


def sample_row(image, x):
    """Linear interpolation of each row at columns x (H, W), clamped to the frame."""
    image = image.reshape(*image.shape[:2], -1)
    left = np.clip(np.floor(x).astype(int), 0, image.shape[1] - 2)
    share = np.clip(x - left, 0, 1)[..., None]
    rows = np.arange(image.shape[0])[:, None]
    return (image[rows, left] * (1 - share) + image[rows, left + 1] * share).squeeze()


def both_ways(scene):
    """(own radiance, other's radiance, own disparity, other's disparity, sign of the shift) per view."""
    yield scene.radiance_left, scene.radiance_right, scene.disparity_left, scene.disparity_right, -1
    yield scene.radiance_right, scene.radiance_left, scene.disparity_right, scene.disparity_left, 1


def columns_there(disparity, sign, shift=0.0):
    return np.arange(disparity.values.shape[1]) + sign * (disparity.values.astype(np.float64) + shift)


# -------------------------------------------------------------------------------------------------- scenes


@pytest.mark.parametrize("name", sorted(SCENES))
@pytest.mark.parametrize(("width", "height"), [(16, 12), (33, 12), (12, 40), (1, 1)])
def test_any_size_gives_a_whole_scene(name, width, height):
    scene = SCENES[name](width, height, supersampling=1)
    assert scene.name == name
    for radiance in (scene.radiance_left, scene.radiance_right):
        assert radiance.shape == (height, width, 3)
        assert radiance.dtype == np.float32
        assert np.isfinite(radiance).all()
        assert (radiance > 0).all()
    largest = 0.0
    for disparity in (scene.disparity_left, scene.disparity_right):
        assert disparity.values.shape == disparity.flags.shape == (height, width)
        assert disparity.values.dtype == np.float32
        assert disparity.flags.dtype == np.uint8
        assert (disparity.values > 0).all()
        assert np.isin(disparity.flags, (DisparityFlag.MATCHED, DisparityFlag.OCCLUDED)).all()
        largest = max(largest, float(disparity.values.max()))
    assert scene.max_disparity == math.ceil(largest)


@pytest.mark.parametrize("name", ["room", "poles"])
def test_views_agree_where_both_see_the_point(name, small_room, default_poles):
    scene = {"room": small_room, "poles": default_poles}[name]
    for own, other, disparity, _, sign in both_ways(scene):
        seen = disparity.flags == DisparityFlag.MATCHED

        def error(shift, own=own, other=other, disparity=disparity, sign=sign, seen=seen):
            there = sample_row(np.log(other), columns_there(disparity, sign, shift))
            return np.abs(there - np.log(own)).max(axis=2)[seen]

        exact, shifted = error(0.0), error(0.5)
        assert np.median(exact) < 0.01
        assert np.percentile(exact, 80) < 0.06  # the rest are edges of texture, shadow and depth
        assert np.mean(exact) < 0.7 * np.mean(shifted)  # half a pixel would be noticed


@pytest.mark.parametrize("name", ["room", "poles"])
def test_disparities_of_the_views_agree(name, small_room, default_poles):
    scene = {"room": small_room, "poles": default_poles}[name]
    for _, _, disparity, other, sign in both_ways(scene):
        there = columns_there(disparity, sign)
        back = sample_row(other.values, there)
        left = np.clip(np.floor(there).astype(int), 0, there.shape[1] - 2)
        rows = np.arange(there.shape[0])[:, None]
        at_edge = np.abs(other.values[rows, left] - other.values[rows, left + 1]) > 0.4
        compared = (disparity.flags == DisparityFlag.MATCHED) & ~at_edge
        assert compared.mean() > 0.6
        difference = np.abs(back - disparity.values)[compared]
        assert (difference < 0.02).mean() > 0.97
        assert (difference < 0.5).mean() > 0.99  # all but things thinner than a pixel of this small image


@pytest.mark.parametrize("name", ["room", "poles"])
def test_occlusion_agrees_with_a_z_buffer(name, small_room, default_poles):
    # Independent of ray casting: the other view's own disparity map is its z-buffer. A point is hidden if that
    # map is nearer on both sides of the place where the point falls, and seen if it is as far on both sides.
    scene = {"room": small_room, "poles": default_poles}[name]
    for _, _, disparity, other, sign in both_ways(scene):
        there = columns_there(disparity, sign)
        width = there.shape[1]
        outside = (there < -0.5) | (there > width - 0.5)
        hidden_flag = disparity.flags == DisparityFlag.OCCLUDED
        assert hidden_flag[outside].all()
        assert outside.any()

        inside = (there >= 0) & (there <= width - 1)
        left = np.clip(np.floor(there).astype(int), 0, width - 2)
        rows = np.arange(there.shape[0])[:, None]
        neighbours = np.stack([other.values[rows, left], other.values[rows, left + 1]])
        hidden = inside & (neighbours > disparity.values + 0.75).all(axis=0)
        seen = inside & (np.abs(neighbours - disparity.values) < 0.25).all(axis=0)
        assert hidden.mean() > 0.01
        assert (hidden | seen | outside).mean() > 0.8
        assert hidden_flag[hidden].mean() > 0.99
        # objects thinner than the pixel grid of the z-buffer hide a few points that it believes to be seen
        assert (~hidden_flag[seen]).mean() > 0.99


def test_room_has_the_dynamic_range_of_a_room(small_room):
    for radiance in (small_room.radiance_left, small_room.radiance_right):
        assert np.log10(radiance.max() / radiance.min()) >= 5
        light = luminance(radiance)
        median = np.median(light)
        assert (light < median / 100).mean() >= 0.02
        assert (light > median * 10**1.5).mean() >= 0.01


def test_room_has_the_depths_that_it_promises(small_room):
    scale = 480 / 200
    assert 60 <= small_room.disparity_left.values.max() * scale <= 80
    # the wallpaper between window and picture
    assert 10 <= small_room.disparity_left.values[30, 103] * scale <= 15


def test_every_size_shows_the_same_composition():
    small, large = room(60, 45, supersampling=1), room(120, 90, supersampling=1)
    halves = large.disparity_left.values.reshape(45, 2, 60, 2) / 2
    # the small pixel's centre is where four large pixels meet: between their smallest and largest disparity
    low, high = halves.min(axis=(1, 3)), halves.max(axis=(1, 3))
    values = small.disparity_left.values
    assert ((values > low - 0.02) & (values < high + 0.02)).mean() > 0.985


def test_a_wider_image_shows_more_at_the_sides():
    normal, wide = room(64, 48, supersampling=1), room(96, 48, supersampling=1)
    # odd baselines of both grids: 16 more columns on either side, the middle is the same picture
    np.testing.assert_array_equal(wide.disparity_left.values[:, 16:-16], normal.disparity_left.values)


def test_thin_poles_are_two_or_three_pixels_wide(default_poles):
    width = default_poles.disparity_left.values.shape[1]
    for disparity in (default_poles.disparity_left, default_poles.disparity_right):
        values = disparity.values[120]
        wall = values < np.median(values) + 0.01
        starts = np.flatnonzero(np.diff(np.concatenate([[0], (~wall).astype(int)])) == 1)
        widths = [int(np.argmax(np.append(wall[s:], True))) for s in starts if s > 0]
        widths = [w for s, w in zip(starts, widths, strict=False) if s + w < width]
        assert len(widths) >= 5
        assert set(widths) <= {2, 3}


@pytest.mark.parametrize("name", sorted(SCENES))
def test_same_bytes_every_time(name):
    first, again = (SCENES[name](40, 30) for _ in range(2))
    for one, two in (
        (first.radiance_left, again.radiance_left),
        (first.radiance_right, again.radiance_right),
        (first.disparity_left.values, again.disparity_left.values),
        (first.disparity_right.flags, again.disparity_right.flags),
    ):
        assert one.tobytes() == two.tobytes()


@pytest.mark.parametrize("samples", [2, 3])
def test_radiance_is_the_mean_over_the_pixel(samples):
    # The samples within the pixels are the pixels of an image that is larger by as much.
    image = room(48, 36, supersampling=samples).radiance_right
    large = room(48 * samples, 36 * samples, supersampling=1).radiance_right
    mean = large.reshape(36, samples, 48, samples, 3).mean(axis=(1, 3))
    difference = np.abs(np.log(image / mean))
    assert (difference < 1e-5).mean() > 0.2  # plain surfaces: ceiling, wall, lamp, window bars
    assert np.median(difference) < 0.03  # the others fade their textures with the size of a pixel
    one_sample = np.abs(np.log(image / room(48, 36, supersampling=1).radiance_right))
    assert np.percentile(difference, 95) < 0.5 * np.percentile(one_sample, 95)


def test_a_single_sample_sees_what_the_disparity_sees():
    # The upper panes of the window: sky (12 or brighter) at the depth of the backdrop, or dark bars and frame.
    scene = room(240, 180, supersampling=1)
    panes = np.s_[34:42, 60:122]
    for radiance, disparity, *_ in (
        (scene.radiance_left, scene.disparity_left),
        (scene.radiance_right, scene.disparity_right),
    ):
        sky = disparity.values[panes] < 2
        assert 0.3 < sky.mean() < 0.95
        np.testing.assert_array_equal(luminance(radiance[panes]) > 5, sky)


@pytest.mark.parametrize("axis", [0, 1])
def test_samples_are_centred_in_the_pixel(axis):
    # Fit E_n - E_1 = shift dE/dx: however many samples, their mean must not move the image.
    one = slanted_plane(96, 72, supersampling=1).radiance_left.astype(np.float64)
    slope = np.gradient(one, axis=axis)
    for samples in (2, 3, 4):
        change = slanted_plane(96, 72, supersampling=samples).radiance_left - one
        assert abs((change * slope).sum() / (slope**2).sum()) < 0.03  # pixels


@pytest.mark.parametrize("gradient", [(0.04, 0.02), (-0.07, 0.0), (0.0, 0.0), (0.3, -0.1)])
def test_slanted_plane_has_its_closed_form(gradient):
    width, height, middle = 60, 44, 14.037
    scene = slanted_plane(width, height, disparity=middle, gradient=gradient)
    x = np.arange(width) - (width - 1) / 2
    y = (np.arange(height) - (height - 1) / 2)[:, None]
    left = middle + gradient[0] * x + gradient[1] * y
    right = left / (1 - gradient[0])
    np.testing.assert_allclose(scene.disparity_left.values, left, rtol=1e-6)
    np.testing.assert_allclose(scene.disparity_right.values, right, rtol=1e-6)
    # nothing hides a plane: only the frame does
    column = np.arange(width)
    np.testing.assert_array_equal(scene.disparity_left.flags == DisparityFlag.OCCLUDED, column - left < -0.5)
    np.testing.assert_array_equal(
        scene.disparity_right.flags == DisparityFlag.OCCLUDED, column + right >= width - 0.5
    )


def test_slanted_plane_is_smooth_enough_to_warp():
    scene = slanted_plane(160, 120)
    inside = columns_there(scene.disparity_left, -1) >= 0
    warped = sample_row(np.log(scene.radiance_right), columns_there(scene.disparity_left, -1))
    error = np.abs(warped - np.log(scene.radiance_left)).max(axis=2)[inside]
    assert np.percentile(error, 95) < 0.1
    assert np.log10(scene.radiance_left.max() / scene.radiance_left.min()) > 1.5


# ------------------------------------------------------------------------------------------- bad arguments


@pytest.mark.parametrize("name", sorted(SCENES))
@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"width": 0}, "at least 1x1"),
        ({"height": -3}, "at least 1x1"),
        ({"width": 20.5}, "whole numbers"),
        ({"baseline": 0.0}, "baseline"),
        ({"baseline": float("nan")}, "baseline"),
        ({"baseline": 0.6}, "baseline"),
        ({"supersampling": 0}, "supersampling"),
        ({"supersampling": 9}, "supersampling"),
    ],
)
def test_bad_arguments_are_refused(name, arguments, match):
    with pytest.raises(InputError, match=match):
        SCENES[name](**arguments)


@pytest.mark.parametrize(
    "arguments",
    [{"disparity": 0.0}, {"disparity": 5.0, "gradient": (0.1, 0.0)}, {"gradient": (float("nan"), 0.0)}],
)
def test_a_plane_behind_the_camera_is_refused(arguments):
    with pytest.raises(InputError, match="positive in both views"):
        slanted_plane(160, 120, **arguments)
