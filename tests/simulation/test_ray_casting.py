import math

import numpy as np
import pytest

from stereohdr.simulation import ray_casting
from stereohdr.simulation.ray_casting import (
    Box,
    Caster,
    Cone,
    Ellipsoid,
    Plane,
    PointLight,
    Rectangle,
    SunBeam,
)
from stereohdr.simulation.scenes import SCENES

SHADOW_MARGIN = 1e-3
"""Metres between any tested point and the border of a shadow; more than the shadow ray's offset."""

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


@pytest.mark.parametrize("name", ["room", "street_night"])
def test_culling_changes_nothing(name, monkeypatch):
    culled = SCENES[name](48, 36)
    everywhere = (-math.inf, math.inf, -math.inf, math.inf)
    monkeypatch.setattr(ray_casting, "_screen_bounds", lambda shape, eye: everywhere)
    unbounded = np.full((3, 1), np.inf)
    monkeypatch.setattr(Caster, "of", classmethod(lambda cls, shape: cls(shape, -unbounded, unbounded)))
    monkeypatch.setattr(ray_casting, "CHUNK", 1000)
    monkeypatch.setattr(ray_casting, "BLOCK", 7)
    plain = SCENES[name](48, 36)
    np.testing.assert_array_equal(culled.radiance_left, plain.radiance_left)
    np.testing.assert_array_equal(culled.radiance_right, plain.radiance_right)
    np.testing.assert_array_equal(culled.disparity_left.values, plain.disparity_left.values)
    np.testing.assert_array_equal(culled.disparity_right.flags, plain.disparity_right.flags)
