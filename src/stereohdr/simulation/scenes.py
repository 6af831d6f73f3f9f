"""Procedural stereo scenes with exact ground truth: a furnished room, a street at night, and two test scenes.

Coordinates are those of `stereohdr.simulation.ray_casting`: metres, x right, y down, z forward, eye level y = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.model import Disparity
from stereohdr.simulation.ray_casting import (
    Ambient,
    Box,
    Cone,
    Ellipsoid,
    Light,
    Plane,
    PointLight,
    Rectangle,
    Rig,
    Shape,
    SunBeam,
    Surface,
    Texture,
    Vector,
    ball,
    exact_disparity,
    render_radiance,
    unit,
)
from stereohdr.simulation.textures import (
    banded,
    bricks,
    cobbles,
    facade_albedo,
    landscape,
    lit_windows,
    night_sky,
    outside,
    patchwork,
    plain,
    planks,
    plaster,
    ribboned,
    wallpaper,
    wood,
)

DEFAULT_BASELINE = 0.145
"""Distance of the cameras in metres."""

_PAINT = plain((0.75, 0.74, 0.70))
_BRASS = plain((0.42, 0.33, 0.16))
_DARK_METAL = plain((0.06, 0.06, 0.065))
_BLACK = plain((0.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class StereoScene:
    """A stereo scene with exact ground truth.

    Parameters
    ----------
    radiance_left, radiance_right
        ``(H, W, 3)`` float32, linear, relative, positive; averaged over each pixel.
    disparity_left, disparity_right
        Disparity in pixels of the point that the ray through the pixel's centre hits, in the left and in the
        right view's pixels: ``x_left = x_right + d``. ``MATCHED`` where the other view sees the point,
        ``OCCLUDED`` where the point is hidden there or outside of its frame (-0.5 to W - 0.5).
    name
        Name of the scene.
    max_disparity
        The largest disparity of both views, rounded up, pixels.
    """

    radiance_left: NDArray[np.float32]
    radiance_right: NDArray[np.float32]
    disparity_left: Disparity
    disparity_right: Disparity
    name: str
    max_disparity: int


def _render(name: str, surfaces: Sequence[Surface], lights: Sequence[Light], rig: Rig) -> StereoScene:
    left, right = (exact_disparity(surfaces, rig, side) for side in (-1, 1))
    return StereoScene(
        radiance_left=render_radiance(surfaces, lights, rig, -1),
        radiance_right=render_radiance(surfaces, lights, rig, 1),
        disparity_left=left,
        disparity_right=right,
        name=name,
        max_disparity=math.ceil(max(left.values.max(), right.values.max())),
    )


# --------------------------------------------------------------------------------------------------------- room

_LEFT, _RIGHT, _CEILING, _FLOOR, _BACK = -1.75, 2.0, -1.35, 1.2, 5.0
"""The walls of the room, metres."""
_WINDOW = (-1.35, -1.0, -0.05, 0.25)
"""Left, top, right, bottom of the window in the back wall, metres."""
_TABLE = 0.53
"""Height of the table top (y), metres."""
_BULB: Vector = (0.36, 0.09, 1.38)
"""Centre of the lamp's bulb."""


def room(
    width: int = 480, height: int = 360, *, baseline: float = DEFAULT_BASELINE, supersampling: int = 2
) -> StereoScene:
    """Return a furnished room with a bright window, a burning lamp and an open, dark cupboard.

    Parameters
    ----------
    width, height
        Size in pixels; the composition fills a 4:3 image of any size.
    baseline
        Distance of the cameras in metres, above 0, at most 0.5.
    supersampling
        Samples per pixel along each axis, 1 to 8.

    Returns
    -------
    The scene. At the default size the back wall has about 12 px disparity, the nearest object about 70 px.

    Raises
    ------
    InputError
        A size, the baseline or the supersampling is out of range.
    """
    surfaces = [
        *_room_shell(),
        *_window(),
        *_cupboard(),
        *_chair((-0.85, _FLOOR, 3.15), 28.0),
        *_table(),
        *_ball_and_gift(),
        *_vase_of_flowers(),
        *_mug_of_pencils(),
        *_desk_lamp(),
    ]
    left, top, right, bottom = _WINDOW
    opening = Rectangle((left, top, _BACK), (right - left, 0.0, 0.0), (0.0, bottom - top, 0.0))
    # The sky is an area light: two patches, just inside of the window's bars.
    sky = [
        PointLight((x, 0.5 * (top + bottom), _BACK - 0.06), (5.2, 6.0, 7.0), facing=(0.0, 0.0, -1.0))
        for x in (0.75 * left + 0.25 * right, 0.25 * left + 0.75 * right)
    ]
    lights: list[Light] = [
        SunBeam((0.16, -0.80, 0.90), (75.0, 66.0, 50.0), opening),
        *sky,
        PointLight(_BULB, (2.6, 1.75, 0.85)),
        # What the sunlit floor throws back at walls and ceiling.
        PointLight((-0.9, _FLOOR, 3.2), (1.5, 1.0, 0.6), facing=(0.0, -1.0, 0.0), indirect=True),
        Ambient((0.085, 0.08, 0.075)),
    ]
    return _render("room", surfaces, lights, Rig(width, height, baseline, supersampling))


def _room_shell() -> list[Surface]:
    width, height, depth = _RIGHT - _LEFT, _FLOOR - _CEILING, 6.0
    left, top, right, bottom = _WINDOW
    hole = (
        (left - _LEFT) / width,
        (top - _CEILING) / height,
        (right - _LEFT) / width,
        (bottom - _CEILING) / height,
    )
    down, backwards = (0.0, height, 0.0), (0.0, 0.0, -depth)
    # Side walls run past the back wall, floor and ceiling past both, so that no ray slips through a seam.
    lap = 0.05
    across = (width + 2 * lap, 0.0, 0.0)
    walls = [
        (Rectangle((_LEFT, _CEILING, _BACK), (width, 0.0, 0.0), down, hole), wallpaper),
        (Rectangle((_LEFT, _CEILING, _BACK + lap), down, backwards), plaster),
        (Rectangle((_RIGHT, _CEILING, _BACK + lap), down, backwards), bricks),
        (Rectangle((_LEFT - lap, _CEILING, _BACK + lap), across, backwards), plain((0.8, 0.79, 0.76))),
        (Rectangle((_LEFT - lap, _FLOOR, _BACK + lap), across, backwards), planks),
    ]
    skirting = [
        Box.between((_LEFT, _FLOOR - 0.10, _BACK - 0.02), (_RIGHT, _FLOOR, _BACK)),
        Box.between((_LEFT, _FLOOR - 0.10, 0.0), (_LEFT + 0.02, _FLOOR, _BACK)),
        Box.between((_RIGHT - 0.02, _FLOOR - 0.10, 0.0), (_RIGHT, _FLOOR, _BACK)),
    ]
    picture: Vector = (0.27, -0.78, _BACK - 0.03)
    frame = Box.between((0.22, -0.83, _BACK - 0.028), (0.98, -0.25, _BACK))
    canvas = Rectangle(picture, (0.66, 0.0, 0.0), (0.0, 0.48, 0.0))
    return [
        *(Surface(shape, texture, casts_shadow=False) for shape, texture in walls),
        *(Surface(shape, _PAINT, casts_shadow=False) for shape in skirting),
        Surface(frame, _BRASS, casts_shadow=False),
        Surface(canvas, landscape(picture, 0.66, 0.48), casts_shadow=False),
    ]


def _window() -> list[Surface]:
    left, top, right, bottom = _WINDOW
    middle, transom = (left + right) / 2, top + 0.36 * (bottom - top)
    front, back = _BACK - 0.03, _BACK + 0.03
    frame, bar = 0.05, 0.013
    parts = [
        ((left - frame, top - frame, front), (left, bottom + frame, back)),
        ((right, top - frame, front), (right + frame, bottom + frame, back)),
        ((left - frame, top - frame, front), (right + frame, top, back)),
        ((left - frame, bottom, _BACK - 0.16), (right + frame, bottom + 0.04, back)),  # the sill
        ((middle - 2 * bar, top, front), (middle + 2 * bar, bottom, back)),
        ((left, transom - bar, front), (right, transom + bar, back)),
        *(
            ((x - bar, top, front), (x + bar, bottom, back))
            for x in (0.5 * (left + middle), 0.5 * (middle + right))
        ),
    ]
    backdrop = Rectangle((-60.0, -40.0, 30.0), (120.0, 0.0, 0.0), (0.0, 60.0, 0.0))
    return [
        *(Surface(Box.between(low, high), _PAINT) for low, high in parts),
        Surface(backdrop, _BLACK, emission=outside(22.0), casts_shadow=False),
        *_plant((right - 0.22, bottom, _BACK - 0.08), 0.34),
    ]


def _plant(foot: Vector, height: float) -> list[Surface]:
    """Return a pot with thin stems that end in leaves."""
    x, y, z = foot
    rim = (x, y - 0.30 * height, z)
    surfaces = [Surface(Cone(foot, rim, 0.13 * height, 0.19 * height), plain((0.50, 0.22, 0.13)))]
    for number in range(6):
        angle = 2.4 * number
        lean = 0.12 + 0.035 * number
        tip = (
            x + height * lean * math.cos(angle),
            y - height * (1.02 - 0.07 * (number % 4)),
            z + 0.4 * height * lean * math.sin(angle),
        )
        surfaces.append(Surface(Cone(rim, tip, 0.006, 0.004), plain((0.10, 0.22, 0.05))))
        leaf = Ellipsoid(tip, (0.11 * height, 0.05 * height, 0.05 * height))
        surfaces.append(Surface(leaf, plain((0.09, 0.28, 0.06))))
    return surfaces


def _cupboard() -> list[Surface]:
    """Return a tall cupboard without a door; what stands in it is deep in shadow."""
    left, right, top, front, back = 1.08, 1.96, -0.75, 4.30, 4.98
    timber = wood((0.16, 0.085, 0.045), (0.34, 0.20, 0.11), along=1)
    thick, inside = 0.035, 0.02
    outer = [
        Box.between((left, top, front), (left + thick, _FLOOR, back)),
        Box.between((right - thick, top, front), (right, _FLOOR, back)),
        Box.between((left, top, front), (right, top + thick, back)),
        Box.between((left, _FLOOR - 0.12, front), (right, _FLOOR, back)),
    ]
    heights = (-0.28, 0.20, 0.66)
    shelves = [Box.between((left + thick, y, front + 0.03), (right - thick, y + 0.025, back)) for y in heights]
    contents = [
        Rectangle((left, top, back), (right - left, 0.0, 0.0), (0.0, _FLOOR - top, 0.0)),
        *shelves,
        # The inner faces are sheets of their own, a hair inside of the outer boards, because they are darker.
        *(
            Rectangle((x, top + thick, front + 0.01), (0.0, 0.0, back - front), (0.0, 1.8, 0.0))
            for x in (left + thick + 1e-3, right - thick - 1e-3)
        ),
        *(
            Rectangle(
                (left + thick, y, front + 0.01), (right - left - 2 * thick, 0.0, 0.0), (0.0, 0.0, back - front)
            )
            for y in (top + thick + 1e-3, _FLOOR - 0.12 - 1e-3)
        ),
    ]
    # No direct light gets in, so nothing inside needs to cast a shadow.
    surfaces = [
        *(Surface(shape, timber) for shape in outer),
        *(Surface(shape, timber, openness=inside, casts_shadow=False) for shape in contents),
    ]
    spines = ((0.45, 0.10, 0.08), (0.10, 0.22, 0.40), (0.50, 0.42, 0.20), (0.10, 0.30, 0.16), (0.6, 0.58, 0.5))
    things: list[tuple[Shape, Texture]] = []
    x = left + thick + 0.04
    for number in range(9):  # books
        thickness = 0.035 + 0.012 * ((5 * number) % 4)
        tall = 0.24 + 0.03 * ((3 * number) % 4)
        low, high = (x, heights[0] - tall, front + 0.12), (x + thickness, heights[0], front + 0.34)
        things.append((Box.between(low, high), plain(spines[number % 5])))
        x += thickness + 0.006
    jug: Vector = (left + 0.24, heights[1], front + 0.25)
    shoulder: Vector = (jug[0], heights[1] - 0.20, jug[2])
    neck: Vector = (jug[0], heights[1] - 0.32, jug[2])
    cardboard = banded(((0.5, 0.45, 0.3), (0.25, 0.2, 0.14)), axis=0, origin=0.0, period=0.06)
    things += [
        (Cone(jug, shoulder, 0.06, 0.12), plain((0.6, 0.6, 0.62))),
        (Cone(shoulder, neck, 0.12, 0.045), plain((0.6, 0.6, 0.62))),
        (ball((left + 0.62, heights[1] - 0.12, front + 0.28), 0.12), plain((0.55, 0.16, 0.08))),
        (Box((left + 0.32, heights[2] - 0.12, front + 0.30), (0.34, 0.24, 0.26), 14.0), cardboard),
        (ball((left + 0.66, heights[2] - 0.09, front + 0.2), 0.09), plain((0.12, 0.3, 0.42))),
    ]
    surfaces += [Surface(shape, texture, openness=2 * inside, casts_shadow=False) for shape, texture in things]
    return surfaces


def _chair(foot: Vector, turn: float) -> list[Surface]:
    """Return a chair with thin legs that stands on `foot`, turned by so many degrees."""
    timber = wood((0.33, 0.20, 0.10), (0.55, 0.38, 0.22), along=1)
    cosine, sine = math.cos(math.radians(turn)), math.sin(math.radians(turn))

    def place(x: float, up: float, z: float) -> Vector:
        return (foot[0] + cosine * x + sine * z, foot[1] - up, foot[2] - sine * x + cosine * z)

    half, seat, top = 0.19, 0.45, 0.95
    shapes: list[Shape] = [Box(place(0, seat, 0), (2 * half + 0.04, 0.03, 2 * half + 0.04), turn)]
    shapes += [Cone(place(x, 0, -half), place(x, seat, -half), 0.010, 0.013) for x in (-half, half)]
    shapes += [Cone(place(x, 0, half), place(x, top, half), 0.010, 0.012) for x in (-half, half)]
    shapes += [Cone(place(-half, up, half), place(half, up, half), 0.011, 0.011) for up in (0.6, 0.93)]
    shapes += [Cone(place(x, 0.6, half), place(x, 0.93, half), 0.006, 0.006) for x in (-0.1, 0.0, 0.1)]
    return [Surface(shape, timber) for shape in shapes]


def _table() -> list[Surface]:
    """Return the table in the foreground."""
    timber = wood((0.27, 0.14, 0.07), (0.50, 0.30, 0.16), along=0)
    board = Box.between((-0.32, _TABLE, 0.55), (1.30, _TABLE + 0.035, 1.92))
    legs = [Box.between((x, _TABLE + 0.03, 1.82), (x + 0.05, _FLOOR, 1.87)) for x in (-0.28, 1.2)]
    return [Surface(shape, timber) for shape in (board, *legs)]


def _ball_and_gift() -> list[Surface]:
    stripes = banded(((0.70, 0.12, 0.08), (0.80, 0.76, 0.68)), axis=0, origin=0.06, period=0.045)
    gift: Vector = (0.42, _TABLE - 0.055, 1.16)
    wrapping = ribboned(gift, (0.10, 0.22, 0.52), (0.80, 0.62, 0.15), 0.026)
    return [
        Surface(ball((0.15, _TABLE - 0.085, 1.45), 0.085), stripes),
        Surface(Box(gift, (0.17, 0.11, 0.14), -24.0), wrapping),
    ]


def _vase_of_flowers() -> list[Surface]:
    x, z = -0.13, 1.62
    profile = ((0.0, 0.045), (0.05, 0.075), (0.12, 0.082), (0.18, 0.05), (0.22, 0.026), (0.25, 0.038))
    glaze = banded(
        ((0.10, 0.30, 0.36), (0.62, 0.60, 0.52), (0.07, 0.20, 0.26)), axis=1, origin=_TABLE, period=0.042
    )
    surfaces = [
        Surface(Cone((x, _TABLE - low, z), (x, _TABLE - high, z), wide, narrow, capped=False), glaze)
        for (low, wide), (high, narrow) in pairwise(profile)
    ]
    mouth: Vector = (x, _TABLE - 0.24, z)
    flowers = (
        ((-0.10, 0.24, 0.02), (0.78, 0.60, 0.10)),
        ((0.01, 0.30, -0.02), (0.75, 0.20, 0.25)),
        ((0.09, 0.22, 0.03), (0.8, 0.75, 0.7)),
    )
    for (dx, up, dz), petals in flowers:
        tip: Vector = (x + dx, mouth[1] - up, z + dz)
        surfaces += [
            Surface(Cone(mouth, tip, 0.0035, 0.0035), plain((0.12, 0.26, 0.07))),
            Surface(Ellipsoid(tip, (0.034, 0.026, 0.034)), plain(petals)),
            Surface(ball((tip[0], tip[1], tip[2] - 0.028), 0.012), plain((0.16, 0.09, 0.04))),
        ]
    return surfaces


def _mug_of_pencils() -> list[Surface]:
    x, z = -0.07, 0.99
    mug = Cone((x, _TABLE, z), (x, _TABLE - 0.085, z), 0.032, 0.036, capped=False)
    surfaces = [Surface(mug, plain((0.62, 0.62, 0.58)))]
    pencils = (
        ((-0.055, 0.19, -0.06), (0.75, 0.55, 0.06)),
        ((0.01, 0.21, 0.03), (0.60, 0.08, 0.07)),
        ((0.05, 0.18, -0.12), (0.08, 0.25, 0.55)),
    )
    for (dx, up, dz), colour in pencils:
        pencil = Cone((x, _TABLE - 0.01, z), (x + dx, _TABLE - up, z + dz), 0.0032, 0.0032)
        surfaces.append(Surface(pencil, plain(colour)))
    return surfaces


def _desk_lamp() -> list[Surface]:
    """Return a desk lamp on thin arms; its bulb looks out of the shade."""
    foot: Vector = (0.66, _TABLE, 1.62)
    elbow: Vector = (0.78, 0.16, 1.66)
    head: Vector = (0.46, -0.05, 1.45)
    axis = unit(np.subtract(_BULB, head))
    rim = _moved(_BULB, axis, 0.012)
    top = _moved(rim, axis, -0.13)
    knob = _moved(top, axis, -0.03)
    green = plain((0.05, 0.22, 0.13))
    arms: list[Shape] = [
        Cone(foot, (foot[0], foot[1] - 0.02, foot[2]), 0.075, 0.07),
        Cone(foot, elbow, 0.0045, 0.0045),
        ball(elbow, 0.012),
        Cone(elbow, knob, 0.0045, 0.0045),
    ]
    glow = plain((850.0, 570.0, 280.0))
    return [
        *(Surface(shape, _DARK_METAL) for shape in arms),
        Surface(Cone(top, rim, 0.028, 0.085, capped=False), green),
        Surface(Cone(knob, top, 0.022, 0.030), green),
        Surface(ball(_BULB, 0.028), _PAINT, emission=glow, casts_shadow=False),
    ]


def _moved(point: Vector, direction: Vector, distance: float) -> Vector:
    """Return the point this far along a unit vector."""
    x, y, z = (p + distance * d for p, d in zip(point, direction, strict=True))
    return (x, y, z)


# ------------------------------------------------------------------------------------------------------- street


def street_night(
    width: int = 480, height: int = 360, *, baseline: float = 0.3, supersampling: int = 2
) -> StereoScene:
    """Return a street at night: lamps and lit windows, and house fronts that the light hardly reaches.

    Parameters
    ----------
    width, height
        Size in pixels; the composition fills a 4:3 image of any size.
    baseline
        Distance of the cameras in metres, above 0, at most 0.5.
    supersampling
        Samples per pixel along each axis, 1 to 8.

    Returns
    -------
    The scene. At the default size the end of the street has about 4 px disparity, the nearest bollard about 60.

    Raises
    ------
    InputError
        A size, the baseline or the supersampling is out of range.
    """
    road, kerb, half, end = 1.5, 1.38, 3.6, 34.0
    sky = Plane((0.0, 0.0, 1.0), 90.0)
    surfaces = [
        Surface(sky, _BLACK, emission=night_sky, casts_shadow=False),
        Surface(ball((-6.0, -19.0, 80.0), 2.4), _BLACK, emission=plain((9.0, 8.6, 7.4))),
        Surface(Rectangle((-40.0, road, 0.0), (80.0, 0.0, 0.0), (0.0, 0.0, 90.0)), cobbles),
    ]
    for side in (-1, 1):
        front = Rectangle((side * half, -6.4 + 0.9 * side, end), (0.0, 8.5, 0.0), (0.0, 0.0, -end))
        surfaces.append(Surface(front, facade_albedo, emission=lit_windows, casts_shadow=False))
        pavement = Box.between((side * 1.9, kerb, 0.3), (side * half, road, end))
        surfaces.append(Surface(pavement, plain((0.22, 0.21, 0.20)), casts_shadow=False))
    gable = Rectangle((-half, -4.6, end), (2 * half, 0.0, 0.0), (0.0, 7.0, 0.0))
    surfaces.append(Surface(gable, plain((0.30, 0.22, 0.16)), casts_shadow=False))

    lights: list[Light] = [Ambient((0.0035, 0.0040, 0.0060))]
    glow: Vector = (420.0, 270.0, 110.0)
    for x, z in ((-2.15, 5.2), (2.15, 9.0), (-2.15, 15.0), (2.15, 23.0)):
        surfaces.append(Surface(Cone((x, kerb, z), (x, -1.55, z), 0.035, 0.022), _DARK_METAL))
        surfaces.append(Surface(Cone((x, -1.83, z), (x, -1.95, z), 0.17, 0.05), _DARK_METAL))
        bulb: Vector = (x, -1.69, z)
        surfaces.append(Surface(ball(bulb, 0.12), _PAINT, emission=plain(glow), casts_shadow=False))
        lights.append(PointLight(bulb, (19.0, 12.2, 5.0)))
    for x in (-1.3, -0.45, 0.4, 1.25):  # bollards in front, joined by a bar
        surfaces.append(Surface(Cone((x, road, 2.1), (x, 0.55, 2.1), 0.035, 0.030), _PAINT))
        surfaces.append(Surface(ball((x, 0.53, 2.1), 0.045), plain((0.55, 0.08, 0.06))))
    surfaces.append(Surface(Cone((-1.3, 0.72, 2.1), (1.25, 0.72, 2.1), 0.007, 0.007), _DARK_METAL))
    surfaces += _parked_car((1.25, road, 6.4))
    return _render("street_night", surfaces, lights, Rig(width, height, baseline, supersampling))


def _parked_car(foot: Vector) -> list[Surface]:
    """Return a car seen from behind, with its rear lamps on."""
    x, y, z = foot
    body = Box((x, y - 0.55, z), (1.35, 0.55, 3.4))
    cabin = Ellipsoid((x, y - 0.85, z + 0.2), (0.62, 0.55, 1.3))
    wheels = [
        Cone((x + dx - 0.09, y - 0.3, z + dz), (x + dx + 0.09, y - 0.3, z + dz), 0.3, 0.3)
        for dx, dz in ((-0.62, -1.05), (0.62, -1.05), (-0.62, 1.05), (0.62, 1.05))
    ]
    lamps = [ball((x + dx, y - 0.62, z - 1.7), 0.07) for dx in (-0.52, 0.52)]
    return [
        Surface(body, plain((0.30, 0.05, 0.05))),
        Surface(cabin, plain((0.03, 0.035, 0.04))),
        *(Surface(wheel, plain((0.02, 0.02, 0.02))) for wheel in wheels),
        *(Surface(lamp, _PAINT, emission=plain((14.0, 0.5, 0.3))) for lamp in lamps),
    ]


# -------------------------------------------------------------------------------------------------- test scenes


def poles(
    width: int = 320, height: int = 240, *, baseline: float = DEFAULT_BASELINE, supersampling: int = 2
) -> StereoScene:
    """Return thin vertical poles, 2 to 3 px wide at any size, in front of a far textured wall with a hot spot.

    Parameters
    ----------
    width, height
        Size in pixels.
    baseline
        Distance of the cameras in metres, above 0, at most 0.5.
    supersampling
        Samples per pixel along each axis, 1 to 8.

    Returns
    -------
    The scene. At the default size the wall has 5 px disparity, the nearest pole 27 px.

    Raises
    ------
    InputError
        A size, the baseline or the supersampling is out of range.
    """
    rig = Rig(width, height, baseline, supersampling, horizon=0.5)
    surfaces = [Surface(Plane((0.0, 0.0, 1.0), 8.0), wallpaper, casts_shadow=False)]
    half_view = (width / 2) / rig.focal
    depths = (1.5, 4.0, 2.2, 3.0, 1.8, 5.0, 2.6)
    colours = ((0.6, 0.5, 0.1), (0.1, 0.2, 0.5), (0.7, 0.7, 0.65), (0.08, 0.08, 0.08))
    for number, z in enumerate(depths):
        x = z * half_view * (-0.78 + 0.26 * number)
        radius = 0.5 * (2.0 + 0.5 * (number % 3)) * z / rig.focal
        pole = Cone((x, -12.0, z), (x, 12.0, z), radius, radius)
        surfaces.append(Surface(pole, plain(colours[number % len(colours)])))
    lights: list[Light] = [
        Ambient((0.06, 0.06, 0.07)),
        PointLight((-2.2, -0.8, 7.5), (30.0, 26.0, 20.0)),
        PointLight((1.5, -3.0, 0.0), (4.0, 4.0, 4.2)),
    ]
    return _render("poles", surfaces, lights, rig)


def slanted_plane(
    width: int = 320,
    height: int = 240,
    *,
    disparity: float | None = None,
    gradient: tuple[float, float] = (0.04, 0.02),
    baseline: float = DEFAULT_BASELINE,
    supersampling: int = 2,
) -> StereoScene:
    """Return one textured plane whose disparity is linear in the left view's pixels.

    With ``(x_c, y_c) = ((width - 1) / 2, (height - 1) / 2)``, the disparity of the left view is
    ``d(x, y) = disparity + gradient[0] (x - x_c) + gradient[1] (y - y_c)``, that of the right view the same
    divided by ``1 - gradient[0]``.

    Parameters
    ----------
    width, height
        Size in pixels.
    disparity
        Disparity in the middle of the left view, pixels, > 0; None is ``(width + height) / 35``.
    gradient
        Change of the disparity per column and per row, pixels per pixel; the first below 1.
    baseline
        Distance of the cameras in metres, above 0, at most 0.5; it sets the scale of the world only.
    supersampling
        Samples per pixel along each axis, 1 to 8.

    Returns
    -------
    The scene; its radiance grows by two decades from left to right.

    Raises
    ------
    InputError
        A parameter is out of range, or the disparity would not be positive in the whole of both views.
    """
    rig = Rig(width, height, baseline, supersampling, horizon=0.5)
    middle = (width + height) / 35 if disparity is None else disparity
    across, down = gradient
    lowest = middle - abs(across) * width / 2 - abs(down) * height / 2
    if not (math.isfinite(lowest) and lowest > 0 and across < 1):
        raise InputError(
            f"the plane's disparity must be positive in both views and its gradient below 1 per column; got "
            f"{middle:g} px in the middle, gradient ({across:g}, {down:g}), at {width}x{height}"
        )
    # d = f b / Z and x - x_c = f X / Z with X from the left camera: f b = middle Z + f across X + f down Y
    focal = rig.focal
    facing: Vector = (focal * across, focal * down, middle)
    plane = Plane(facing, focal * baseline + facing[0] * rig.eye(-1))
    picture = patchwork(baseline / middle, width)  # Z / f: the size of a pixel in the middle
    surface = Surface(plane, _BLACK, emission=picture, casts_shadow=False)
    return _render("slanted_plane", [surface], [], rig)


SCENES: Mapping[str, Callable[..., StereoScene]] = {
    "room": room,
    "street_night": street_night,
    "poles": poles,
    "slanted_plane": slanted_plane,
}
"""The scenes by name; every one takes width, height, and the keywords baseline and supersampling."""
