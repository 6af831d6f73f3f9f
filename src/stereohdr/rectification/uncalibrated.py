"""The geometry of a pair from nothing but its pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.rectification._opencv import load_opencv
from stereohdr.rectification.features import Matches
from stereohdr.rectification.geometry import StereoCalibration, rectifying_rotations, rotation_matrix
from stereohdr.rectification.lenses import CameraModel

Sizes = tuple[tuple[int, int], tuple[int, int]]
"""``(width, height)`` of the left and the right photo."""

TYPICAL_FOCAL = 1.2
"""Focal length in units of the longer side of the picture (45 degrees) where the pictures themselves tell none."""

FEWEST_MATCHES = 40
"""Matches below which nothing is concluded."""

RIGHT_MATCH = 3.0
"""Pixels by which a match may leave its row and still count as right."""

BENT_LINES = 0.003
"""Share of the longer side of the picture by which a match may leave its epipolar line: lenses bend the lines."""

SMALLEST_GAIN = (0.1, 0.02)
"""A richer model is taken only if it lowers the mean vertical difference by this share and by so many pixels."""

AS_IT_IS = 0.1
"""Pixels that a model must gain before a pair is touched at all. (Resampling costs a little sharpness.)"""

SMALLEST_ZOOM = 0.02
"""ln of the ratio of sizes from which on a second focal length is considered."""

STARTS = ((0.0, 0.0), (-0.6, -0.7))
"""Where a fit of focal length and distortion starts: a normal lens, and a wide one that bends. From the first
alone a wide lens may keep a wrong shape, which fits the many far points and gives up the few near ones."""

SECOND_ORDER = 1.5
"""k2 of a lens in units of k1 squared. Of 0, 0.5, 1, 1.5 and 2 it fits POLAR, both Boreal pairs and a hand-held
pair best or nearly so; BorealHDR's own calibration has 1.4."""

NOISE = 0.5
"""Pixels: scale of the robust loss."""

MOST_FITTED = 1000
"""Matches to which a model is fitted, evenly picked from more."""

MOST_STEPS = 30
"""Of the fit; where it converges, it takes ten to twenty."""

STILL = 0.25
"""Pixels; matches that move less than this show no parallax."""

_FAR_OFF = 100.0
"""Pixels of error for a point that a model sends nowhere."""


@dataclass(frozen=True)
class _Parameter:
    """A number that is fitted: how far from 0 it is expected, and its bounds."""

    name: str
    expected: float
    largest: float


_PARAMETERS = (
    _Parameter("turn of the left camera, radians", 0.3, 0.6),
    _Parameter("roll of the left camera, radians", 0.3, 0.6),
    _Parameter("pitch of the right camera, radians", 0.3, 0.6),
    _Parameter("turn of the right camera, radians", 0.3, 0.6),
    _Parameter("roll of the right camera, radians", 0.3, 0.6),
    _Parameter("ln of the focal length over the typical one", 0.4, math.log(3.0)),
    _Parameter("radial distortion k1 at the typical focal length", 0.5, 1.5),
    _Parameter("ln of the right focal length over the left one", 0.3, math.log(3.0)),
)
"""What is fitted; a model takes the first few. (Pitch of both cameras together changes no vertical difference.)"""

_TURN_LEFT, _TURN_RIGHT, _BEND, _ZOOM = 0, 3, 6, 7

MODELS = {"as it is": 0, "pose": 5, "pose and lens": 7, "pose, lens and zoom": 8}
"""Models by name, and how many parameters they have; poorest first."""


@dataclass(frozen=True, eq=False)
class EstimatedRig:
    """A rig that was found from matches.

    Parameters
    ----------
    calibration
        Cameras and pose; the translation has length 1.
    matches
        The matches that agree with it.
    model
        One of `MODELS`.
    infinity_deviation
        Standard deviation in pixels of the disparity at infinity.
    """

    calibration: StereoCalibration
    matches: Matches
    model: str
    infinity_deviation: float


@dataclass(frozen=True, eq=False)
class _Fit:
    model: str
    values: NDArray[np.float64]
    errors: NDArray[np.float64]
    """Of all matches, pixels."""
    infinity_deviation: float


def estimate_rig(
    matches: Matches, sizes: Sizes, *, lenses: tuple[CameraModel, CameraModel] | None = None
) -> EstimatedRig:
    """Find how two cameras stand to one another, and roughly their lenses, from matched points.

    Parameters
    ----------
    matches
        Matches of which some are wrong.
    sizes
        Of the photos.
    lenses
        The cameras where they are known; then only the pose is sought.

    Raises
    ------
    InputError
        Too few matches agree with any geometry, or the photos show no parallax.
    MissingDependencyError
        OpenCV is not installed.

    Notes
    -----
    Source: after Fusiello and Irsara 2011 (quasi-Euclidean rectification): five angles are fitted so that the
    vertical differences in the rectified views vanish, by least squares with a robust loss, after MAGSAC++ (Barath
    et al. 2020) has thrown out most wrong matches. Weak priors keep the views from turning more than they must.
    Models of growing freedom are tried (`MODELS`): the views as they are; the angles; also a focal length and one
    coefficient of radial distortion, the same for both cameras; also a second focal length. The poorest that is
    nearly as good as the best is taken.
    """
    consistent = epipolar_inliers(matches, sizes)
    if np.count_nonzero(consistent) < FEWEST_MATCHES:
        raise InputError(
            f"only {np.count_nonzero(consistent)} points of the two photos match, at least {FEWEST_MATCHES} are "
            f"needed; give photos with more overlap and texture, exposed so that both show the same things"
        )
    moved = np.linalg.norm((matches.left - matches.right)[consistent], axis=1)
    if sizes[0] == sizes[1] and np.percentile(moved, 95) < STILL:
        raise InputError(
            "the two photos show the same picture from the same place, so nothing tells how they lie; give the "
            "photos of two cameras"
        )
    zoom = _zoom(matches[consistent])
    names = [name for name in MODELS if abs(zoom) > SMALLEST_ZOOM or MODELS[name] <= _ZOOM]
    if lenses:
        names = ["pose"]
    fits = [_fitted(name, matches, consistent, sizes, lenses, zoom) for name in names]
    chosen = _poorest_good(fits, consistent)
    return EstimatedRig(
        _rig(chosen.values, sizes, lenses),
        matches[chosen.errors <= RIGHT_MATCH],
        chosen.model,
        chosen.infinity_deviation,
    )


def bent_lines(sizes: Sizes) -> float:
    """Return by how many pixels a match may leave its epipolar line and still count as right."""
    return max(RIGHT_MATCH, BENT_LINES * np.max(sizes))


def epipolar_inliers(matches: Matches, sizes: Sizes) -> NDArray[np.bool_]:
    """Return the matches ``(N,)`` bool that agree with one epipolar geometry, within `bent_lines`.

    Notes
    -----
    Source: MAGSAC++ (Barath et al. 2020) as OpenCV has it; always the same random numbers.
    """
    cv2 = load_opencv("rectification from pictures")
    nobody = np.zeros(len(matches), dtype=bool)
    if len(matches) < 8:
        return nobody
    matrix, mask = cv2.findFundamentalMat(
        matches.left, matches.right, cv2.USAC_MAGSAC, bent_lines(sizes), 0.9999, 10_000
    )
    return nobody if matrix is None or mask is None else mask.ravel().astype(bool)


def epipole_in_picture(matches: Matches, sizes: Sizes) -> bool:
    """Return whether the epipolar lines meet inside of both pictures: one camera stands before the other."""
    cv2 = load_opencv("rectification from pictures")
    if len(matches) < 8:
        return False
    matrix, _ = cv2.findFundamentalMat(matches.left, matches.right, cv2.FM_8POINT)
    if matrix is None or matrix.shape != (3, 3):
        return False
    u, _, vt = np.linalg.svd(matrix)
    for epipole, size in zip((vt[2], u[:, 2]), sizes, strict=True):
        if abs(epipole[2]) < 1e-12:
            return False
        at = epipole[:2] / epipole[2]
        if not ((at >= 0) & (at < size)).all():
            return False
    return True


def differences(calibration: StereoCalibration, matches: Matches, *, focal: float) -> NDArray[np.float64]:
    """Return ``(x_left - x_right, y_left - y_right)`` of matches in the rectified views, ``(N, 2)`` pixels.

    Parameters
    ----------
    calibration
        The rig, with its pose.
    matches
        Pixels of the photos.
    focal
        Focal length of the rectified views. Disparity is 0 at infinity.
    """
    slopes = []
    for camera, rotation, pixels in zip(
        (calibration.left, calibration.right),
        rectifying_rotations(calibration),
        (matches.left, matches.right),
        strict=True,
    ):
        rays = camera.to_rays(pixels)
        turned = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) @ rotation.T
        depth = np.where(turned[:, 2] > 1e-3, turned[:, 2], np.nan)
        slopes.append(turned[:, :2] / depth[:, None])
    return np.nan_to_num((slopes[0] - slopes[1]) * focal, nan=_FAR_OFF)


def _fitted(
    name: str,
    matches: Matches,
    consistent: NDArray[np.bool_],
    sizes: Sizes,
    lenses: tuple[CameraModel, CameraModel] | None,
    zoom: float,
) -> _Fit:
    """Return the best fit of a model from its starting points."""
    count = MODELS[name]
    if count == 0:
        errors = np.abs(_vertical(_rig(np.empty(0), sizes, lenses), matches))
        return _Fit(name, np.empty(0), errors, 0.0)
    fits = []
    for focal, bend in STARTS if count > _BEND else STARTS[:1]:
        start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, focal, bend, zoom])[:count]
        fits.append(_fitted_from(start, name, matches, consistent, sizes, lenses))
    return min(fits, key=lambda fit: float(np.minimum(fit.errors, RIGHT_MATCH).mean()))


def _fitted_from(
    start: NDArray[np.float64],
    name: str,
    matches: Matches,
    consistent: NDArray[np.bool_],
    sizes: Sizes,
    lenses: tuple[CameraModel, CameraModel] | None,
) -> _Fit:
    from scipy.optimize import least_squares

    parameters = _PARAMETERS[: len(start)]
    expected = np.array([parameter.expected for parameter in parameters])
    largest = np.array([parameter.largest for parameter in parameters])
    values = np.clip(start, -0.9 * largest, 0.9 * largest)
    kept, errors, solution = consistent, np.empty(0), None
    for loss, largest_error in (("soft_l1", bent_lines(sizes)), ("cauchy", RIGHT_MATCH), ("cauchy", RIGHT_MATCH)):
        used = np.flatnonzero(kept)
        used = used[:: 1 + len(used) // MOST_FITTED]

        def residuals(values: NDArray[np.float64], some: Matches = matches[used]) -> NDArray[np.float64]:
            return np.concatenate([_vertical(_rig(values, sizes, lenses), some) / NOISE, values / expected])

        solution = least_squares(
            residuals, values, loss=loss, bounds=(-largest, largest), x_scale=expected, max_nfev=MOST_STEPS
        )
        # The last digits depend on the linear algebra library.
        values = np.clip(np.round(solution.x, 9), -largest, largest)
        errors = np.abs(_vertical(_rig(values, sizes, lenses), matches))
        kept = errors <= largest_error
        if np.count_nonzero(kept) < FEWEST_MATCHES:
            break
    assert solution is not None
    covariance = np.linalg.pinv(solution.jac.T @ solution.jac)
    gradient = np.zeros(len(values))
    gradient[[_TURN_LEFT, _TURN_RIGHT]] = -1.0, 1.0
    focal = _rig(values, sizes, lenses).left.focal
    return _Fit(name, values, errors, focal * math.sqrt(max(0.0, gradient @ covariance @ gradient)))


def _zoom(matches: Matches) -> float:
    """Return ln of how much larger the right view shows things, from the spread of the rows of the matches."""
    left, right = (np.std(at[:, 1]) for at in (matches.left, matches.right))
    return math.log(right / left) if min(left, right) > 0 else 0.0


def _vertical(calibration: StereoCalibration, matches: Matches) -> NDArray[np.float64]:
    return differences(calibration, matches, focal=calibration.left.focal)[:, 1]


def _poorest_good(fits: list[_Fit], consistent: NDArray[np.bool_]) -> _Fit:
    """Return the first fit that is nearly as good as the best, on the matches that any of them explains."""
    counted = np.any([consistent, *(fit.errors <= RIGHT_MATCH for fit in fits)], axis=0)
    costs = [float(np.minimum(fit.errors[counted], RIGHT_MATCH).mean()) for fit in fits]
    best = min(costs)
    share, pixels = SMALLEST_GAIN
    for fit, cost in zip(fits, costs, strict=True):
        slack = max(share * best, pixels) if len(fit.values) else AS_IT_IS
        if cost <= best + slack:
            return fit
    raise AssertionError("the best fit is as good as the best fit")


def _rig(
    values: NDArray[np.float64], sizes: Sizes, lenses: tuple[CameraModel, CameraModel] | None
) -> StereoCalibration:
    """Return the rig that the values of the first parameters stand for; the others are 0."""
    turn_left, roll_left, pitch, turn_right, roll_right, log_focal, bend, log_zoom = np.concatenate(
        [values, np.zeros(len(_PARAMETERS) - len(values))]
    )
    left = rotation_matrix(np.array([0.0, turn_left, roll_left]))
    right = rotation_matrix(np.array([pitch, turn_right, roll_right]))
    if lenses is None:
        stretch = math.exp(log_focal)
        focal = TYPICAL_FOCAL * max(sizes[0]) * stretch
        zoomed = TYPICAL_FOCAL * max(sizes[0]) * stretch * math.exp(log_zoom)
        lenses = (_camera(focal, bend * stretch**2, sizes[0]), _camera(zoomed, bend * stretch**2, sizes[1]))
    # Both frames are turned into the common one, in which the right camera stands at (1, 0, 0).
    return StereoCalibration(*lenses, rotation=right.T @ left, translation=-right.T[:, 0])


def _camera(focal: float, bend: float, size: tuple[int, int]) -> CameraModel:
    width, height = size
    matrix = np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
    return CameraModel(matrix, (bend, SECOND_ORDER * bend**2) if bend else (), size=size)
