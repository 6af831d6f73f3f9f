"""Procedural stereo scenes with exact ground truth, by analytic ray casting.

A scene is a list of `Surface` (a shape and what it is made of) and a list of lights, seen by a rectified pair of
pinhole cameras (`Rig`). Every shape is intersected in closed form, so the disparity of a pixel is exact, and
whether the other camera sees the same point is decided by casting the other camera's ray. Surfaces are
Lambertian: a point has the same radiance in both views.

World coordinates are metres, x right, y down, z forward; the eye level is y = 0 and the two cameras sit at
``x = -baseline / 2`` and ``x = +baseline / 2``, both at z = 0. The disparity of a point is
``d = focal * baseline / z``, and ``x_left = x_right + d``.

Arrays of points and vectors are ``(3, N)`` float64 in this module: one contiguous row per coordinate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
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

DEFAULT_BASELINE = 0.145
"""Distance of the cameras in metres."""
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


# ---------------------------------------------------------------------------------------------------- vectors


def _dot(a: Vector | Array, b: Vector | Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _column(vector: Vector | Array) -> Array:
    return np.array(vector, np.float64)[:, None]


def _unit(vector: Vector | Array) -> Vector:
    x, y, z = (float(component) for component in vector)
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)


def _along(start: Array, direction: Array, t: Array) -> Array:
    return start + t * direction


# ----------------------------------------------------------------------------------------------------- shapes


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
        return np.broadcast_to(_column(_unit(self.facing)), points.shape)

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
        offset = _along(start, direction, t) - _column(self.corner)
        u = _dot(offset, self.edge_u) / _dot(self.edge_u, self.edge_u)
        v = _dot(offset, self.edge_v) / _dot(self.edge_v, self.edge_v)
        hit = (t > 0) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        if self.hole is not None:
            u0, v0, u1, v1 = self.hole
            hit &= ~((u > u0) & (u < u1) & (v > v0) & (v < v1))
        return np.where(hit, t, np.inf)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        return np.broadcast_to(_column(_unit(np.cross(self.edge_u, self.edge_v))), points.shape)

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

    def _to_local(self, vectors: Array) -> Array:
        if self.turn == 0.0:
            return vectors
        cosine, sine = math.cos(math.radians(self.turn)), math.sin(math.radians(self.turn))
        x, y, z = vectors
        return np.stack([cosine * x - sine * z, y, sine * x + cosine * z])

    def _to_world(self, vectors: Array) -> Array:
        return Box(self.centre, self.size, -self.turn)._to_local(vectors)

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        local_start = self._to_local(start - _column(self.centre))
        local_direction = self._to_local(direction)
        half = _column(self.size) / 2
        # A ray parallel to a face divides by zero to +-inf, which compares as it should.
        with np.errstate(divide="ignore", invalid="ignore"):
            one = (-half - local_start) / local_direction
            two = (half - local_start) / local_direction
        near, far = _overlap(one, two)
        t = np.where(near > NEAREST_HIT, near, far)
        return np.where((near <= far) & (t > NEAREST_HIT), t, np.inf)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        local = self._to_local(points - _column(self.centre)) / _column(self.size)
        face = np.abs(local).argmax(axis=0)
        normals = np.zeros(points.shape)
        column = np.arange(points.shape[1])
        normals[face, column] = np.sign(local[face, column])
        return self._to_world(normals)

    def corners(self) -> Array:
        """See `Shape`."""
        return self._to_world(_CUBE * _column(self.size)) + _column(self.centre)


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid along the axes."""

    centre: Vector
    """Metres."""
    radii: Vector
    """Half axes, metres."""

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        w = (start - _column(self.centre)) / _column(self.radii)
        d = direction / _column(self.radii)
        t, other = _quadratic_roots(_dot(d, d), _dot(w, d), _dot(w, w) - 1.0)
        t = np.where(t > NEAREST_HIT, t, other)
        return np.where(t > NEAREST_HIT, t, np.inf)

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        gradient = (points - _column(self.centre)) / _column(self.radii) ** 2
        return gradient / np.sqrt(_dot(gradient, gradient))

    def corners(self) -> Array:
        """See `Shape`."""
        x, y, z = self.radii
        return Box(self.centre, (2 * x, 2 * y, 2 * z)).corners()


def _ball(centre: Vector, radius: float) -> Ellipsoid:
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
        return _unit(offset), length, (self.radius_end - self.radius_start) / length

    def intersect(self, start: Array, direction: Array) -> Array:
        """See `Shape`."""
        axis, length, slope = self._axis()
        # Rays are followed from the point closest to the cone: thin poles far away would lose their radius in
        # the differences of large squares otherwise.
        skip = _dot(_column(np.add(self.start, self.end) / 2) - start, direction) / _dot(direction, direction)
        w = _along(start, direction, skip) - _column(self.start)
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
                    across = w + np.where(np.isfinite(t), t, 0.0) * direction - h * _column(axis)
                hit = (_dot(across, across) <= radius**2) & (t + skip > NEAREST_HIT)
                best = np.where(hit & (t < best), t, best)
        return best + skip

    def normal(self, points: Array) -> Array:
        """See `Shape`."""
        axis, length, slope = self._axis()
        w = points - _column(self.start)
        height = _dot(w, axis)
        across = w - height * _column(axis)
        side = across / np.sqrt(np.maximum(_dot(across, across), 1e-30)) - slope * _column(axis)
        on_cap = self.capped & ((height < 1e-7) | (height > length - 1e-7))
        return np.where(on_cap, _column(axis), side / math.sqrt(1.0 + slope**2))

    def corners(self) -> Array:
        """See `Shape`."""
        ends = [_ball(self.start, self.radius_start), _ball(self.end, self.radius_end)]
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


# --------------------------------------------------------------------------------------- surfaces and lights


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
        towards = _column(self.position) - points
        squared = np.maximum(_dot(towards, towards), 1e-4)  # 1 cm: no pole where a light touches a surface
        strength = np.maximum(_dot(towards, normals), 0.0) / (squared * np.sqrt(squared))
        if self.facing is not None:
            strength *= np.maximum(-_dot(towards, _unit(self.facing)), 0.0) / np.sqrt(squared)
        lit = np.flatnonzero(strength > 0)
        if not self.indirect and lit.size:
            starts = points[:, lit] + SHADOW_OFFSET * normals[:, lit]
            strength[lit] *= _visible(starts, lambda _: _column(self.position), casters)
        return strength * _column(self.intensity)


@dataclass(frozen=True)
class SunBeam:
    """Sunlight, which enters through an opening or lights everything."""

    towards: Vector
    """Direction to the sun, any length."""
    intensity: Vector
    """Irradiance per channel on a surface that faces the sun."""
    opening: Rectangle | None = None
    """The window through which it comes; None: there is no wall."""
    indirect: bool = False
    """See `Light`."""

    def irradiance(self, points: Array, normals: Array, casters: Sequence[Caster]) -> Array:
        """See `Light`."""
        direction = _column(_unit(self.towards))
        strength = np.maximum(_dot(direction, normals), 0.0)
        starts = points + SHADOW_OFFSET * normals
        if self.opening is not None:
            strength = np.where(np.isfinite(self.opening.intersect(starts, direction)), strength, 0.0)
        lit = np.flatnonzero(strength > 0)
        if lit.size:
            far = 100.0 * direction
            strength[lit] *= _visible(starts[:, lit], lambda points: points + far, casters)
        return strength * _column(self.intensity)


@dataclass(frozen=True)
class Ambient:
    """Light that comes from everywhere, a little more from above than from below."""

    intensity: Vector
    """Mean irradiance per channel."""
    indirect: bool = True
    """See `Light`."""

    def irradiance(self, points: Array, normals: Array, casters: Sequence[Caster]) -> Array:
        """See `Light`."""
        return (1.0 - 0.35 * normals[1]) * _column(self.intensity)


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


# -------------------------------------------------------------------------------------------------- rendering


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
    start = np.array([[eye], [0.0], [0.0]])
    flat_u = u.ravel()
    directions = np.stack([flat_u, np.repeat(v, columns), np.ones(u.size)])
    for number, surface in enumerate(surfaces):
        u0, u1, v0, v1 = _screen_bounds(surface.shape, eye)
        first = columns * np.searchsorted(v, v0, side="left")
        last = columns * np.searchsorted(v, v1, side="right")
        rows = flat_u[first:last]
        rays = first + np.flatnonzero((rows >= u0) & (rows <= u1))
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


def _render_radiance(
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
        directions = np.stack([grid_u.ravel(), np.repeat(v, u.size), np.ones(grid_u.size)])
        flat_depth = depth.ravel()
        points = np.array([[rig.eye(side)], [0.0], [0.0]]) + flat_depth * directions
        pixel = flat_depth / rig.focal
        radiance = _shade(surfaces, lights, casters, points, directions, index.ravel(), pixel)
        samples = radiance.reshape(3, rows.size, s, rig.width, s)
        image[rows] = samples.mean(axis=(2, 4)).transpose(1, 2, 0)
    return image


def _exact_disparity(surfaces: Sequence[Surface], rig: Rig, side: int) -> Disparity:
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


def _render(name: str, surfaces: Sequence[Surface], lights: Sequence[Light], rig: Rig) -> StereoScene:
    left, right = (_exact_disparity(surfaces, rig, side) for side in (-1, 1))
    return StereoScene(
        radiance_left=_render_radiance(surfaces, lights, rig, -1),
        radiance_right=_render_radiance(surfaces, lights, rig, 1),
        disparity_left=left,
        disparity_right=right,
        name=name,
        max_disparity=math.ceil(max(left.values.max(), right.values.max())),
    )


# --------------------------------------------------------------------------------------------------- textures

_LATTICE = np.random.default_rng(20170621).random((64, 64))
"""Random numbers in 0..1 at the integer points of a plane that repeats every 64."""


def _at_lattice(column: Array, row: Array) -> Array:
    return _LATTICE[row.astype(np.int64) % 64, column.astype(np.int64) % 64]


def _noise(x: Array, y: Array, pixel: Array | float = 0.0) -> Array:
    """Return smooth noise in 0..1 with features of size 1; fades to 0.5 as a pixel grows to that size."""
    column, row = np.floor(x), np.floor(y)
    fx, fy = x - column, y - row
    fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
    top = _at_lattice(column, row) * (1 - fx) + _at_lattice(column + 1, row) * fx
    bottom = _at_lattice(column, row + 1) * (1 - fx) + _at_lattice(column + 1, row + 1) * fx
    value = top * (1 - fy) + bottom * fy
    return 0.5 + (value - 0.5) * np.clip(1.6 - 2.0 * np.asarray(pixel), 0.0, 1.0)


def _cloudy(x: Array, y: Array, pixel: Array | float = 0.0) -> Array:
    """Return noise of three octaves in 0..1."""
    pixel = np.asarray(pixel)
    octaves = (_noise(f * x + 17 * f, f * y + 5 * f, f * pixel) / f for f in (1.0, 2.0, 4.0))
    return sum(octaves, np.zeros(())) / 1.75


def _lines(x: Array, period: float, width: float, pixel: Array) -> Array:
    """Return the share of a pixel covered by lines of this width around the multiples of `period`."""
    distance = np.abs((x / period + 0.5) % 1.0 - 0.5) * period
    drawn = np.maximum(width, pixel)
    return np.clip((drawn / 2 - distance) / pixel + 0.5, 0.0, 1.0) * np.minimum(width / pixel, 1.0)


def _inside(distance: Array, pixel: Array) -> Array:
    """Return the share of a pixel inside a border; `distance` to it in metres, negative inside."""
    return np.clip(0.5 - distance / pixel, 0.0, 1.0)


def _mix(a: Vector | Array, b: Vector | Array, share: Array) -> Array:
    """Return ``a`` where share is 0, ``b`` where it is 1, ``(3, N)``."""
    first = _column(a) if isinstance(a, tuple) else a
    second = _column(b) if isinstance(b, tuple) else b
    return first + (second - first) * share


def _plain(colour: Vector) -> Texture:
    return lambda points, pixel: np.broadcast_to(_column(colour), points.shape)


def _plaster(points: Array, pixel: Array) -> Array:
    """White paint with a hardly visible unevenness: nothing for a matcher to hold on to."""
    x, y, z = points
    return 0.72 * (1.0 + 0.015 * (_noise(1.3 * (x + z), 1.3 * y, 1.3 * pixel) - 0.5)) * _column((1.0, 0.97, 0.9))


def _wallpaper(points: Array, pixel: Array) -> Array:
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


def _planks(points: Array, pixel: Array) -> Array:
    """Floor boards that run along z, with grain and dark joints."""
    x, y, z = points
    along = pixel * z / np.maximum(np.abs(y), 0.1)  # the floor is seen at a grazing angle
    board = np.floor(x / 0.16)
    shifted = z + 3.0 * _at_lattice(board, 0 * board + 7)
    piece = np.floor(shifted / 1.5)
    tone = 0.75 + 0.5 * _at_lattice(board + 11, piece)
    grain = 0.8 + 0.4 * _noise(45 * x, 2.2 * shifted + 9 * board, np.maximum(45 * pixel, 2.2 * along))
    knots = 0.75 + 0.5 * _noise(7 * x + 3 * board, 1.1 * shifted, np.maximum(7 * pixel, 1.1 * along))
    joints = np.maximum(_lines(x, 0.16, 0.008, pixel), _lines(shifted, 1.5, 0.008, along))
    return _mix((0.40, 0.235, 0.125), (0.05, 0.03, 0.02), 0.85 * joints) * tone * grain * knots


def _bricks(points: Array, pixel: Array) -> Array:
    """A brick wall along z, in running bond."""
    x, y, z = points
    along = pixel * z / np.maximum(np.abs(x), 0.1)
    course = np.floor(y / 0.10)
    shifted = z + 0.14 * (course % 2)
    brick = np.floor(shifted / 0.28)
    tone = 0.65 + 0.7 * _at_lattice(brick, course)
    colour = _mix((0.38, 0.15, 0.10), (0.45, 0.24, 0.15), _at_lattice(brick + 5, course + 9))
    colour = colour * tone * (0.8 + 0.4 * _noise(30 * z, 30 * y, 30 * along))
    mortar = np.maximum(_lines(y, 0.10, 0.014, pixel), _lines(shifted, 0.28, 0.014, along))
    return _mix(colour, (0.55, 0.52, 0.47), mortar)


def _wood(dark: Vector, light: Vector, along: int) -> Texture:
    """Return wood whose grain runs along one axis (0 x, 1 y, 2 z)."""

    def texture(points: Array, pixel: Array) -> Array:
        along_grain = points[along]
        one, two = (points[axis] for axis in range(3) if axis != along)
        bent = one + two + 0.03 * _noise(2.0 * along_grain, 3.0 * (one + two), 3.0 * pixel)
        rings = _noise(26 * bent, 1.6 * along_grain, 26 * pixel)
        fibres = _noise(90 * (one - two), 5 * along_grain, 90 * pixel)
        return _mix(dark, light, 0.7 * rings + 0.3 * fibres)

    return texture


def _landscape(corner: Vector, width: float, height: float) -> Texture:
    """Return a painting: a sun above two ridges and a lake, on a canvas that faces the room."""

    def texture(points: Array, pixel: Array) -> Array:
        x, y = (points[0] - corner[0]) / width, (points[1] - corner[1]) / height
        size = pixel / height
        paint = _mix((0.20, 0.38, 0.62), (0.85, 0.66, 0.42), np.clip(y / 0.6, 0, 1))
        sun = np.hypot((x - 0.68) * width / height, y - 0.3) - 0.11
        paint = _mix(paint, (0.9, 0.75, 0.25), _inside(sun, size))
        far_ridge = 0.52 - 0.22 * _noise(4.2 * x + 3, 0 * x + 0.5)
        paint = _mix(paint, (0.25, 0.27, 0.42), _inside(far_ridge - y, size))
        near_ridge = 0.62 - 0.14 * _noise(6.0 * x + 21, 0 * x + 8.5)
        paint = _mix(paint, (0.12, 0.22, 0.12), _inside(near_ridge - y, size))
        lake = 0.7 + 0.6 * _noise(5 * x, 40 * y, 40 * size)
        return _mix(paint, _column((0.14, 0.30, 0.42)) * lake, _inside(0.72 - y, size))

    return texture


def _banded(colours: Sequence[Vector], axis: int, origin: float, period: float) -> Texture:
    """Return soft-edged bands of colours in turn along one axis."""

    def texture(points: Array, pixel: Array) -> Array:
        position = (points[axis] - origin) / period
        band = np.floor(position)
        palette = np.array(colours).T
        this, following = (palette[:, (band + k).astype(np.int64) % len(colours)] for k in (0, 1))
        return _mix(this, following, _inside((band + 1 - position) * period - pixel / 2, pixel))

    return texture


def _ribboned(centre: Vector, paper: Vector, ribbon: Vector, width: float) -> Texture:
    """Return gift wrapping: dotted paper with a ribbon across each face through the centre."""

    def texture(points: Array, pixel: Array) -> Array:
        x, y, z = points - _column(centre)
        dots = np.hypot(_wrap(x + z, 0.03), _wrap(y - 0.4 * z, 0.03)) - 0.006
        colour = _mix(paper, (0.85, 0.85, 0.8), _inside(dots, pixel))
        cross = np.minimum(np.abs(x), np.abs(z)) - width / 2
        return _mix(colour, ribbon, _inside(cross, pixel))

    return texture


def _wrap(x: Array, period: float) -> Array:
    return x - period * np.round(x / period)


def _outside(scale: float) -> Texture:
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
        hedge_top = 1.0 - 0.9 * _noise(0.9 * x, 0 * x + 3.5, 0.9 * pixel)
        leaves = _column((0.12, 0.30, 0.06)) * (0.5 + _cloudy(3 * x, 3 * y, 3 * pixel))
        return scale * _mix(view, leaves, _inside(hedge_top - y, pixel))

    return texture


# ------------------------------------------------------------------------------------------------------- room

_LEFT, _RIGHT, _CEILING, _FLOOR, _BACK = -1.75, 2.0, -1.35, 1.2, 5.0
"""The walls of the room, metres."""
_WINDOW = (-1.35, -1.0, -0.05, 0.25)
"""Left, top, right, bottom of the window in the back wall, metres."""
_TABLE = 0.53
"""Height of the table top (y), metres."""
_BULB: Vector = (0.36, 0.09, 1.38)
"""Centre of the lamp's bulb."""

_PAINT = _plain((0.75, 0.74, 0.70))
_BRASS = _plain((0.42, 0.33, 0.16))
_DARK_METAL = _plain((0.06, 0.06, 0.065))


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
        *_table_and_things(),
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
        (Rectangle((_LEFT, _CEILING, _BACK), (width, 0.0, 0.0), down, hole), _wallpaper),
        (Rectangle((_LEFT, _CEILING, _BACK + lap), down, backwards), _plaster),
        (Rectangle((_RIGHT, _CEILING, _BACK + lap), down, backwards), _bricks),
        (Rectangle((_LEFT - lap, _CEILING, _BACK + lap), across, backwards), _plain((0.8, 0.79, 0.76))),
        (Rectangle((_LEFT - lap, _FLOOR, _BACK + lap), across, backwards), _planks),
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
        Surface(canvas, _landscape(picture, 0.66, 0.48), casts_shadow=False),
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
        Surface(backdrop, _plain((0.0, 0.0, 0.0)), emission=_outside(22.0), casts_shadow=False),
        *_plant((right - 0.22, bottom, _BACK - 0.08), 0.34),
    ]


def _plant(foot: Vector, height: float) -> list[Surface]:
    """Return a pot with thin stems that end in leaves."""
    x, y, z = foot
    rim = (x, y - 0.30 * height, z)
    surfaces = [
        Surface(Cone(foot, rim, 0.13 * height, 0.19 * height), _plain((0.50, 0.22, 0.13))),
    ]
    for number in range(6):
        angle = 2.4 * number
        lean = 0.12 + 0.035 * number
        tip = (
            x + height * lean * math.cos(angle),
            y - height * (1.02 - 0.07 * (number % 4)),
            z + 0.4 * height * lean * math.sin(angle),
        )
        surfaces.append(Surface(Cone(rim, tip, 0.006, 0.004), _plain((0.10, 0.22, 0.05))))
        leaf = Ellipsoid(tip, (0.11 * height, 0.05 * height, 0.05 * height))
        surfaces.append(Surface(leaf, _plain((0.09, 0.28, 0.06))))
    return surfaces


def _cupboard() -> list[Surface]:
    """Return a tall cupboard without a door; what stands in it is deep in shadow."""
    left, right, top, front, back = 1.08, 1.96, -0.75, 4.30, 4.98
    wood = _wood((0.16, 0.085, 0.045), (0.34, 0.20, 0.11), along=1)
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
        *(Surface(shape, wood) for shape in outer),
        *(Surface(shape, wood, openness=inside, casts_shadow=False) for shape in contents),
    ]
    spines = ((0.45, 0.10, 0.08), (0.10, 0.22, 0.40), (0.50, 0.42, 0.20), (0.10, 0.30, 0.16), (0.6, 0.58, 0.5))
    things: list[tuple[Shape, Texture]] = []
    x = left + thick + 0.04
    for number in range(9):  # books
        thickness = 0.035 + 0.012 * ((5 * number) % 4)
        tall = 0.24 + 0.03 * ((3 * number) % 4)
        low, high = (x, heights[0] - tall, front + 0.12), (x + thickness, heights[0], front + 0.34)
        things.append((Box.between(low, high), _plain(spines[number % 5])))
        x += thickness + 0.006
    jug: Vector = (left + 0.24, heights[1], front + 0.25)
    shoulder: Vector = (jug[0], heights[1] - 0.20, jug[2])
    neck: Vector = (jug[0], heights[1] - 0.32, jug[2])
    cardboard = _banded(((0.5, 0.45, 0.3), (0.25, 0.2, 0.14)), axis=0, origin=0.0, period=0.06)
    things += [
        (Cone(jug, shoulder, 0.06, 0.12), _plain((0.6, 0.6, 0.62))),
        (Cone(shoulder, neck, 0.12, 0.045), _plain((0.6, 0.6, 0.62))),
        (_ball((left + 0.62, heights[1] - 0.12, front + 0.28), 0.12), _plain((0.55, 0.16, 0.08))),
        (Box((left + 0.32, heights[2] - 0.12, front + 0.30), (0.34, 0.24, 0.26), 14.0), cardboard),
        (_ball((left + 0.66, heights[2] - 0.09, front + 0.2), 0.09), _plain((0.12, 0.3, 0.42))),
    ]
    surfaces += [Surface(shape, texture, openness=2 * inside, casts_shadow=False) for shape, texture in things]
    return surfaces


def _chair(foot: Vector, turn: float) -> list[Surface]:
    """Return a chair with thin legs that stands on `foot`, turned by so many degrees."""
    wood = _wood((0.33, 0.20, 0.10), (0.55, 0.38, 0.22), along=1)
    cosine, sine = math.cos(math.radians(turn)), math.sin(math.radians(turn))

    def place(x: float, up: float, z: float) -> Vector:
        return (foot[0] + cosine * x + sine * z, foot[1] - up, foot[2] - sine * x + cosine * z)

    half, seat, top = 0.19, 0.45, 0.95
    shapes: list[Shape] = [Box(place(0, seat, 0), (2 * half + 0.04, 0.03, 2 * half + 0.04), turn)]
    shapes += [Cone(place(x, 0, -half), place(x, seat, -half), 0.010, 0.013) for x in (-half, half)]
    shapes += [Cone(place(x, 0, half), place(x, top, half), 0.010, 0.012) for x in (-half, half)]
    shapes += [Cone(place(-half, up, half), place(half, up, half), 0.011, 0.011) for up in (0.6, 0.93)]
    shapes += [Cone(place(x, 0.6, half), place(x, 0.93, half), 0.006, 0.006) for x in (-0.1, 0.0, 0.1)]
    return [Surface(shape, wood) for shape in shapes]


def _table_and_things() -> list[Surface]:
    """Return the table in the foreground with a ball, a gift, a vase with flowers and a mug of pencils."""
    wood = _wood((0.27, 0.14, 0.07), (0.50, 0.30, 0.16), along=0)
    board = Box.between((-0.32, _TABLE, 0.55), (1.30, _TABLE + 0.035, 1.92))
    legs = [Box.between((x, _TABLE + 0.03, 1.82), (x + 0.05, _FLOOR, 1.87)) for x in (-0.28, 1.2)]
    surfaces = [Surface(shape, wood) for shape in (board, *legs)]

    stripes = _banded(((0.70, 0.12, 0.08), (0.80, 0.76, 0.68)), axis=0, origin=0.06, period=0.045)
    surfaces.append(Surface(_ball((0.15, _TABLE - 0.085, 1.45), 0.085), stripes))
    gift: Vector = (0.42, _TABLE - 0.055, 1.16)
    wrapping = _ribboned(gift, (0.10, 0.22, 0.52), (0.80, 0.62, 0.15), 0.026)
    surfaces.append(Surface(Box(gift, (0.17, 0.11, 0.14), -24.0), wrapping))

    x, z = -0.13, 1.62
    profile = ((0.0, 0.045), (0.05, 0.075), (0.12, 0.082), (0.18, 0.05), (0.22, 0.026), (0.25, 0.038))
    glaze = _banded(((0.10, 0.30, 0.36), (0.62, 0.60, 0.52), (0.07, 0.20, 0.26)), 1, _TABLE, 0.042)
    for (low, wide), (high, narrow) in pairwise(profile):
        piece = Cone((x, _TABLE - low, z), (x, _TABLE - high, z), wide, narrow, capped=False)
        surfaces.append(Surface(piece, glaze))
    mouth: Vector = (x, _TABLE - 0.24, z)
    flowers = ((-0.10, 0.24, 0.02), (0.01, 0.30, -0.02), (0.09, 0.22, 0.03))
    petals = ((0.78, 0.60, 0.10), (0.75, 0.20, 0.25), (0.8, 0.75, 0.7))
    for (dx, up, dz), petal in zip(flowers, petals, strict=True):
        tip: Vector = (x + dx, mouth[1] - up, z + dz)
        surfaces.append(Surface(Cone(mouth, tip, 0.0035, 0.0035), _plain((0.12, 0.26, 0.07))))
        surfaces.append(Surface(Ellipsoid(tip, (0.034, 0.026, 0.034)), _plain(petal)))
        surfaces.append(Surface(_ball((tip[0], tip[1], tip[2] - 0.028), 0.012), _plain((0.16, 0.09, 0.04))))

    mug: Vector = (-0.07, _TABLE, 0.99)
    rim: Vector = (-0.07, _TABLE - 0.085, 0.99)
    surfaces.append(Surface(Cone(mug, rim, 0.032, 0.036, capped=False), _plain((0.62, 0.62, 0.58))))
    pencils = (
        ((-0.055, 0.19, -0.06), (0.75, 0.55, 0.06)),
        ((0.01, 0.21, 0.03), (0.60, 0.08, 0.07)),
        ((0.05, 0.18, -0.12), (0.08, 0.25, 0.55)),
    )
    for (dx, up, dz), colour in pencils:
        end: Vector = (mug[0] + dx, mug[1] - up, mug[2] + dz)
        surfaces.append(Surface(Cone((mug[0], mug[1] - 0.01, mug[2]), end, 0.0032, 0.0032), _plain(colour)))
    return surfaces


def _desk_lamp() -> list[Surface]:
    """Return a desk lamp on thin arms; its bulb looks out of the shade."""
    foot: Vector = (0.66, _TABLE, 1.62)
    elbow: Vector = (0.78, 0.16, 1.66)
    head: Vector = (0.46, -0.05, 1.45)
    axis = _unit(np.subtract(_BULB, head))
    rim = _moved(_BULB, axis, 0.012)
    top = _moved(rim, axis, -0.13)
    knob = _moved(top, axis, -0.03)
    green = _plain((0.05, 0.22, 0.13))
    shapes: list[Shape] = [
        Cone(foot, (foot[0], foot[1] - 0.02, foot[2]), 0.075, 0.07),
        Cone(foot, elbow, 0.0045, 0.0045),
        _ball(elbow, 0.012),
        Cone(elbow, knob, 0.0045, 0.0045),
    ]
    glow = _plain((850.0, 570.0, 280.0))
    return [
        *(Surface(shape, _DARK_METAL) for shape in shapes),
        Surface(Cone(top, rim, 0.028, 0.085, capped=False), green),
        Surface(Cone(knob, top, 0.022, 0.030), green),
        Surface(_ball(_BULB, 0.028), _PAINT, emission=glow, casts_shadow=False),
    ]


def _moved(point: Vector, direction: Vector, distance: float) -> Vector:
    x, y, z = (p + distance * d for p, d in zip(point, direction, strict=True))
    return (x, y, z)


# --------------------------------------------------------------------------------------------------- street


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
        Surface(sky, _plain((0.0, 0.0, 0.0)), emission=_night_sky, casts_shadow=False),
        Surface(_ball((-6.0, -19.0, 80.0), 2.4), _plain((0.0, 0.0, 0.0)), emission=_plain((9.0, 8.6, 7.4))),
        Surface(Rectangle((-40.0, road, 0.0), (80.0, 0.0, 0.0), (0.0, 0.0, 90.0)), _cobbles),
    ]
    for side in (-1, 1):
        front = Rectangle((side * half, -6.4 + 0.9 * side, end), (0.0, 8.5, 0.0), (0.0, 0.0, -end))
        surfaces.append(Surface(front, _facade_albedo, emission=_lit_windows, casts_shadow=False))
        inner, outer = sorted((side * 1.9, side * half))
        pavement = Box.between((inner, kerb, 0.3), (outer, road, end))
        surfaces.append(Surface(pavement, _plain((0.22, 0.21, 0.20)), casts_shadow=False))
    gable = Rectangle((-half, -4.6, end), (2 * half, 0.0, 0.0), (0.0, 7.0, 0.0))
    surfaces.append(Surface(gable, _plain((0.30, 0.22, 0.16)), casts_shadow=False))

    lights: list[Light] = [Ambient((0.0035, 0.0040, 0.0060))]
    glow: Vector = (420.0, 270.0, 110.0)
    for x, z in ((-2.15, 5.2), (2.15, 9.0), (-2.15, 15.0), (2.15, 23.0)):
        surfaces.append(Surface(Cone((x, kerb, z), (x, -1.55, z), 0.035, 0.022), _DARK_METAL))
        surfaces.append(Surface(Cone((x, -1.83, z), (x, -1.95, z), 0.17, 0.05), _DARK_METAL))
        bulb: Vector = (x, -1.69, z)
        surfaces.append(Surface(_ball(bulb, 0.12), _PAINT, emission=_plain(glow), casts_shadow=False))
        lights.append(PointLight(bulb, (19.0, 12.2, 5.0)))
    for x in (-1.3, -0.45, 0.4, 1.25):  # bollards in front, joined by a bar
        surfaces.append(Surface(Cone((x, road, 2.1), (x, 0.55, 2.1), 0.035, 0.030), _PAINT))
        surfaces.append(Surface(_ball((x, 0.53, 2.1), 0.045), _plain((0.55, 0.08, 0.06))))
    surfaces.append(Surface(Cone((-1.3, 0.72, 2.1), (1.25, 0.72, 2.1), 0.007, 0.007), _DARK_METAL))
    surfaces += _parked_car((1.25, road, 6.4))
    return _render("street_night", surfaces, lights, Rig(width, height, baseline, supersampling))


def _parked_car(foot: Vector) -> list[Surface]:
    x, y, z = foot
    paint, glass, rubber = _plain((0.30, 0.05, 0.05)), _plain((0.03, 0.035, 0.04)), _plain((0.02, 0.02, 0.02))
    shapes: list[tuple[Shape, Texture]] = [
        (Box((x, y - 0.55, z), (1.35, 0.55, 3.4)), paint),
        (Ellipsoid((x, y - 0.85, z + 0.2), (0.62, 0.55, 1.3)), glass),
    ]
    for dx, dz in ((-0.62, -1.05), (0.62, -1.05), (-0.62, 1.05), (0.62, 1.05)):
        wheel = Cone((x + dx - 0.09, y - 0.3, z + dz), (x + dx + 0.09, y - 0.3, z + dz), 0.3, 0.3)
        shapes.append((wheel, rubber))
    lamps = [
        Surface(_ball((x + dx, y - 0.62, z - 1.7), 0.07), _PAINT, emission=_plain((14.0, 0.5, 0.3)))
        for dx in (-0.52, 0.52)
    ]
    return [*(Surface(shape, texture) for shape, texture in shapes), *lamps]


def _night_sky(points: Array, pixel: Array) -> Array:
    x, y, _ = points
    glow = np.clip(1.0 + y / 45.0, 0.0, 1.0)
    clouds = 0.6 + 0.8 * _cloudy(0.06 * x, 0.14 * y, 0.14 * pixel)
    return _mix((0.0007, 0.0011, 0.0026), (0.0060, 0.0055, 0.0060), glow) * clouds


def _cobbles(points: Array, pixel: Array) -> Array:
    x, y, z = points
    along = pixel * z / np.maximum(np.abs(y), 0.1)
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


def _facade_albedo(points: Array, pixel: Array) -> Array:
    x, y, z = points
    pane, _ = _facade_window(points, pixel)
    house = np.floor(z / 6.9 + 0.5)
    hue = _at_lattice(house + 2, 0 * house + np.where(x > 0, 31, 47))
    wall = _mix((0.42, 0.26, 0.16), (0.36, 0.35, 0.30), hue)
    wall = wall * (0.7 + 0.6 * _cloudy(2.4 * z, 2.4 * y, 2.4 * pixel * z / 3.6))
    wall = _mix(wall, (0.5, 0.47, 0.42), _lines(y + 2.2, 2.5, 0.12, pixel))
    return _mix(wall, (0.03, 0.035, 0.04), pane)


def _lit_windows(points: Array, pixel: Array) -> Array:
    pane, lot = _facade_window(points, pixel)
    curtain = 0.5 + 0.5 * _noise(9.0 * points[2], 0.6 * points[1], 9.0 * pixel * points[2] / 3.6)
    return _column((5.0, 3.1, 1.2)) * pane * (lot > 0.66) * curtain


# ------------------------------------------------------------------------------------------------ test scenes


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
    surfaces = [Surface(Plane((0.0, 0.0, 1.0), 8.0), _wallpaper, casts_shadow=False)]
    half_view = (width / 2) / rig.focal
    depths = (1.5, 4.0, 2.2, 3.0, 1.8, 5.0, 2.6)
    colours = ((0.6, 0.5, 0.1), (0.1, 0.2, 0.5), (0.7, 0.7, 0.65), (0.08, 0.08, 0.08))
    for number, z in enumerate(depths):
        x = z * half_view * (-0.78 + 0.26 * number)
        radius = 0.5 * (2.0 + 0.5 * (number % 3)) * z / rig.focal
        pole = Cone((x, -12.0, z), (x, 12.0, z), radius, radius)
        surfaces.append(Surface(pole, _plain(colours[number % len(colours)])))
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
    pixel_in_middle = baseline / middle  # Z / f
    picture = _patchwork(pixel_in_middle, width)
    surface = Surface(plane, _plain((0.0, 0.0, 0.0)), emission=picture, casts_shadow=False)
    return _render("slanted_plane", [surface], [], rig)


def _patchwork(unit: float, width: int) -> Texture:
    """Return blotches of colour and a grid of lines; `unit` is the size of a pixel in metres."""

    def texture(points: Array, pixel: Array) -> Array:
        x, y = points[0] / unit, points[1] / unit
        size = pixel / unit
        first, second = _cloudy(x / 18, y / 18, size / 18), _cloudy(x / 11 + 30, y / 11 + 9, size / 11)
        colour = _mix((0.10, 0.18, 0.35), (0.80, 0.55, 0.25), first) * (0.3 + 1.2 * second)
        grid = np.maximum(_lines(x, 36.0, 3.0, size), _lines(y, 36.0, 3.0, size))
        return _mix(colour, (0.75, 0.75, 0.7), 0.7 * grid) * 10.0 ** np.clip(2 * x / width, -1.5, 1.5)

    return texture


SCENES: Mapping[str, Callable[..., StereoScene]] = {
    "room": room,
    "street_night": street_night,
    "poles": poles,
    "slanted_plane": slanted_plane,
}
"""The scenes by name; every one takes width, height, and the keywords baseline and supersampling."""
