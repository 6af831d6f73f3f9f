"""Radiance and exact disparity of surfaces in both views of a stereo camera, by analytic ray casting.

A scene is a list of `Surface` (a shape and what it is made of) and a list of lights, seen by a rectified pair of
pinhole cameras (`Rig`). Every shape is intersected in closed form, so the disparity of a pixel is exact, and
whether the other camera sees the same point is decided by casting the other camera's ray. Surfaces are
Lambertian: a point has the same radiance in both views.

World coordinates are metres, x right, y down, z forward; the eye level is y = 0 and the two cameras sit at
``x = -baseline / 2`` and ``x = +baseline / 2``, both at z = 0. The disparity of a point is
``d = focal * baseline / z``, and ``x_left = x_right + d``.

Arrays of points and vectors are ``(3, N)`` float64: one contiguous row per coordinate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.model import Disparity, DisparityFlag

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Texture = Callable[[Array, Array], Array]
"""``texture(points, pixel)``: points ``(3, N)`` in metres, size of a pixel there ``(N,)`` in metres, to albedo
or emitted radiance ``(3, N)``. Detail finer than the pixel is faded out, so that small images do not alias."""

FOCAL_SHARE = 0.867
"""Focal length as a share of the width of a 4:3 image: a field of view of 60 degrees."""
HORIZON_SHARE = 0.4
"""Height of the eye level in the image, share of the height from the top (the lens is shifted, so that more
floor than ceiling is seen and verticals stay vertical)."""

NEAREST_HIT = 1e-9
"""Hits closer than this ray parameter are the ray's own start."""
SAME_DEPTH = 1e-6
"""Relative depth difference below which two rays hit the same point: far above float64 rounding (1e-12 here),
far below the thinnest object (1e-3)."""
SHADOW_OFFSET = 1e-4
"""Shadow rays start this far above the surface, metres, so that a surface does not shadow itself."""
CHUNK = 1 << 17
"""Samples that are rendered at a time: bounds the memory and keeps the working set in the cache."""
BLOCK = 32
"""Neighbouring samples that share one bounding sphere when shadow casters are culled."""


# ------------------------------------------------------------------------------------------------------ vectors


def _dot(a: Vector | Array, b: Vector | Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def column(vector: Vector | Array) -> Array:
    """Return the vector as an array ``(3, 1)``."""
    return np.array(vector, np.float64)[:, None]


def unit(vector: Vector | Array) -> Vector:
    """Return the vector of length 1 in the same direction."""
    x, y, z = (float(component) for component in vector)
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)


def _turned(vectors: Array, degrees: float) -> Array:
    """Return the vectors turned about the vertical, the x axis towards the z axis."""
    if degrees == 0.0:
        return vectors
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    x, y, z = vectors
    return np.stack([cosine * x - sine * z, y, sine * x + cosine * z])


# ------------------------------------------------------------------------------------------------------- shapes


class Shape(Protocol):
    """What the renderer asks of a shape. Points and directions are ``(3, N)`` or ``(3, 1)``."""

    def intersect(self, start: Array, direction: Array) -> Array:
        """Return the ray parameter t > 0 of the first hit of ``start + t direction``, inf without; ``(N,)``."""
        ...

    def normal(self, points: Array) -> Array:
        """Return unit normals ``(3, N)`` at points of the surface; their sign is free."""
        ...

    def corners(self) -> Array | None:
        """Return points ``(3, K)`` whose convex hull holds the shape, or None if it is unbounded."""
        ...


@dataclass(frozen=True)
class Plane:
    """The unbounded plane ``normal . point = offset``."""

    facing: Vector
    """Normal, any length."""
    offset: float
    """Metres times the length of the normal."""

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.offset - _dot(self.facing, start)) / _dot(self.facing, direction)
        return np.where(t > NEAREST_HIT, t, np.inf)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        return np.broadcast_to(column(unit(self.facing)), points.shape)

    def corners(self) -> None:
        """See `Shape`."""
        return


@dataclass(frozen=True)
class Rectangle:
    """A rectangle from a corner along two perpendicular edges, with an optional rectangular hole."""

    corner: Vector
    """Metres."""
    edge_u: Vector
    """First edge, metres."""
    edge_v: Vector
    """Second edge, metres."""
    hole: tuple[float, float, float, float] | None = None
    """``(u0, v0, u1, v1)`` as shares of the edges."""

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        facing = np.cross(self.edge_u, self.edge_v)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (_dot(facing, self.corner) - _dot(facing, start)) / _dot(facing, direction)
            t = np.where((t > NEAREST_HIT) & np.isfinite(t), t, 0.0)
        offset = start + t * direction - column(self.corner)
        u = _dot(offset, self.edge_u) / _dot(self.edge_u, self.edge_u)
        v = _dot(offset, self.edge_v) / _dot(self.edge_v, self.edge_v)
        hit = (t > 0) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        if self.hole is not None:
            u0, v0, u1, v1 = self.hole
            hit &= ~((u > u0) & (u < u1) & (v > v0) & (v < v1))
        return np.where(hit, t, np.inf)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        return np.broadcast_to(column(unit(np.cross(self.edge_u, self.edge_v))), points.shape)

    def corners(self) -> Array:
        """See `Shape`."""
        corner, u, v = (np.array(vector) for vector in (self.corner, self.edge_u, self.edge_v))
        return np.stack([corner, corner + u, corner + v, corner + u + v], axis=1)


_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]).T
"""Corners of the unit cube, ``(3, 8)``."""


@dataclass(frozen=True)
class Box:
    """A box with level top, turned about its vertical axis."""

    centre: Vector
    """Metres."""
    size: Vector
    """Full extents along its own x, y and z, metres."""
    turn: float = 0.0
    """Angle about the vertical through the centre, degrees."""

    @classmethod
    def between(cls, low: Vector, high: Vector) -> Box:
        """Return the axis-aligned box from one corner to the opposite one."""
        x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
        width, height, depth = (abs(b - a) for a, b in zip(low, high, strict=True))
        return cls((x, y, z), (width, height, depth))

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        local_start = _turned(start - column(self.centre), self.turn)
        local_direction = _turned(direction, self.turn)
        half = column(self.size) / 2
        # A ray parallel to a face divides by zero to +-inf, which compares as it should.
        with np.errstate(divide="ignore", invalid="ignore"):
            one = (-half - local_start) / local_direction
            two = (half - local_start) / local_direction
        near, far = _overlap(one, two)
        t = np.where(near > NEAREST_HIT, near, far)
        return np.where((near <= far) & (t > NEAREST_HIT), t, np.inf)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        local = _turned(points - column(self.centre), self.turn) / column(self.size)
        face = np.abs(local).argmax(axis=0)
        normals = np.zeros(points.shape)
        every = np.arange(points.shape[1])
        normals[face, every] = np.sign(local[face, every])
        return _turned(normals, -self.turn)

    def corners(self) -> Array:
        """See `Shape`."""
        return _turned(_CUBE * column(self.size), -self.turn) + column(self.centre)


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid along the axes."""

    centre: Vector
    """Metres."""
    radii: Vector
    """Half axes, metres."""

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        w = (start - column(self.centre)) / column(self.radii)
        d = direction / column(self.radii)
        t, other = _quadratic_roots(_dot(d, d), _dot(w, d), _dot(w, w) - 1.0)
        t = np.where(t > NEAREST_HIT, t, other)
        return np.where(t > NEAREST_HIT, t, np.inf)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        gradient = (points - column(self.centre)) / column(self.radii) ** 2
        return gradient / np.sqrt(_dot(gradient, gradient))

    def corners(self) -> Array:
        """See `Shape`."""
        x, y, z = self.radii
        return Box(self.centre, (2 * x, 2 * y, 2 * z)).corners()


def ball(centre: Vector, radius: float) -> Ellipsoid:
    """Return the ball about a centre, metres."""
    return Ellipsoid(centre, (radius, radius, radius))


@dataclass(frozen=True)
class Cone:
    """A truncated cone between two points: poles, stems, lamp shades, the parts of a vase."""

    start: Vector
    """Centre of one end, metres."""
    end: Vector
    """Centre of the other end, metres."""
    radius_start: float
    """Metres, > 0."""
    radius_end: float
    """Metres, > 0."""
    capped: bool = True
    """False leaves both ends open."""

    def _axis(self) -> tuple[Vector, float, float]:
        offset = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(offset))
        return unit(offset), length, (self.radius_end - self.radius_start) / length

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        axis, length, slope = self._axis()
        # Rays are followed from the point closest to the cone: thin poles far away would lose their radius in
        # the differences of large squares otherwise.
        skip = _dot(column(np.add(self.start, self.end) / 2) - start, direction) / _dot(direction, direction)
        w = start + skip * direction - column(self.start)
        height, rise = _dot(w, axis), _dot(direction, axis)
        # |w + t d|^2 - h^2 = (r + slope h)^2 with h = height + t rise
        stretch = 1.0 + slope**2
        a = _dot(direction, direction) - stretch * rise**2
        b = _dot(w, direction) - stretch * height * rise - self.radius_start * slope * rise
        c = _dot(w, w) - stretch * height**2 - 2 * self.radius_start * slope * height - self.radius_start**2
        best = np.full(height.shape, np.inf)
        for t in _quadratic_roots(a, b, c):
            with np.errstate(invalid="ignore"):
                h = height + t * rise
                hit = (h >= 0) & (h <= length) & (t + skip > NEAREST_HIT) & np.isfinite(t)
            best = np.where(hit & (t < best), t, best)
        if self.capped:
            for h, radius in ((0.0, self.radius_start), (length, self.radius_end)):
                with np.errstate(divide="ignore", invalid="ignore"):
                    t = (h - height) / rise
                    t = np.where(np.isfinite(t), t, -np.inf)
                    across = w + np.where(np.isfinite(t), t, 0.0) * direction - h * column(axis)
                hit = (_dot(across, across) <= radius**2) & (t + skip > NEAREST_HIT)
                best = np.where(hit & (t < best), t, best)
        return best + skip

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        axis, length, slope = self._axis()
        w = points - column(self.start)
        height = _dot(w, axis)
        across = w - height * column(axis)
        side = across / np.sqrt(np.maximum(_dot(across, across), 1e-30)) - slope * column(axis)
        on_cap = self.capped & ((height < 1e-7) | (height > length - 1e-7))
        return np.where(on_cap, column(axis), side / math.sqrt(1.0 + slope**2))

    def corners(self) -> Array:
        """See `Shape`."""
        ends = [ball(self.start, self.radius_start), ball(self.end, self.radius_end)]
        return np.concatenate([end.corners() for end in ends], axis=1)


def _quadratic_roots(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Return the roots ``t1 <= t2`` of ``a t^2 + 2 b t + c``, inf where there are none."""
    discriminant = b * b - a * c
    real = (discriminant >= 0) & (np.abs(a) > 1e-300)
    root = np.sqrt(np.where(real, discriminant, 0.0))
    safe = np.where(real, a, 1.0)
    one, two = (-b - root) / safe, (-b + root) / safe
    return np.where(real, np.minimum(one, two), np.inf), np.where(real, np.maximum(one, two), np.inf)


def _overlap(one: Array, two: Array) -> tuple[Array, Array]:
    """Return where a ray enters the last and leaves the first of three slabs, from its two crossings of each.

    fmin and fmax drop the NaN of a ray that runs inside a face.
    """
    first, last = np.fmin(one, two), np.fmax(one, two)
    return np.fmax(np.fmax(first[0], first[1]), first[2]), np.fmin(np.fmin(last[0], last[1]), last[2])


def _screen_bounds(shape: Shape, eye: float) -> tuple[float, float, float, float]:
    """Return the range of x / z and y / z (u0, u1, v0, v1) that a shape can cover from ``(eye, 0, 0)``."""
    corners = shape.corners()
    if corners is None or corners[2].min() <= 1e-3:  # reaches behind the camera: no bounds
        return -math.inf, math.inf, -math.inf, math.inf
    u, v = (corners[0] - eye) / corners[2], corners[1] / corners[2]
    return u.min(), u.max(), v.min(), v.max()


# ------------------------------------------------------------------------------------------ surfaces and lights


@dataclass(frozen=True)
class Surface:
    """A shape and what it is made of."""

    shape: Shape
    """Where it is."""
    albedo: Texture
    """Share of the light that it reflects, 0..1 per channel."""
    emission: Texture | None = None
    """Radiance that it emits on its own."""
    openness: float = 1.0
    """Share of the indirect light that reaches it, 0..1: small inside a cupboard."""
    casts_shadow: bool = True
    """False for what encloses the scene and for the lamps themselves."""


class Light(Protocol):
    """What the renderer asks of a light."""

    @property
    def indirect(self) -> bool:
        """Whether it stands for light after many bounces: without shadows, scaled by `Surface.openness`."""
        ...

    def irradiance(self, points: Array, normals: Array, casters: Sequence[Caster]) -> Array:
        """Return the irradiance ``(3, N)`` at points with unit normals, shadows included."""
        ...


@dataclass(frozen=True)
class PointLight:
    """A small light."""

    position: Vector
    """Metres."""
    intensity: Vector
    """Irradiance per channel at 1 m, facing the light."""
    facing: Vector | None = None
    """Normal of a light that is a small flat patch: it falls off with the cosine. None shines everywhere."""
    indirect: bool = False
    """See `Light`."""

    def irradiance(self, points: Array, normals: Array, casters: Sequence[Caster]) -> Array:
        """See `Light`."""
        towards = column(self.position) - points
        squared = np.maximum(_dot(towards, towards), 1e-4)  # 1 cm: no pole where a light touches a surface
        strength = np.maximum(_dot(towards, normals), 0.0) / (squared * np.sqrt(squared))
        if self.facing is not None:
            strength *= np.maximum(-_dot(towards, unit(self.facing)), 0.0) / np.sqrt(squared)
        lit = np.flatnonzero(strength > 0)
        if not self.indirect and lit.size:
            starts = points[:, lit] + SHADOW_OFFSET * normals[:, lit]
            strength[lit] *= _visible(starts, lambda _: column(self.position), casters)
        return strength * column(self.intensity)


@dataclass(frozen=True)
class SunBeam:
    """Sunlight that enters through an opening."""

    towards: Vector
    """Direction to the sun, any length."""
    intensity: Vector
    """Irradiance per channel on a surface that faces the sun."""
    opening: Rectangle
    """The window through which it comes."""
    indirect: bool = False
    """See `Light`."""

    def irradiance(self, points: Array, normals: Array, casters: Sequence[Caster]) -> Array:
        """See `Light`."""
        direction = column(unit(self.towards))
        starts = points + SHADOW_OFFSET * normals
        enters = np.isfinite(self.opening.intersect(starts, direction))
        strength = np.where(enters, np.maximum(_dot(direction, normals), 0.0), 0.0)
        lit = np.flatnonzero(strength > 0)
        if lit.size:
            far = 100.0 * direction
            strength[lit] *= _visible(starts[:, lit], lambda points: points + far, casters)
        return strength * column(self.intensity)


@dataclass(frozen=True)
class Ambient:
    """Light that comes from everywhere, a little more from above than from below."""

    intensity: Vector
    """Mean irradiance per channel."""
    indirect: bool = True
    """See `Light`."""

    def irradiance(self, points: Array, normals: Array, casters: Sequence[Caster]) -> Array:
        """See `Light`."""
        return (1.0 - 0.35 * normals[1]) * column(self.intensity)


@dataclass(frozen=True, eq=False)
class Caster:
    """A shape that casts shadows, with its bounding box (computed once per rendering)."""

    shape: Shape
    """The shape."""
    low: Array
    """``(3, 1)``, smallest coordinates, metres."""
    high: Array
    """``(3, 1)``, largest coordinates, metres."""

    @classmethod
    def of(cls, shape: Shape) -> Caster:
        """Return the caster of a shape."""
        corners = shape.corners()
        if corners is None:
            corners = np.array([[-np.inf, np.inf]] * 3)
        return cls(shape, corners.min(axis=1, keepdims=True), corners.max(axis=1, keepdims=True))


def _visible(starts: Array, end_of: Callable[[Array], Array], casters: Sequence[Caster]) -> NDArray[np.bool_]:
    """Return whether nothing lies between each start ``(3, N)`` and its end ``end_of(start)``."""
    count = starts.shape[1]
    # Neighbouring starts form blocks with a bounding box. The segments of a block stay within its half extent of
    # the segment from the block's centre, so a caster can only hide one of them if that segment meets the
    # caster's bounding box grown by the half extent.
    blocks = -(-count // BLOCK)
    padded = np.pad(starts, ((0, 0), (0, blocks * BLOCK - count)), mode="edge").reshape(3, blocks, BLOCK)
    low, high = padded.min(axis=2), padded.max(axis=2)
    centre, half = (low + high) / 2, (high - low) / 2
    with np.errstate(divide="ignore"):
        inverse = 1.0 / (end_of(centre) - centre)
    visible = np.ones(blocks * BLOCK, bool)
    starts = padded.reshape(3, -1)
    within = np.arange(BLOCK)
    for caster in casters:
        with np.errstate(invalid="ignore"):
            near, far = _overlap((caster.low - half - centre) * inverse, (caster.high + half - centre) * inverse)
        reached = np.flatnonzero((near <= far) & (far >= 0.0) & (near <= 1.0))
        tested = (reached[:, None] * BLOCK + within).ravel()
        tested = tested[visible[tested]]
        if tested.size == 0:
            continue
        points = starts[:, tested]
        t = caster.shape.intersect(points, end_of(points) - points)
        visible[tested[t < 1.0]] = False
    return visible[:count]


# ---------------------------------------------------------------------------------------------------- rendering


@dataclass(frozen=True)
class Rig:
    """A rectified pair of pinhole cameras."""

    width: int
    """Columns."""
    height: int
    """Rows."""
    baseline: float
    """Distance of the cameras, metres."""
    supersampling: int
    """The radiance of a pixel is the mean over a grid of this many samples squared."""
    horizon: float = HORIZON_SHARE
    """Height of the eye level, share of the height from the top."""

    def __post_init__(self) -> None:
        whole = all(isinstance(n, int | np.integer) for n in (self.width, self.height, self.supersampling))
        if not whole:
            raise InputError("the size and the supersampling of a scene must be whole numbers")
        if self.width < 1 or self.height < 1:
            raise InputError(f"a scene must be at least 1x1 pixel, got {self.width}x{self.height}")
        if not 0 < self.baseline <= 0.5:
            raise InputError(f"the baseline must be above 0, at most 0.5 m, got {self.baseline}")
        if not 1 <= self.supersampling <= 8:
            raise InputError(f"supersampling must be 1 to 8, got {self.supersampling}")

    @property
    def focal(self) -> float:
        """Focal length in pixels: a 4:3 part of the image always shows the whole composition."""
        return FOCAL_SHARE * min(self.width, self.height * 4 / 3)

    def eye(self, side: int) -> float:
        """Return the x coordinate of a camera: -1 left, +1 right."""
        return side * self.baseline / 2

    def u(self, x: Array) -> Array:
        """Return x / z of the rays through image column x (pixel centres are integers)."""
        return (x - (self.width - 1) / 2) / self.focal

    def v(self, y: Array) -> Array:
        """Return y / z of the rays through image row y."""
        return (y + 0.5 - self.horizon * self.height) / self.focal

    def disparity(self, depth: Array) -> Array:
        """Return the disparity in pixels of points at this depth z in metres; 0 at infinity."""
        return self.focal * self.baseline / depth


def _directions(u: Array, v: Array) -> Array:
    """Return the directions ``(u, v, 1)``, ``(3, R C)``, of a grid of rays: u is ``(R, C)``, v is ``(R,)``."""
    return np.stack([u.ravel(), np.repeat(v, u.shape[1]), np.ones(u.size)])


def _cast(surfaces: Sequence[Surface], eye: float, u: Array, v: Array) -> tuple[Array, NDArray[np.intp]]:
    """Follow the rays ``(u, v, 1)`` from ``(eye, 0, 0)`` to the first surface.

    Parameters
    ----------
    surfaces
        What can be hit.
    eye
        x of the camera, metres.
    u
        ``(R, C)``, slopes of the rays; any values.
    v
        ``(R,)``, ascending: all rays of a row share it.

    Returns
    -------
    Depth z in metres (inf where nothing is hit) and index of the surface (-1), both ``(R, C)``.
    """
    columns = u.shape[1]
    depth = np.full(u.size, np.inf)
    index = np.full(u.size, -1, np.intp)
    start = column((eye, 0.0, 0.0))
    directions = _directions(u, v)
    for number, surface in enumerate(surfaces):
        u0, u1, v0, v1 = _screen_bounds(surface.shape, eye)
        first = columns * np.searchsorted(v, v0, side="left")
        last = columns * np.searchsorted(v, v1, side="right")
        slopes = directions[0, first:last]
        rays = first + np.flatnonzero((slopes >= u0) & (slopes <= u1))
        if rays.size == 0:
            continue
        t = surface.shape.intersect(start, directions[:, rays])
        closer = t < depth[rays]
        depth[rays[closer]] = t[closer]
        index[rays[closer]] = number
    return depth.reshape(u.shape), index.reshape(u.shape)


def _shade(
    surfaces: Sequence[Surface],
    lights: Sequence[Light],
    casters: Sequence[Caster],
    points: Array,
    directions: Array,
    index: NDArray[np.intp],
    pixel: Array,
) -> Array:
    """Return the radiance ``(3, N)`` of the surfaces' points; `pixel` is the size of a pixel there, metres."""
    assert (index >= 0).all(), "a scene must enclose its cameras"
    # Sorted by surface: each surface is one slice, and neighbours in the array are neighbours in space.
    order = np.argsort(index, kind="stable")
    points, directions, pixel = points[:, order], directions[:, order], pixel[order]
    numbers, first = np.unique(index[order], return_index=True)
    albedo, emission, normals = (np.zeros(points.shape) for _ in range(3))
    openness = np.ones(index.size)
    for number, start, stop in zip(numbers, first, [*first[1:], index.size], strict=True):
        surface, here = surfaces[number], slice(start, stop)
        albedo[:, here] = surface.albedo(points[:, here], pixel[here])
        normals[:, here] = surface.shape.normal(points[:, here])
        openness[here] = surface.openness
        if surface.emission is not None:
            emission[:, here] = surface.emission(points[:, here], pixel[here])
    normals = np.where(_dot(normals, directions) > 0, -normals, normals)  # both sides of a sheet are lit alike
    irradiance = np.zeros(points.shape)
    for light in lights:
        contribution = light.irradiance(points, normals, casters)
        irradiance += openness * contribution if light.indirect else contribution
    radiance = np.empty(points.shape)
    radiance[:, order] = emission + albedo * irradiance / math.pi
    return radiance


def render_radiance(
    surfaces: Sequence[Surface], lights: Sequence[Light], rig: Rig, side: int
) -> NDArray[np.float32]:
    """Return the radiance ``(H, W, 3)`` of one view, averaged over each pixel."""
    casters = [Caster.of(surface.shape) for surface in surfaces if surface.casts_shadow]
    s = rig.supersampling
    within = (np.arange(s) + 0.5) / s - 0.5
    u = rig.u((np.arange(rig.width)[:, None] + within).ravel())
    image = np.empty((rig.height, rig.width, 3), np.float32)
    rows_at_once = max(1, CHUNK // (rig.width * s * s))
    for top in range(0, rig.height, rows_at_once):
        rows = np.arange(top, min(top + rows_at_once, rig.height))
        v = rig.v((rows[:, None] + within).ravel())
        grid_u = np.broadcast_to(u, (v.size, u.size))
        depth, index = _cast(surfaces, rig.eye(side), grid_u, v)
        directions = _directions(grid_u, v)
        points = column((rig.eye(side), 0.0, 0.0)) + depth.ravel() * directions
        pixel = depth.ravel() / rig.focal
        radiance = _shade(surfaces, lights, casters, points, directions, index.ravel(), pixel)
        samples = radiance.reshape(3, rows.size, s, rig.width, s)
        image[rows] = samples.mean(axis=(2, 4)).transpose(1, 2, 0)
    return image


def exact_disparity(surfaces: Sequence[Surface], rig: Rig, side: int) -> Disparity:
    """Return the disparity at the pixel centres of one view, and whether the other view sees the point."""
    x = np.arange(rig.width, dtype=np.float64)
    v = rig.v(np.arange(rig.height, dtype=np.float64))
    u = np.broadcast_to(rig.u(x), (rig.height, rig.width))
    depth, _ = _cast(surfaces, rig.eye(side), u, v)
    disparity = rig.disparity(depth)
    there = x + side * disparity  # left (-1): x_right = x_left - d
    depth_there, _ = _cast(surfaces, rig.eye(-side), rig.u(there), v)
    hidden = depth_there < depth * (1.0 - SAME_DEPTH)
    outside = (there < -0.5) | (there >= rig.width - 0.5)
    flags = np.where(hidden | outside, DisparityFlag.OCCLUDED, DisparityFlag.MATCHED)
    return Disparity(values=disparity.astype(np.float32), flags=flags.astype(np.uint8))
