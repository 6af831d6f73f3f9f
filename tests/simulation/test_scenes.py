import math

import numpy as np
import pytest

from stereohdr.errors import InputError
from stereohdr.model import DisparityFlag
from stereohdr.simulation import scenes
from stereohdr.simulation.scenes import (
    SCENES,
    Box,
    Caster,
    Cone,
    Ellipsoid,
    Plane,
    PointLight,
    Rectangle,
    SunBeam,
    poles,
    room,
    slanted_plane,
)


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


@pytest.mark.parametrize("name", ["room", "street_night"])
def test_culling_changes_nothing(name, monkeypatch):
    culled = SCENES[name](48, 36)
    everywhere = (-math.inf, math.inf, -math.inf, math.inf)
    monkeypatch.setattr(scenes, "_screen_bounds", lambda shape, eye: everywhere)
    unbounded = np.full((3, 1), np.inf)
    monkeypatch.setattr(Caster, "of", classmethod(lambda cls, shape: cls(shape, -unbounded, unbounded)))
    monkeypatch.setattr(scenes, "CHUNK", 1000)
    monkeypatch.setattr(scenes, "BLOCK", 7)
    plain = SCENES[name](48, 36)
    np.testing.assert_array_equal(culled.radiance_left, plain.radiance_left)
    np.testing.assert_array_equal(culled.radiance_right, plain.radiance_right)
    np.testing.assert_array_equal(culled.disparity_left.values, plain.disparity_left.values)
    np.testing.assert_array_equal(culled.disparity_right.flags, plain.disparity_right.flags)


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


# ------------------------------------------------------------------------------------- shapes and lights

SHAPES = {
    "box": (
        Box((0.2, -0.1, 4.0), (0.8, 1.0, 1.4), 30.0),
        lambda p: np.max(np.abs(turned(p - [0.2, -0.1, 4.0], 30.0)) - [0.4, 0.5, 0.7], axis=-1),
    ),
    "ellipsoid": (
        Ellipsoid((0.1, 0.2, 4.0), (0.5, 0.7, 0.9)),
        lambda p: np.linalg.norm((p - [0.1, 0.2, 4.0]) / [0.5, 0.7, 0.9], axis=-1) - 1,
    ),
    "cone": (
        Cone((-0.6, 0.5, 3.5), (0.5, -0.4, 4.5), 0.5, 0.2),
        lambda p: cone_side(p, np.array([-0.6, 0.5, 3.5]), np.array([0.5, -0.4, 4.5]), 0.5, 0.2),
    ),
}


def turned(p, degrees):
    """World to box: turning by +degrees carries the box's x axis towards -z."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.stack([c * p[..., 0] - s * p[..., 2], p[..., 1], s * p[..., 0] + c * p[..., 2]], axis=-1)


def cone_side(p, start, end, r0, r1):
    """Negative inside the truncated cone."""
    length = np.linalg.norm(end - start)
    axis = (end - start) / length
    h = (p - start) @ axis
    across = np.linalg.norm((p - start) - h[..., None] * axis, axis=-1)
    return np.maximum(across - (r0 + (r1 - r0) * h / length), np.abs(h - length / 2) - length / 2)


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_rays_hit_a_shape_where_marching_enters_it(name):
    shape, side = SHAPES[name]
    generator = np.random.default_rng(6)
    direction = np.concatenate([generator.uniform(-0.3, 0.3, (2, 400)), np.ones((1, 400))])
    t = shape.intersect(np.zeros((3, 1)), direction)
    steps = np.linspace(1.0, 7.0, 6001)
    inside = side(steps[:, None, None] * direction.T) < 0
    entered = np.where(inside.any(axis=0), steps[inside.argmax(axis=0)], np.inf)
    hit = np.isfinite(t)
    assert 0.1 < hit.mean() < 0.9
    assert (hit != np.isfinite(entered)).mean() < 0.01  # rays that graze between two steps
    both = hit & np.isfinite(entered)
    assert np.abs(t[both] - entered[both]).max() < 1.01e-3 * 3
    points = (t[both] * direction[:, both]).T
    assert np.abs(side(points)).max() < 1e-9
    # normals are unit vectors and point out of the shape
    normals = shape.normal(points.T).T
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-9)
    away = side(points + 1e-5 * normals) * side(points - 1e-5 * normals)
    assert (away < 0).mean() > 0.99  # one side in, one side out
    # and the corners hold the whole shape
    corners = shape.corners()
    assert corners is not None
    assert (points.min(axis=0) - corners.min(axis=1)).min() > -1e-9
    assert (corners.max(axis=1) - points.max(axis=0)).min() > -1e-9


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_rays_from_inside_hit_the_far_side(name):
    shape, side = SHAPES[name]
    start = np.array([[0.0], [0.0], [4.0]])
    assert side(start.T) < 0
    direction = np.random.default_rng(1).normal(size=(3, 50))
    t = shape.intersect(start, direction)
    assert np.isfinite(t).all()
    assert np.abs(side((start + t * direction).T)).max() < 1e-9


def test_flat_shapes_by_hand():
    ahead = np.array([[0.0, 0.45, 0.6, 0.0], [0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, -1.0]])
    start = np.zeros((3, 1))
    plane = Plane((0.0, 0.0, 2.0), 4.0)
    np.testing.assert_allclose(plane.intersect(start, ahead), [2, 2, 2, np.inf])
    sheet = Rectangle((-1.0, -1.0, 2.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    np.testing.assert_allclose(sheet.intersect(start, ahead), [2, 2, np.inf, np.inf])
    holed = Rectangle((-1.0, -1.0, 2.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), hole=(0.25, 0.25, 0.75, 0.75))
    np.testing.assert_allclose(holed.intersect(start, ahead), [np.inf, 2, np.inf, np.inf])
    sideways = np.array([[1.0], [0.0], [0.0]])  # parallel to both
    assert np.isinf(plane.intersect(start, sideways)).all()
    assert np.isinf(sheet.intersect(start, sideways)).all()


def test_open_cone_lets_a_ray_through_its_ends():
    start, along = np.array([[0.0], [0.05], [0.0]]), np.array([[0.0], [0.0], [1.0]])
    tube = Cone((0.0, 0.0, 1.0), (0.0, 0.0, 2.0), 0.1, 0.1, capped=False)
    assert np.isinf(tube.intersect(start, along)).all()
    capped = Cone((0.0, 0.0, 1.0), (0.0, 0.0, 2.0), 0.1, 0.1)
    np.testing.assert_allclose(capped.intersect(start, along), [1.0])


def test_point_light_falls_off_and_casts_the_shadow_of_a_ball():
    # light 4 m above a floor, ball of radius 0.5 m halfway: the umbra is a disc of radius 4 tan(asin(0.25))
    radius = np.linspace(0.0, 3.0, 301)
    points = np.stack([radius, np.zeros(301), np.full(301, 5.0)])
    normals = np.tile([[0.0], [-1.0], [0.0]], 301)
    ball = Caster.of(Ellipsoid((0.0, -2.0, 5.0), (0.5, 0.5, 0.5)))
    light = PointLight((0.0, -4.0, 5.0), (2.0, 1.0, 0.5))
    irradiance = light.irradiance(points, normals, [ball])
    umbra = 4 * math.tan(math.asin(0.25))
    expected = np.where(radius < umbra, 0.0, 4.0 / (16.0 + radius**2) ** 1.5)
    assert np.abs(radius - umbra).min() > SHADOW_MARGIN
    np.testing.assert_allclose(irradiance, expected * np.array([[2.0], [1.0], [0.5]]), rtol=1e-9)
    free = PointLight((0.0, -4.0, 5.0), (2.0, 1.0, 0.5), indirect=True).irradiance(points, normals, [ball])
    assert (free > 0).all()
    below = light.irradiance(points, -normals, [])
    assert (below == 0).all()


SHADOW_MARGIN = 1e-3
"""Metres between any tested point and the border of a shadow; more than the shadow ray's offset."""


def test_sun_comes_through_the_window_only():
    opening = Rectangle((-1.0, -2.0, 5.0), (2.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    beam = SunBeam((0.0, -1.0, 1.0), (3.0, 2.0, 1.0), opening)
    # 45 degrees: the floor at y = 0 is lit from 1 to 2 m before the window
    z = np.array([4.5, 3.9, 3.1, 2.9])
    points = np.stack([np.zeros(4), np.zeros(4), z])
    normals = np.tile([[0.0], [-1.0], [0.0]], 4)
    np.testing.assert_allclose(beam.irradiance(points, normals, [])[0] / 3, [0, 0.5**0.5, 0.5**0.5, 0])
    bar = Caster.of(Box((0.0, -1.1, 5.0), (2.0, 0.05, 0.02)))
    np.testing.assert_allclose(beam.irradiance(points, normals, [bar])[0] / 3, [0, 0, 0.5**0.5, 0])


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
