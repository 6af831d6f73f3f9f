"""Procedural textures: each is, or returns, a `Texture` of `stereohdr.simulation.ray_casting`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereohdr.simulation.ray_casting import Array, Texture, Vector, column

_LATTICE = np.random.default_rng(20170621).random((64, 64))
"""Random numbers in 0..1 at the integer points of a plane that repeats every 64."""


def _at_lattice(x: Array, y: Array | float) -> Array:
    """Return the random numbers at points with whole coordinates."""
    return _LATTICE[np.asarray(y, np.int64) % 64, np.asarray(x, np.int64) % 64]


def _noise(x: Array, y: Array | float, pixel: Array | float = 0.0) -> Array:
    """Return smooth noise in 0..1 with features of size 1; fades to 0.5 as a pixel grows to that size."""
    x0, y0 = np.floor(x), np.floor(y)
    fx, fy = x - x0, y - y0
    fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
    top = _at_lattice(x0, y0) * (1 - fx) + _at_lattice(x0 + 1, y0) * fx
    bottom = _at_lattice(x0, y0 + 1) * (1 - fx) + _at_lattice(x0 + 1, y0 + 1) * fx
    value = top * (1 - fy) + bottom * fy
    return 0.5 + (value - 0.5) * np.clip(1.6 - 2.0 * pixel, 0.0, 1.0)


def _cloudy(x: Array, y: Array, pixel: Array) -> Array:
    """Return noise of three octaves in 0..1."""
    coarse, middle, fine = (_noise(f * x + 17 * f, f * y + 5 * f, f * pixel) / f for f in (1.0, 2.0, 4.0))
    return (coarse + middle + fine) / 1.75


def _lines(x: Array, period: float, width: float, pixel: Array) -> Array:
    """Return the share of a pixel covered by lines of this width around the multiples of `period`."""
    distance = np.abs((x / period + 0.5) % 1.0 - 0.5) * period
    drawn = np.maximum(width, pixel)
    return np.clip((drawn / 2 - distance) / pixel + 0.5, 0.0, 1.0) * np.minimum(width / pixel, 1.0)


def _inside(distance: Array, pixel: Array) -> Array:
    """Return the share of a pixel inside a border; `distance` to it in metres, negative inside."""
    return np.clip(0.5 - distance / pixel, 0.0, 1.0)


def _wrap(x: Array, period: float) -> Array:
    """Return the signed distance to the nearest multiple of the period."""
    return x - period * np.round(x / period)


def _pixel_along_z(distance: Array, z: Array, pixel: Array) -> Array:
    """Return how far a pixel reaches along z on a floor or side wall, `distance` from the camera's axis."""
    return pixel * z / np.maximum(np.abs(distance), 0.1)


def _mix(a: Vector | Array, b: Vector | Array, share: Array) -> Array:
    """Return ``a`` where share is 0, ``b`` where it is 1, ``(3, N)``."""
    first = column(a) if isinstance(a, tuple) else a
    second = column(b) if isinstance(b, tuple) else b
    return first + (second - first) * share


# -------------------------------------------------------------------------------------------------- in the room


def plain(colour: Vector) -> Texture:
    """Return one colour everywhere."""
    return lambda points, pixel: np.broadcast_to(column(colour), points.shape)


def plaster(points: Array, pixel: Array) -> Array:
    """White paint with a hardly visible unevenness: nothing for a matcher to hold on to."""
    x, y, z = points
    return 0.72 * (1.0 + 0.015 * (_noise(1.3 * (x + z), 1.3 * y, 1.3 * pixel) - 0.5)) * column((1.0, 0.97, 0.9))


def wallpaper(points: Array, pixel: Array) -> Array:
    """Broad stripes with a diamond in each, and a fine damask."""
    x, y, _ = points
    stripe = _lines(x, 0.36, 0.18, pixel)
    colour = _mix((0.46, 0.52, 0.40), (0.62, 0.60, 0.46), stripe)
    for centre, rise in ((0.0, 0.0), (0.18, 0.18)):
        dx = np.abs((x - centre) / 0.36 - np.round((x - centre) / 0.36)) * 0.36
        dy = np.abs((y - rise) / 0.36 - np.round((y - rise) / 0.36)) * 0.36
        colour = _mix(colour, (0.42, 0.16, 0.13), _inside((dx + 0.6 * dy - 0.055) / 1.2, pixel))
        colour = _mix(colour, (0.78, 0.68, 0.38), _inside((dx + 0.6 * dy - 0.022) / 1.2, pixel))
    return colour * (0.85 + 0.3 * _noise(22 * x, 22 * y, 22 * pixel))


def planks(points: Array, pixel: Array) -> Array:
    """Floor boards that run along z, with grain and dark joints."""
    x, y, z = points
    along = _pixel_along_z(y, z, pixel)
    board = np.floor(x / 0.16)
    shifted = z + 3.0 * _at_lattice(board, 7)
    piece = np.floor(shifted / 1.5)
    tone = 0.75 + 0.5 * _at_lattice(board + 11, piece)
    grain = 0.8 + 0.4 * _noise(45 * x, 2.2 * shifted + 9 * board, np.maximum(45 * pixel, 2.2 * along))
    knots = 0.75 + 0.5 * _noise(7 * x + 3 * board, 1.1 * shifted, np.maximum(7 * pixel, 1.1 * along))
    joints = np.maximum(_lines(x, 0.16, 0.008, pixel), _lines(shifted, 1.5, 0.008, along))
    return _mix((0.40, 0.235, 0.125), (0.05, 0.03, 0.02), 0.85 * joints) * tone * grain * knots


def bricks(points: Array, pixel: Array) -> Array:
    """A brick wall along z, in running bond."""
    x, y, z = points
    along = _pixel_along_z(x, z, pixel)
    course = np.floor(y / 0.10)
    shifted = z + 0.14 * (course % 2)
    brick = np.floor(shifted / 0.28)
    tone = 0.65 + 0.7 * _at_lattice(brick, course)
    colour = _mix((0.38, 0.15, 0.10), (0.45, 0.24, 0.15), _at_lattice(brick + 5, course + 9))
    colour = colour * tone * (0.8 + 0.4 * _noise(30 * z, 30 * y, 30 * along))
    mortar = np.maximum(_lines(y, 0.10, 0.014, pixel), _lines(shifted, 0.28, 0.014, along))
    return _mix(colour, (0.55, 0.52, 0.47), mortar)


def wood(dark: Vector, light: Vector, along: int) -> Texture:
    """Return wood whose grain runs along one axis (0 x, 1 y, 2 z)."""

    def texture(points: Array, pixel: Array) -> Array:
        along_grain = points[along]
        one, two = (points[axis] for axis in range(3) if axis != along)
        bent = one + two + 0.03 * _noise(2.0 * along_grain, 3.0 * (one + two), 3.0 * pixel)
        rings = _noise(26 * bent, 1.6 * along_grain, 26 * pixel)
        fibres = _noise(90 * (one - two), 5 * along_grain, 90 * pixel)
        return _mix(dark, light, 0.7 * rings + 0.3 * fibres)

    return texture


def landscape(corner: Vector, width: float, height: float) -> Texture:
    """Return a painting: a sun above two ridges and a lake, on a canvas that faces the room."""

    def texture(points: Array, pixel: Array) -> Array:
        x, y = (points[0] - corner[0]) / width, (points[1] - corner[1]) / height
        size = pixel / height
        paint = _mix((0.20, 0.38, 0.62), (0.85, 0.66, 0.42), np.clip(y / 0.6, 0, 1))
        sun = np.hypot((x - 0.68) * width / height, y - 0.3) - 0.11
        paint = _mix(paint, (0.9, 0.75, 0.25), _inside(sun, size))
        far_ridge = 0.52 - 0.22 * _noise(4.2 * x + 3, 0.5)
        paint = _mix(paint, (0.25, 0.27, 0.42), _inside(far_ridge - y, size))
        near_ridge = 0.62 - 0.14 * _noise(6.0 * x + 21, 8.5)
        paint = _mix(paint, (0.12, 0.22, 0.12), _inside(near_ridge - y, size))
        lake = 0.7 + 0.6 * _noise(5 * x, 40 * y, 40 * size)
        return _mix(paint, column((0.14, 0.30, 0.42)) * lake, _inside(0.72 - y, size))

    return texture


def banded(colours: Sequence[Vector], axis: int, origin: float, period: float) -> Texture:
    """Return soft-edged bands of colours in turn along one axis."""

    def texture(points: Array, pixel: Array) -> Array:
        position = (points[axis] - origin) / period
        band = np.floor(position)
        palette = np.array(colours).T
        this, following = (palette[:, (band + k).astype(np.int64) % len(colours)] for k in (0, 1))
        return _mix(this, following, _inside((band + 1 - position) * period - pixel / 2, pixel))

    return texture


def ribboned(centre: Vector, paper: Vector, ribbon: Vector, width: float) -> Texture:
    """Return gift wrapping: dotted paper with a ribbon across each face through the centre."""

    def texture(points: Array, pixel: Array) -> Array:
        x, y, z = points - column(centre)
        dots = np.hypot(_wrap(x + z, 0.03), _wrap(y - 0.4 * z, 0.03)) - 0.006
        colour = _mix(paper, (0.85, 0.85, 0.8), _inside(dots, pixel))
        cross = np.minimum(np.abs(x), np.abs(z)) - width / 2
        return _mix(colour, ribbon, _inside(cross, pixel))

    return texture


def outside(scale: float) -> Texture:
    """Return what is seen through a window: sky with clouds, sunlit houses, a hedge; emitted radiance."""

    def texture(points: Array, pixel: Array) -> Array:
        x, y, _ = points
        up = np.clip(-y / 9.0, 0.0, 1.0)
        view = _mix((1.0, 1.05, 1.1), (0.28, 0.52, 1.0), up)
        clouds = np.clip(3.2 * (_cloudy(0.35 * x, 0.8 * y, 0.8 * pixel) - 0.5), 0, 1)
        view = _mix(view, (2.2, 2.2, 2.1), clouds)
        for left, right, top, wall, roof in (
            (-9.5, -5.6, -1.6, (0.95, 0.80, 0.55), (0.40, 0.14, 0.09)),
            (-4.4, -0.6, -2.6, (0.80, 0.42, 0.30), (0.28, 0.22, 0.20)),
            (1.0, 6.0, -2.0, (0.9, 0.9, 0.8), (0.35, 0.15, 0.1)),
        ):
            middle, half = (left + right) / 2, (right - left) / 2
            gable = np.maximum(np.abs(x - middle) / half * 1.5 - 1.5 - (y - top), y - top)
            view = _mix(view, roof, _inside(gable, pixel))
            body = np.maximum(np.abs(x - middle) - half + 0.2, top - y)
            pane = np.maximum(np.abs(_wrap(x - middle, 1.1)) - 0.3, np.abs(_wrap(y - top - 0.8, 1.5)) - 0.42)
            facade = _mix(wall, (0.10, 0.13, 0.17), _inside(pane, pixel))
            view = _mix(view, facade, _inside(body, pixel))
        hedge_top = 1.0 - 0.9 * _noise(0.9 * x, 3.5, 0.9 * pixel)
        leaves = column((0.12, 0.30, 0.06)) * (0.5 + _cloudy(3 * x, 3 * y, 3 * pixel))
        return scale * _mix(view, leaves, _inside(hedge_top - y, pixel))

    return texture


# ------------------------------------------------------------------------------------------------ in the street


def night_sky(points: Array, pixel: Array) -> Array:
    """Faint clouds, a little brighter above the roofs; emitted radiance."""
    x, y, _ = points
    glow = np.clip(1.0 + y / 45.0, 0.0, 1.0)
    clouds = 0.6 + 0.8 * _cloudy(0.06 * x, 0.14 * y, 0.14 * pixel)
    return _mix((0.0007, 0.0011, 0.0026), (0.0060, 0.0055, 0.0060), glow) * clouds


def cobbles(points: Array, pixel: Array) -> Array:
    """Paving stones in rows across the street."""
    x, y, z = points
    along = _pixel_along_z(y, z, pixel)
    row = np.floor(z / 0.22)
    shifted = x + 0.09 * (row % 2)
    tone = 0.6 + 0.8 * _at_lattice(np.floor(shifted / 0.18 + 0.5), row)
    joints = np.maximum(_lines(shifted + 0.09, 0.18, 0.02, pixel), _lines(z, 0.22, 0.02, along))
    fade = np.clip(1.4 - along / 0.22, 0.0, 1.0)
    return _mix((0.15, 0.145, 0.14), (0.04, 0.04, 0.04), joints) * (1.0 + fade * (tone - 1.0))


def _facade_window(points: Array, pixel: Array) -> tuple[Array, Array]:
    """Return the share of a pixel inside a window pane, and a number in 0..1 that belongs to that window."""
    _, y, z = points
    along = pixel * z / 3.6
    across, up = _wrap(z, 2.3), _wrap(y + 0.9, 2.5)
    pane = np.minimum(_inside(np.abs(across) - 0.48, along), _inside(np.abs(up) - 0.7, pixel))
    bars = np.maximum(_inside(np.abs(across) - 0.03, along), _inside(np.abs(up + 0.2) - 0.03, pixel))
    lot = _at_lattice(np.round(z / 2.3) + 3, np.round((y + 0.9) / 2.5) + 20 + 7 * (points[0] > 0))
    return pane * (1.0 - bars), lot


def facade_albedo(points: Array, pixel: Array) -> Array:
    """House fronts along z: painted walls with a ledge per storey, dark window panes."""
    x, y, z = points
    pane, _ = _facade_window(points, pixel)
    house = np.floor(z / 6.9 + 0.5)
    hue = _at_lattice(house + 2, np.where(x > 0, 31, 47))
    wall = _mix((0.42, 0.26, 0.16), (0.36, 0.35, 0.30), hue)
    wall = wall * (0.7 + 0.6 * _cloudy(2.4 * z, 2.4 * y, 2.4 * pixel * z / 3.6))
    wall = _mix(wall, (0.5, 0.47, 0.42), _lines(y + 2.2, 2.5, 0.12, pixel))
    return _mix(wall, (0.03, 0.035, 0.04), pane)


def lit_windows(points: Array, pixel: Array) -> Array:
    """The light in a third of the windows of `facade_albedo`; emitted radiance."""
    pane, lot = _facade_window(points, pixel)
    curtain = 0.5 + 0.5 * _noise(9.0 * points[2], 0.6 * points[1], 9.0 * pixel * points[2] / 3.6)
    return column((5.0, 3.1, 1.2)) * pane * (lot > 0.66) * curtain


# -------------------------------------------------------------------------------------------- on the test plane


def patchwork(unit: float, width: int) -> Texture:
    """Return blotches of colour and a grid of lines; `unit` is the size of a pixel in metres."""

    def texture(points: Array, pixel: Array) -> Array:
        x, y = points[0] / unit, points[1] / unit
        size = pixel / unit
        first, second = _cloudy(x / 18, y / 18, size / 18), _cloudy(x / 11 + 30, y / 11 + 9, size / 11)
        colour = _mix((0.10, 0.18, 0.35), (0.80, 0.55, 0.25), first) * (0.3 + 1.2 * second)
        grid = np.maximum(_lines(x, 36.0, 3.0, size), _lines(y, 36.0, 3.0, size))
        return _mix(colour, (0.75, 0.75, 0.7), 0.7 * grid) * 10.0 ** np.clip(2 * x / width, -1.5, 1.5)

    return texture
