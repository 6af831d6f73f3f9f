"""Cameras with lenses: from pixels to viewing rays and back.

A ray is given by its slopes ``(X / Z, Y / Z)`` in the camera's frame: x right, y down, z forward.

References
----------
The three lens models are those of OpenCV, ROS and Kalibr: ``plumb-bob`` (Brown 1966; Kalibr's radtan),
``rational`` (the same with a denominator), ``fisheye`` (Kannala and Brandt 2006; "equidistant").
"""

from __future__ import annotations

import math
import typing
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError

LensModel = Literal["plumb-bob", "rational", "fisheye"]
"""How a lens distorts."""

COEFFICIENTS: dict[LensModel, int] = {"plumb-bob": 5, "rational": 8, "fisheye": 4}
"""Number of coefficients: k1 k2 p1 p2 k3; k1 k2 p1 p2 k3 k4 k5 k6; k1 k2 k3 k4. Missing ones are 0."""

WIDEST_RAY = math.radians(85.0)
"""Rays further off the axis have no place in a flat rectified picture."""

_STEPS = 500
"""Slopes at which a lens model is examined for folding back."""

_LARGEST_SLOPE = math.tan(WIDEST_RAY)

_CONVERGED = 1e-9
"""Largest error of an inverted distortion, in slopes: far below a thousandth of a pixel."""

_ITERATIONS = 50

_RADIAL_ITERATIONS = 2
"""From the table of a lens to its exact inverse."""

_STEP = 1e-6
"""Slopes, for derivatives."""


@dataclass(frozen=True, eq=False)
class CameraModel:
    """One camera: what pixel each viewing ray falls on.

    Parameters
    ----------
    matrix
        ``(3, 3)`` float64, ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, pixels.
    distortion
        Coefficients of the lens, see `COEFFICIENTS`; none is a lens without distortion.
    lens
        Lens model.
    size
        ``(width, height)`` of the images that the matrix is for, None when it is not known.

    Raises
    ------
    InputError
        No such lens model, too many coefficients, or a matrix that no camera has.
    """

    matrix: NDArray[np.float64]
    distortion: tuple[float, ...] = ()
    lens: LensModel = "plumb-bob"
    size: tuple[int, int] | None = None
    _reach: float = field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=np.float64)
        if self.lens not in typing.get_args(LensModel):
            raise InputError(f"the lens model must be plumb-bob, rational or fisheye, got {self.lens!r}")
        coefficients = tuple(float(value) for value in self.distortion)
        wanted = COEFFICIENTS[self.lens]
        if any(coefficients[wanted:]):
            raise InputError(
                f"a {self.lens} lens has {wanted} coefficients, got {len(coefficients)}; calibrate with one of "
                f"the models plumb-bob, rational and fisheye"
            )
        shape_is_right = matrix.shape == (3, 3) and np.isfinite(matrix).all()
        if not (
            shape_is_right
            and matrix[0, 0] > 0
            and matrix[1, 1] > 0
            and matrix[0, 1] == 0
            and (matrix[1:, 0] == 0).all()
            and matrix[2, 1] == 0
            and matrix[2, 2] == 1
        ):
            raise InputError(
                f"a camera matrix is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive focal lengths, "
                f"got {matrix.tolist()}"
            )
        if not all(math.isfinite(value) for value in coefficients):
            raise InputError(f"the lens coefficients must be finite, got {coefficients}")
        if self.size is not None and not all(isinstance(side, int) and side >= 1 for side in self.size):
            raise InputError(f"the image size must be two positive whole numbers, got {self.size}")
        matrix.flags.writeable = False
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", (*coefficients[:wanted], *(0.0,) * (wanted - len(coefficients))))
        object.__setattr__(self, "_reach", self._largest_slope())

    @property
    def focal(self) -> float:
        """Mean focal length, pixels."""
        return float(self.matrix[0, 0] + self.matrix[1, 1]) / 2

    def to_pixels(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pixels ``(..., 2)`` (x, y) float64 on which rays fall.

        Parameters
        ----------
        rays
            ``(..., 2)`` slopes. Rays that the lens model does not reach (where it folds back) give NaN.
        """
        focal, centre = self._focals, self.matrix[:2, 2]
        if not any(self.distortion):
            return rays * focal + centre
        reached = np.hypot(rays[..., 0], rays[..., 1]) <= self._reach
        bent = self._bend(np.where(reached[..., None], rays, 0.0))
        return np.where(reached[..., None], bent * focal + centre, np.nan)

    def to_rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the slopes ``(..., 2)`` float64 of the rays that fall on pixels ``(..., 2)``.

        Pixels on which no ray falls give NaN.
        """
        bent = (np.asarray(pixels, dtype=np.float64) - self.matrix[:2, 2]) / self._focals
        if not any(self.distortion):
            return bent
        rays = self._unbend_radially(bent)
        right, down = np.array([_STEP, 0.0]), np.array([0.0, _STEP])
        for _ in range(_ITERATIONS):  # Newton's method, one 2x2 system per point
            error = self._bend(rays) - bent
            if (np.abs(error) <= _CONVERGED / 10).all():
                break
            along_x = (self._bend(rays + right) - self._bend(rays - right)) / (2 * _STEP)
            along_y = (self._bend(rays + down) - self._bend(rays - down)) / (2 * _STEP)
            determinant = along_x[..., 0] * along_y[..., 1] - along_y[..., 0] * along_x[..., 1]
            safe = np.where(np.abs(determinant) > 1e-12, determinant, np.inf)
            rays = rays - np.stack(
                [
                    (along_y[..., 1] * error[..., 0] - along_y[..., 0] * error[..., 1]) / safe,
                    (along_x[..., 0] * error[..., 1] - along_x[..., 1] * error[..., 0]) / safe,
                ],
                axis=-1,
            )
        good = np.abs(self._bend(rays) - bent).max(axis=-1) <= _CONVERGED
        good &= np.hypot(rays[..., 0], rays[..., 1]) <= self._reach
        return np.where(good[..., None], rays, np.nan)

    @property
    def _focals(self) -> NDArray[np.float64]:
        return np.array([self.matrix[0, 0], self.matrix[1, 1]])

    def _bend(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return slopes after the lens."""
        x, y = rays[..., 0], rays[..., 1]
        slope = np.hypot(x, y)
        bent = self._radial(slope)[..., None] * rays
        if self.lens == "fisheye":
            return bent
        p1, p2 = self.distortion[2:4]
        square = slope * slope
        bent[..., 0] += 2 * p1 * x * y + p2 * (square + 2 * x * x)
        bent[..., 1] += p1 * (square + 2 * y * y) + 2 * p2 * x * y
        return bent

    def _radial(self, slope: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the factor by which the lens stretches a ray of this slope."""
        k = self.distortion
        if self.lens == "fisheye":
            angle = np.arctan(slope)
            square = angle * angle
            series = 1 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3])))
            ratio = np.divide(angle, slope, out=np.ones_like(slope), where=slope > 1e-12)
            return ratio * series
        square = slope * slope
        stretched = 1 + square * (k[0] + square * (k[1] + square * k[4]))
        if self.lens == "rational":
            stretched = stretched / (1 + square * (k[5] + square * (k[6] + square * k[7])))
        return stretched

    def _largest_slope(self) -> float:
        """Return the slope up to which rays further off the axis fall further from the centre."""
        angle = np.linspace(0.0, WIDEST_RAY, _STEPS)
        slope = np.tan(angle)
        with np.errstate(divide="ignore", invalid="ignore"):
            falls = np.diff(slope * self._radial(slope)) <= 0
        return float(slope[int(falls.argmax())]) if falls.any() else _LARGEST_SLOPE

    def _unbend_radially(self, bent: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return slopes before the lens, exactly but for decentring."""
        slope = np.tan(np.linspace(0.0, math.atan(self._reach), _STEPS))
        radius = np.hypot(bent[..., 0], bent[..., 1])
        before = np.interp(radius, slope * self._radial(slope), slope)
        for _ in range(_RADIAL_ITERATIONS):
            higher, lower = before + _STEP, before - _STEP
            rise = (higher * self._radial(higher) - lower * self._radial(lower)) / (2 * _STEP)
            error = before * self._radial(before) - radius
            before = before - np.divide(error, rise, out=np.zeros_like(rise), where=rise > 1e-3)
        stretch = np.divide(before, radius, out=np.ones_like(radius), where=radius > 1e-12)
        return bent * stretch[..., None]
