"""Calibration of a stereo rig from photos of a chessboard or a ChArUco board."""

from __future__ import annotations

import math
import typing
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.model import Photo
from stereohdr.radiance import code_luma
from stereohdr.rectification._opencv import load_opencv
from stereohdr.rectification.features import Matches
from stereohdr.rectification.geometry import StereoCalibration, check_pose
from stereohdr.rectification.lenses import CameraModel, LensModel
from stereohdr.rectification.uncalibrated import Sizes, differences

if TYPE_CHECKING:
    from types import ModuleType

BoardKind = Literal["chessboard", "charuco"]

FEWEST_PAIRS = 5
"""Pairs of photos that must show the board; ten or more are better."""

FEWEST_CORNERS = 8
"""Corners that a photo must show, and that both photos of a pair must have in common."""

LARGEST_RMS = 1.0
"""Pixels of reprojection error beyond which a calibration is refused."""

LARGEST_FOCAL_DEVIATION = 0.02
"""Standard deviation of a focal length, as a share of it, beyond which the photos do not determine it."""

SMALL_COVERAGE = 0.3
"""Share of the picture that the corners must reach around for the lens to be known towards its edges."""

DETECTION_PIXELS = 2_000_000
"""Larger photos are reduced to find the board in; its corners are refined at full size."""

FISHEYE_FOCALS = (1 / math.pi, 0.5, 0.8, 1.2)
"""Focal lengths from which a fisheye calibration starts, in units of the longer side: 180 degrees to 48."""

CORNER_WINDOW = (0.3, 2, 11)
"""Half side of the window in which a corner is refined: this share of the distance to the next one, within bounds
in pixels. (Measured on OpenCV's sample pairs: RMS 0.20 px, against 0.44 with the usual 11 px throughout.)"""


@dataclass(frozen=True)
class Board:
    """The board that was photographed.

    Parameters
    ----------
    columns, rows
        Inner corners in each direction; a board of 10 x 7 squares has 9 x 6.
    square
        Side of a square in metres.
    kind
        ``chessboard`` or ``charuco``.
    marker
        Side of a ChArUco marker in metres, three quarters of a square by default.
    dictionary
        ChArUco dictionary, called as in OpenCV without ``DICT_``.

    Raises
    ------
    InputError
        A value is out of range.
    """

    columns: int
    rows: int
    square: float
    kind: BoardKind = "chessboard"
    marker: float | None = None
    dictionary: str = "5X5_100"

    def __post_init__(self) -> None:
        if not (3 <= self.columns <= 100 and 3 <= self.rows <= 100):
            raise InputError(
                f"a board has 3 to 100 inner corners in each direction, got {self.columns}x{self.rows}"
            )
        if not 1e-4 <= self.square <= 10:
            raise InputError(f"the squares of a board measure 0.1 mm to 10 m, got {self.square:g} m")
        if self.kind not in typing.get_args(BoardKind):
            raise InputError(f"a board is a chessboard or charuco, got {self.kind!r}")
        if self.marker is not None and not 0 < self.marker < self.square:
            raise InputError(f"the markers of a ChArUco board are smaller than its squares, got {self.marker:g} m")

    @property
    def points(self) -> NDArray[np.float64]:
        """``(N, 3)``, the inner corners in metres, row by row."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) * np.float64(self.square)


@dataclass(frozen=True, eq=False)
class BoardView:
    """What was found of a board in a photo.

    Parameters
    ----------
    name
        Of the photo.
    size
        ``(width, height)`` of the photo.
    ids
        ``(N,)`` intp, ascending: which corners of `Board.points`. Empty when the board was not found.
    corners
        ``(N, 2)`` float64, where they are, pixels (x, y).
    """

    name: str
    size: tuple[int, int]
    ids: NDArray[np.intp]
    corners: NDArray[np.float64]

    @property
    def found(self) -> bool:
        """Whether enough of the board was found."""
        return len(self.ids) >= FEWEST_CORNERS


Pair = tuple[BoardView, BoardView]
"""Views of the left and the right camera."""


@dataclass(frozen=True, eq=False)
class BoardCalibration:
    """A calibration, and what tells how good it is.

    Parameters
    ----------
    calibration
        Lenses and pose; the translation in metres.
    pairs
        What was found in the photos that were used.
    errors
        ``(P, 2)`` float64, root mean square reprojection error of each photo, left and right, pixels.
    left_out
        Names of the photos of pairs that were not used: one of the two does not show the board.
    dy_median, dy_p95
        Pixels, of ``abs(y_left - y_right)`` of the corners in the rectified views.
    coverage
        Shares of the left and of the right picture that the outline of all corners encloses.
    """

    calibration: StereoCalibration
    pairs: tuple[Pair, ...]
    errors: NDArray[np.float64]
    left_out: tuple[str, ...]
    dy_median: float
    dy_p95: float
    coverage: tuple[float, float]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences that the user should read."""
        found = []
        if self.left_out:
            found.append(
                f"these photos were not used, as the board is not seen in both: {', '.join(self.left_out)}"
            )
        if min(self.coverage) < SMALL_COVERAGE:
            found.append(
                f"the corners reach around only {100 * min(self.coverage):.0f} % of the picture, so the lens is "
                f"not known towards its edges; add photos with the board there"
            )
        return tuple(found)


def find_board(photo: Photo, board: Board) -> BoardView:
    """Find the corners of the board in a photo.

    Raises
    ------
    InputError
        The dictionary of a ChArUco board is not known.
    MissingDependencyError
        OpenCV is not installed.
    """
    cv2 = load_opencv("finding a calibration board")
    luma = code_luma(photo)
    bright = max(float(np.percentile(luma, 99.5)), 1.0)
    picture = np.rint(np.minimum(luma * np.float32(255 / bright), 255)).astype(np.uint8)
    find = _find_charuco if board.kind == "charuco" else _find_chessboard
    ids, corners = find(cv2, picture, board)
    if len(ids) >= FEWEST_CORNERS:
        corners = _refined(cv2, picture, corners)
    return BoardView(photo.name, (photo.width, photo.height), ids, corners)


def calibrate_stereo(pairs: Sequence[Pair], board: Board, *, lens: LensModel = "plumb-bob") -> BoardCalibration:
    """Calibrate two cameras from the corners of a board.

    Parameters
    ----------
    pairs
        Views of the left and the right camera, taken at the same time, see `find_board`. The board is in another
        place, and tilted another way, in each pair.
    board
        What they show.
    lens
        Lens model of both cameras.

    Raises
    ------
    InputError
        The photos of a camera differ in size; fewer than `FEWEST_PAIRS` pairs show the board; they do not
        determine the focal length; the error exceeds `LARGEST_RMS`; or the cameras do not stand side by side.
    MissingDependencyError
        OpenCV is not installed.

    Notes
    -----
    Source: OpenCV's calibration (Zhang 2000) of each camera, then of both together with all parameters free.
    """
    cv2 = load_opencv("calibration")
    sizes = _common_sizes(pairs)
    seen = [len(_shared_corners(pair)[0]) >= FEWEST_CORNERS for pair in pairs]
    used = tuple(_same_way_up(pair) for pair, enough in zip(pairs, seen, strict=True) if enough)
    left_out = tuple(view.name for pair, enough in zip(pairs, seen, strict=True) if not enough for view in pair)
    if len(used) < FEWEST_PAIRS:
        lacking = [view.name for pair in pairs for view in pair if not view.found]
        shown = ", ".join(lacking[:4]) + (", ..." if len(lacking) > 4 else "")
        advice = f"it was not found in {shown}; check --board, and that the board is sharp and whole"
        raise InputError(
            f"the board ({board.columns}x{board.rows} inner corners) is seen by both cameras in {len(used)} of "
            f"{len(pairs)} pairs, at least {FEWEST_PAIRS} are needed; {advice if shown else 'take more'}"
        )
    solve = _solve_fisheye if lens == "fisheye" else _solve_pinhole
    try:
        calibration, deviation = solve(cv2, used, board, sizes, lens)
    except cv2.error as error:
        raise InputError(
            f"the photos of the board do not determine the cameras ({' '.join(str(error).split())[:150]}); add "
            f"photos with the board in other places, tilted to all sides"
        ) from error
    cameras = (calibration.left, calibration.right)
    errors = np.array(
        [
            [_reprojection_error(cv2, camera, view, board) for camera, view in zip(cameras, pair, strict=True)]
            for pair in used
        ]
    )
    _check_quality(calibration, deviation, used, errors)
    check_pose(calibration)
    corners = [_shared_corners(pair)[1] for pair in used]
    focal = calibration.left.focal
    rows = np.abs(np.concatenate([differences(calibration, some, focal=focal)[:, 1] for some in corners]))
    return BoardCalibration(
        calibration,
        used,
        errors,
        left_out,
        float(np.median(rows)),
        float(np.percentile(rows, 95)),
        (_coverage([left for left, _ in used]), _coverage([right for _, right in used])),
    )


def _common_sizes(pairs: Sequence[Pair]) -> Sizes:
    sizes = []
    for side, views in (("left", [pair[0] for pair in pairs]), ("right", [pair[1] for pair in pairs])):
        if not views:
            raise InputError("a calibration needs photos of a board; none was given")
        for view in views[1:]:
            if view.size != views[0].size:
                raise InputError(
                    f"the photos of the {side} camera differ in size: {views[0].name} is {views[0].size[0]}x"
                    f"{views[0].size[1]}, {view.name} is {view.size[0]}x{view.size[1]}; give photos of one camera"
                )
        sizes.append(views[0].size)
    return sizes[0], sizes[1]


def _same_way_up(pair: Pair) -> Pair:
    """Number the corners of the right view in the direction of the left: some boards look the same upside down."""
    left, right = pair
    whole = np.array_equal(left.ids, right.ids) and np.array_equal(left.ids, np.arange(len(left.ids)))
    along = [view.corners[-1] - view.corners[0] for view in pair]
    if whole and along[0] @ along[1] < 0:
        right = BoardView(right.name, right.size, right.ids, right.corners[::-1].copy())
    return left, right


def _shared_corners(pair: Pair) -> tuple[NDArray[np.intp], Matches]:
    """Return the ids ``(N,)`` of the corners that both photos show, and where they are."""
    left, right = pair
    ids, of_left, of_right = np.intersect1d(left.ids, right.ids, return_indices=True)
    return ids, Matches(left.corners[of_left], right.corners[of_right])


def _solve_pinhole(
    cv2: ModuleType, pairs: Sequence[Pair], board: Board, sizes: Sizes, lens: LensModel
) -> tuple[StereoCalibration, float]:
    """Return the calibration, and the larger standard deviation of the focal lengths as a share of them."""
    flags = cv2.CALIB_RATIONAL_MODEL if lens == "rational" else 0
    guesses, deviations = [], []
    for side, size in enumerate(sizes):
        views = [pair[side] for pair in pairs]
        points = [board.points[view.ids].astype(np.float32) for view in views]
        corners = [view.corners.astype(np.float32) for view in views]
        solved = cv2.calibrateCameraExtended(points, corners, size, None, None, flags=flags)
        guesses += solved[1:3]
        deviations.append(float(solved[5][0, 0] / solved[1][0, 0]))
    shared = [_shared_corners(pair) for pair in pairs]
    solved = cv2.stereoCalibrateExtended(
        [board.points[ids].astype(np.float32) for ids, _ in shared],
        [corners.left.astype(np.float32) for _, corners in shared],
        [corners.right.astype(np.float32) for _, corners in shared],
        *guesses,
        sizes[0],
        np.eye(3),
        np.zeros((3, 1)),
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-7),
    )
    return _solution(solved, sizes, lens), max(deviations)


def _solve_fisheye(
    cv2: ModuleType, pairs: Sequence[Pair], board: Board, sizes: Sizes, lens: LensModel
) -> tuple[StereoCalibration, float]:
    """Return the calibration, and 0: OpenCV does not tell how well a fisheye's focal length is determined."""
    names = ("CALIB_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW", "CALIB_USE_INTRINSIC_GUESS")
    # Since OpenCV 5 these flags stand among the others, with other values.
    flags = sum(getattr(cv2.fisheye, name) if hasattr(cv2.fisheye, name) else getattr(cv2, name) for name in names)
    guesses = []
    for side, size in enumerate(sizes):
        views = [pair[side] for pair in pairs]
        guesses += _solve_one_fisheye(cv2, views, board, size, flags)
    shared = [_shared_corners(pair) for pair in pairs]
    solved = cv2.fisheye.stereoCalibrate(
        [board.points[ids][None] for ids, _ in shared],
        [corners.left[None] for _, corners in shared],
        [corners.right[None] for _, corners in shared],
        *guesses,
        sizes[0],
        flags=flags,
    )
    return _solution(solved, sizes, lens), 0.0


def _solve_one_fisheye(
    cv2: ModuleType, views: Sequence[BoardView], board: Board, size: tuple[int, int], flags: int
) -> tuple[Any, Any]:
    """Return the matrix and the coefficients of one camera, from the first focal length that leads somewhere."""
    points = [board.points[view.ids][None] for view in views]
    corners = [view.corners[None] for view in views]
    failure = None
    for share in FISHEYE_FOCALS:
        focal = share * max(size)
        guess = np.array([[focal, 0.0, (size[0] - 1) / 2], [0.0, focal, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])
        try:
            _, matrix, coefficients, _, _ = cv2.fisheye.calibrate(
                points, corners, size, guess, np.zeros((4, 1)), flags=flags
            )
        except cv2.error as error:  # it gives up when the guess is too far off
            failure = error
        else:
            return matrix, coefficients
    assert failure is not None
    raise failure


def _solution(solved: Sequence[Any], sizes: Sizes, lens: LensModel) -> StereoCalibration:
    """Return the calibration that OpenCV's solvers tell as rms, K, D, K, D, R, T, ..."""
    rms, *lenses, rotation, translation = solved[:7]
    cameras = [
        CameraModel(matrix, tuple(coefficients.ravel()), lens, size)
        for matrix, coefficients, size in zip(lenses[0::2], lenses[1::2], sizes, strict=True)
    ]
    return StereoCalibration(cameras[0], cameras[1], rotation, translation, float(rms))


def _reprojection_error(cv2: ModuleType, camera: CameraModel, view: BoardView, board: Board) -> float:
    """Return the root mean square distance in pixels of the corners from where the camera should see them."""
    points = board.points[view.ids]
    rays = camera.to_rays(view.corners)
    seen = np.isfinite(rays).all(axis=1)
    if np.count_nonzero(seen) < FEWEST_CORNERS:
        return math.inf
    _, turn, shift = cv2.solvePnP(points[seen], rays[seen], np.eye(3), None)
    placed = points[seen] @ cv2.Rodrigues(turn)[0].T + shift.ravel()
    again = camera.to_pixels(placed[:, :2] / placed[:, 2:])
    return float(np.sqrt(((again - view.corners[seen]) ** 2).sum(axis=1).mean()))


def _check_quality(
    calibration: StereoCalibration,
    deviation: float,
    pairs: Sequence[Pair],
    errors: NDArray[np.float64],
) -> None:
    """Refuse a calibration that would do harm."""
    rms = calibration.rms
    if rms is None or not rms <= LARGEST_RMS:
        number, side = divmod(int(np.argmax(errors)), 2)
        view = pairs[number][side]
        raise InputError(
            f"the reprojection error is {rms:.2f} px, at most {LARGEST_RMS:g} is accepted; the worst photo is "
            f"{view.name} ({errors[number, side]:.2f} px); check that the board is flat, and the photos sharp, "
            f"taken at the same time and in the same order, or leave that pair out"
        )
    if not deviation <= LARGEST_FOCAL_DEVIATION:
        raise InputError(
            f"the photos leave the focal length open (to {100 * deviation:.1f} %, at most "
            f"{100 * LARGEST_FOCAL_DEVIATION:g} is accepted); add photos with the board tilted by 20 to 40 "
            f"degrees, to all sides"
        )


def _coverage(views: Sequence[BoardView]) -> float:
    """Return the share of the picture inside of the convex outline of all corners."""
    from scipy.spatial import ConvexHull

    width, height = views[0].size
    return float(ConvexHull(np.concatenate([view.corners for view in views])).volume) / (width * height)


def _find_chessboard(
    cv2: ModuleType, picture: NDArray[np.uint8], board: Board
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the ids and rough positions of all corners, or none."""
    small, factor = _reduced(cv2, picture)
    size = (board.columns, board.rows)
    found, corners = cv2.findChessboardCorners(
        small, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    )
    if not found:
        found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_EXHAUSTIVE)
    if not found:
        return np.empty(0, dtype=np.intp), np.empty((0, 2))
    corners = (corners.reshape(-1, 2).astype(np.float64) + 0.5) * factor - 0.5
    return np.arange(len(corners)), corners


def _find_charuco(
    cv2: ModuleType, picture: NDArray[np.uint8], board: Board
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the ids and rough positions of the corners that are seen."""
    name = f"DICT_{board.dictionary.upper()}"
    if not hasattr(cv2.aruco, name):
        raise InputError(
            f"the ChArUco dictionary {board.dictionary!r} is not known; OpenCV's are 4X4_50, 5X5_100, ..."
        )
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    marker = 0.75 * board.square if board.marker is None else board.marker
    charuco = cv2.aruco.CharucoBoard((board.columns + 1, board.rows + 1), board.square, marker, dictionary)
    best: tuple[NDArray[np.intp], NDArray[np.float64]] = (np.empty(0, dtype=np.intp), np.empty((0, 2)))
    for legacy in (False, True):  # boards printed with OpenCV before 4.6 begin with another square
        charuco.setLegacyPattern(legacy)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco).detectBoard(picture)
        if ids is not None and len(ids) > len(best[0]):
            order = np.argsort(ids.ravel())
            best = ids.ravel()[order].astype(np.intp), corners.reshape(-1, 2)[order].astype(np.float64)
    return best


def _reduced(cv2: ModuleType, picture: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """Return the picture at most `DETECTION_PIXELS` large, and by which factor it was reduced."""
    factor = math.ceil(math.sqrt(picture.size / DETECTION_PIXELS))
    height, width = (side // factor for side in picture.shape)
    if factor == 1:
        return picture, 1
    small = cv2.resize(picture[: height * factor, : width * factor], (width, height), interpolation=cv2.INTER_AREA)
    return small, factor


def _refined(cv2: ModuleType, picture: NDArray[np.uint8], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return corners to a fraction of a pixel."""
    from scipy.spatial import KDTree

    nearest = KDTree(corners).query(corners, k=2)[0][:, 1]
    share, smallest, largest = CORNER_WINDOW
    side = int(np.clip(share * nearest.min(), smallest, largest))
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    rough = np.ascontiguousarray(corners[:, None], dtype=np.float32)
    exact = cv2.cornerSubPix(picture, rough, (side, side), (-1, -1), stop)
    return exact.reshape(-1, 2).astype(np.float64)
