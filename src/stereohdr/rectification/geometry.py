"""Two cameras and the common plane onto which both views are projected so that their rows agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.model import View
from stereohdr.rectification.lenses import CameraModel

LARGEST_VERGENCE = 15.0
"""Degrees between the two optical axes beyond which a pair is refused: the views then share too little."""

LARGEST_TURN = 30.0
"""Degrees by which a view may be turned into the common plane; more would stretch its far side beyond use."""

SMALLEST_SIDE = 16
"""Pixels that the common part of both views must have in each direction."""

LARGEST_FRAME = 2.0
"""The rectified frame is at most this many times as wide or high as the photos (wide lenses, straightened)."""

EDGE_SLACK = 1e-6
"""Pixels by which a position may leave the photo through rounding and still count as inside."""

Corners = tuple[int, int, int, int]
"""First column and row, last column and row of a box."""

Covered = Callable[[NDArray[Any], NDArray[Any]], NDArray[np.bool_]]
"""Tells which crossings of columns and rows both photos cover."""

_SEARCH_GRID = 256
"""Lines per direction of the grid on which the common crop is searched before it is checked pixel by pixel."""


@dataclass(frozen=True, eq=False)
class StereoCalibration:
    """What is known of a stereo rig: two cameras and, unless only their lenses are known, how they stand.

    Parameters
    ----------
    left, right
        The cameras.
    rotation
        ``(3, 3)`` R of ``X_right = R X_left + T``, or None.
    translation
        ``(3,)`` T in metres (of length 1 where the true distance is not known), or None.
    rms
        Root mean square reprojection error of the calibration in pixels, None when not known.

    Raises
    ------
    InputError
        R is no rotation, T is zero, or only one of them is given.
    """

    left: CameraModel
    right: CameraModel
    rotation: NDArray[np.float64] | None = None
    translation: NDArray[np.float64] | None = None
    rms: float | None = None

    def __post_init__(self) -> None:
        if (self.rotation is None) != (self.translation is None):
            raise InputError("a stereo calibration has both a rotation and a translation, or neither")
        if self.rotation is None or self.translation is None:
            return
        rotation = np.array(self.rotation, dtype=np.float64)
        translation = np.array(self.translation, dtype=np.float64).ravel()
        if rotation.shape != (3, 3) or not np.isfinite(rotation).all():
            raise InputError(f"the rotation between the cameras is a 3x3 matrix, got {rotation.tolist()}")
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise InputError(f"the matrix R of the calibration is not a rotation: {rotation.tolist()}")
        if translation.shape != (3,) or not 0 < np.linalg.norm(translation) < np.inf:
            raise InputError(
                f"the translation between the cameras is three numbers, not all 0, got {translation.tolist()}"
            )
        u, _, vt = np.linalg.svd(rotation)  # files hold few digits
        object.__setattr__(self, "rotation", u @ vt)
        object.__setattr__(self, "translation", translation)

    @property
    def has_pose(self) -> bool:
        """Whether it is known how the cameras stand to one another."""
        return self.rotation is not None

    @property
    def baseline(self) -> NDArray[np.float64] | None:
        """Centre of the right camera in the left camera's frame, ``(3,)``, None without a pose."""
        if self.rotation is None or self.translation is None:
            return None
        return -self.rotation.T @ self.translation

    def exchanged(self) -> StereoCalibration:
        """Return the calibration with left and right exchanged."""
        if self.rotation is None:
            return replace(self, left=self.right, right=self.left)
        return replace(self, left=self.right, right=self.left, rotation=self.rotation.T, translation=self.baseline)


@dataclass(frozen=True, eq=False)
class RectifiedView:
    """Where the pixels of a rectified view come from.

    Parameters
    ----------
    camera
        The camera that took the photo.
    to_ray
        ``(3, 3)`` float64: a rectified pixel ``(x, y, 1)`` to a viewing ray in the camera's frame, up to scale.
    size
        ``(width, height)`` of the photo.
    """

    camera: CameraModel
    to_ray: NDArray[np.float64]
    size: tuple[int, int]

    def to_photo(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where in the photo rectified pixels ``(..., 2)`` lie, ``(..., 2)`` (x, y); NaN for nowhere."""
        return self.camera.to_pixels(_projected(self.to_ray, pixels))

    def from_photo(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return rectified positions ``(..., 2)`` (x, y) of pixels ``(..., 2)`` of the photo; NaN for nowhere."""
        return _projected(np.linalg.inv(self.to_ray), self.camera.to_rays(pixels))

    def covers(self, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return where rectified pixels ``(..., 2)`` lie in the photo, ``(...)`` bool."""
        at = self.to_photo(pixels)
        width, height = self.size
        inside_x = (at[..., 0] >= -EDGE_SLACK) & (at[..., 0] <= width - 1 + EDGE_SLACK)
        return inside_x & (at[..., 1] >= -EDGE_SLACK) & (at[..., 1] <= height - 1 + EDGE_SLACK)

    def moved(self, x: float, y: float) -> Self:
        """Return the view whose pixel (0, 0) is the pixel (x, y) of this one."""
        return replace(self, to_ray=self.to_ray @ np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]]))


@dataclass(frozen=True, eq=False)
class Rectification:
    """How a pair of views is rectified, and how well that was found to fit.

    Parameters
    ----------
    left, right
        Where the pixels of the rectified views come from.
    size
        ``(width, height)`` of the rectified views.
    disparity_offset
        Whole pixels that were taken off the disparity: points at infinity have disparity ``-disparity_offset``.
    calibration
        The cameras and the pose that led here; with depth ``Z``, ``d = f * B / Z - disparity_offset``.
    focal
        f, focal length of both rectified views in pixels.
    report
        Numbers for reports, see `stereohdr.rectification.rectify_pair`.
    """

    left: RectifiedView
    right: RectifiedView
    size: tuple[int, int]
    disparity_offset: int
    calibration: StereoCalibration
    focal: float
    report: Mapping[str, Any] | None = None

    def view(self, side: View) -> RectifiedView:
        """Return one of the two views."""
        return self.left if side == "left" else self.right


def check_pose(calibration: StereoCalibration) -> None:
    """Check that the cameras stand side by side and look nearly the same way.

    Raises
    ------
    InputError
        The right camera stands left of the left one, or above, below, before or behind it; the optical axes meet
        at more than `LARGEST_VERGENCE`, or a view would have to be turned by more than `LARGEST_TURN`.
    """
    baseline = calibration.baseline
    assert baseline is not None
    x, y, z = baseline / np.linalg.norm(baseline)
    if abs(y) > math.sin(math.radians(60)):
        raise InputError(
            "one camera stands above the other; turn both photos by 90 degrees, so that the upper one becomes the "
            "left or the right one"
        )
    if x < 0 and abs(x) > abs(z):
        raise InputError(
            "the right camera stands to the left of the left one; exchange the photos, or the cameras in the "
            "calibration"
        )
    turn = math.degrees(max(rotation_angle(rotation) for rotation in rectifying_rotations(calibration)))
    if turn > LARGEST_TURN:
        raise InputError(
            f"a view would have to be turned by {turn:.0f} degrees, more than the {LARGEST_TURN:g} that are "
            f"accepted: one camera stands before or above the other, or is rolled; place them side by side"
        )
    vergence = vergence_degrees(calibration)
    if vergence > LARGEST_VERGENCE:
        raise InputError(
            f"the cameras look {vergence:.0f} degrees apart, more than the {LARGEST_VERGENCE:g} that are "
            f"accepted; turn them so that they look the same way"
        )


def vergence_degrees(calibration: StereoCalibration) -> float:
    """Return the angle between the two optical axes in degrees."""
    assert calibration.rotation is not None
    return math.degrees(math.acos(min(1.0, max(-1.0, float(calibration.rotation[2, 2])))))


def rectifying_rotations(calibration: StereoCalibration) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rotations of the left and the right camera's frame into the common one, ``(3, 3)`` each.

    Notes
    -----
    Source: Bouguet's rule. Each view takes half of the relative rotation, then both are turned by the smallest
    angle that brings the line between the cameras onto the x axis: of all rectifications the one that turns the
    views least.
    """
    assert calibration.rotation is not None
    assert calibration.translation is not None
    half = _rotation_vector(calibration.rotation) / 2
    from_left, from_right = rotation_matrix(half), rotation_matrix(-half)
    baseline = -from_right @ calibration.translation
    baseline /= np.linalg.norm(baseline)
    axis = np.cross(baseline, [1.0, 0.0, 0.0])
    sine = float(np.linalg.norm(axis))
    angle = math.atan2(sine, float(baseline[0]))
    onto_x = rotation_matrix(axis / sine * angle) if sine > 1e-15 else np.eye(3)
    return onto_x @ from_left, onto_x @ from_right


def rectification_of(
    calibration: StereoCalibration,
    sizes: tuple[tuple[int, int], tuple[int, int]],
    *,
    main: View = "left",
    disparity_offset: int = 0,
    crop: bool = True,
) -> Rectification:
    """Project both views onto a common plane, on which corresponding points lie on the same row.

    Parameters
    ----------
    calibration
        The rig, with its pose.
    sizes
        ``(width, height)`` of the left and the right photo.
    main
        The view whose scale is kept: its focal length and principal point become those of both views.
    disparity_offset
        Whole pixels to take off the disparity.
    crop
        Cut to the largest rectangle that both photos cover everywhere. False keeps all that either covers.

    Raises
    ------
    InputError
        The pose is not one of a stereo pair, see `check_pose`; or the views have hardly a pixel in common.
    """
    check_pose(calibration)
    camera = calibration.left if main == "left" else calibration.right
    focal = camera.focal
    centre_x, centre_y = camera.matrix[:2, 2]
    plane = np.array([[1 / focal, 0.0, -centre_x / focal], [0.0, 1 / focal, -centre_y / focal], [0.0, 0.0, 1.0]])
    views = [
        RectifiedView(model, rotation.T @ plane, size)
        for model, rotation, size in zip(
            (calibration.left, calibration.right), rectifying_rotations(calibration), sizes, strict=True
        )
    ]
    left, right = views[0], views[1].moved(-disparity_offset, 0)
    frame = _frame(left, right, sizes, both=crop)
    if crop and frame is not None:
        frame = _common_rectangle(left, right, frame)
    if frame is None or min(frame[2:]) < SMALLEST_SIDE:
        raise InputError(
            "the two views have hardly a pixel in common once they are rectified; check that photos and "
            "calibration belong together"
        )
    x, y, width, height = frame
    return Rectification(
        left.moved(x, y), right.moved(x, y), (width, height), disparity_offset, calibration, focal
    )


def _frame(
    left: RectifiedView, right: RectifiedView, sizes: tuple[tuple[int, int], tuple[int, int]], *, both: bool
) -> tuple[int, int, int, int] | None:
    """Return a box (x, y, width, height) around what both views cover, or any; None when they share nothing."""
    boxes = []
    for view in (left, right):
        width, height = view.size
        x, y = np.linspace(0, width - 1, 65), np.linspace(0, height - 1, 65)
        points = view.from_photo(np.stack(np.meshgrid(x, y), axis=-1))
        outline = points[np.isfinite(points).all(axis=-1) & view.covers(points)]
        if not len(outline):
            return None
        boxes.append((outline.min(axis=0), outline.max(axis=0)))
    (low_left, high_left), (low_right, high_right) = boxes
    if both:
        low, high = np.maximum(low_left, low_right), np.minimum(high_left, high_right)
    else:
        low, high = np.minimum(low_left, low_right), np.maximum(high_left, high_right)
    largest = np.max(sizes, axis=0)
    reach = LARGEST_FRAME / 2 * largest
    low, high = np.maximum(low, largest / 2 - reach), np.minimum(high, largest / 2 + reach)
    x, y = np.ceil(low - EDGE_SLACK).astype(int)
    width, height = np.floor(high + EDGE_SLACK).astype(int) - (x, y) + 1
    return (int(x), int(y), int(width), int(height)) if width >= 1 and height >= 1 else None


def _common_rectangle(
    left: RectifiedView, right: RectifiedView, frame: tuple[int, int, int, int]
) -> tuple[int, int, int, int] | None:
    """Return about the largest box (x, y, width, height) that both views cover, None if there is none."""

    x, y, width, height = frame

    def covered(xs: NDArray[Any], ys: NDArray[Any]) -> NDArray[np.bool_]:
        points = np.stack(np.meshgrid(xs, ys), axis=-1).astype(np.float64)
        framed = ((points >= (x, y)) & (points < (x + width, y + height))).all(axis=-1)
        return framed & left.covers(points) & right.covers(points)

    columns = np.unique(np.linspace(x, x + width - 1, min(width, _SEARCH_GRID)).round().astype(int))
    rows = np.unique(np.linspace(y, y + height - 1, min(height, _SEARCH_GRID)).round().astype(int))
    box = _largest_rectangle(covered(columns, rows), columns, rows)
    if box is None:
        return None
    box = _shrunk(box, covered)
    if box is None:
        return None
    x0, y0, x1, y1 = _grown(box, covered)
    return x0, y0, x1 - x0 + 1, y1 - y0 + 1


def _shrunk(box: Corners, covered: Covered) -> Corners | None:
    """Cut lines off a box until everything on its rim is covered: the grid may have missed pixels there."""
    x0, y0, x1, y1 = box
    while x1 >= x0 and y1 >= y0:
        missed = [np.count_nonzero(~covered(*line)) for line in _rim(x0, y0, x1, y1)]
        if not any(missed):
            return x0, y0, x1, y1
        worst = int(np.argmax(missed))
        x0, y0, x1, y1 = x0 + (worst == 0), y0 + (worst == 1), x1 - (worst == 2), y1 - (worst == 3)
    return None


def _grown(box: Corners, covered: Covered) -> Corners:
    """Add lines to a box as long as they are covered."""
    x0, y0, x1, y1 = box
    side, refused = 0, 0
    while refused < 4:
        wider = (x0 - (side == 0), y0 - (side == 1), x1 + (side == 2), y1 + (side == 3))
        if covered(*_rim(*wider)[side]).all():
            x0, y0, x1, y1 = wider
            refused = 0
        else:
            refused += 1
        side = (side + 1) % 4
    return x0, y0, x1, y1


def _rim(x0: int, y0: int, x1: int, y1: int) -> list[tuple[NDArray[np.int_], NDArray[np.int_]]]:
    """Return columns and rows of the left, top, right and bottom line of a box."""
    xs, ys = np.arange(x0, x1 + 1), np.arange(y0, y1 + 1)
    return [(xs[:1], ys), (xs, ys[:1]), (xs[-1:], ys), (xs, ys[-1:])]


def _largest_rectangle(mask: NDArray[np.bool_], columns: NDArray[Any], rows: NDArray[Any]) -> Corners | None:
    """Return the corners (x0, y0, x1, y1) of the largest all-True box of `mask`, inclusive; the first of equals.

    Parameters
    ----------
    mask
        ``(H, W)`` bool, at the crossings of `rows` and `columns` (ascending coordinates).
    """
    best, box = 0, None
    top = np.full(len(columns), -1)  # per column, the row where its current run of True began
    for row, line in enumerate(mask):
        top = np.where(line, np.where(top < 0, row, top), -1)
        stack: list[tuple[int, int]] = []  # (first column, top row) of open boxes, top rows descending from below
        for column in range(len(columns) + 1):
            start_row = int(top[column]) if column < len(columns) else -1
            first = column
            while stack and (start_row < 0 or stack[-1][1] < start_row):
                first, begin = stack.pop()
                area = int(columns[column - 1] - columns[first] + 1) * int(rows[row] - rows[begin] + 1)
                if area > best:
                    best, box = area, (first, begin, column - 1, row)
            if start_row >= 0 and (not stack or stack[-1][1] > start_row):
                stack.append((first, start_row))
    if box is None:
        return None
    x0, y0, x1, y1 = box
    return int(columns[x0]), int(rows[y0]), int(columns[x1]), int(rows[y1])


def _projected(matrix: NDArray[np.floating[Any]], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a homography to points ``(..., 2)``; NaN behind the plane."""
    x, y = points[..., 0], points[..., 1]
    depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    ahead = depth > 1e-9
    depth = np.where(ahead, depth, np.nan)
    return np.stack(
        [
            (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / depth,
            (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / depth,
        ],
        axis=-1,
    )


def rotation_matrix(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation about `vector` by its length in radians (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def _rotation_vector(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axis of a rotation times its angle; angles up to nearly 180 degrees."""
    skew = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(skew)) / 2
    angle = math.atan2(sine, (float(np.trace(rotation)) - 1) / 2)
    return skew / 2 * (angle / sine if sine > 1e-12 else 1.0)


def rotation_angle(rotation: NDArray[np.float64]) -> float:
    """Return the angle of a rotation in radians."""
    return float(np.linalg.norm(_rotation_vector(rotation)))
