"""`rectify_pair`: two photos to two photos whose rows agree, with numbers that say how well they do."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError, StereoHdrWarning
from stereohdr.model import HdrResult, Photo, ResponseCurve, View
from stereohdr.rectification.features import Matches, match_features
from stereohdr.rectification.geometry import (
    Rectification,
    StereoCalibration,
    rectification_of,
    vergence_degrees,
)
from stereohdr.rectification.resampling import largest_scale, resampled_photo
from stereohdr.rectification.uncalibrated import (
    RIGHT_MATCH,
    EstimatedRig,
    Sizes,
    differences,
    epipolar_inliers,
    epipole_in_picture,
    estimate_rig,
)
from stereohdr.rectification.unrectify import unrectified

LARGEST_MEDIAN = 0.5
"""Pixels: a rectification from pictures is refused when its median vertical difference is larger."""

DOUBTFUL_MEDIAN = 1.0
"""Pixels: of a calibrated rectification, the median above which its calibration is doubted."""

HELD_OUT = 4
"""Every fourth match is kept from the fit, to measure it."""

FEWEST_HELD_OUT = 10
"""Matches below which nothing is said of the vertical differences."""

RANGE_PERCENTILES = (0.5, 99.5)
"""Between these lie the disparities of the scene."""

NEIGHBOURS = (8, 2)
"""Of the nearest matches in the picture, how many must show nearly the same disparity for a match to count in the
range: a wrong match on repeated texture keeps its row, but not the company of its neighbours."""

MARGIN = (4.0, 0.05)
"""Room below the smallest disparity that was found: pixels, or this share of the range if that is more."""

WORTH_SHIFTING = 0.05
"""Disparities that all exceed this share of the width are shifted down, so that there is less to search."""

SURELY_EXCHANGED = (0.02, 3.0)
"""Nearly all disparities are negative by this share of the width and this many standard deviations."""

CENTRE_SLACK = 0.2
"""A principal point further from the centre, as a share of the size, belongs to photos of another size."""

SEED = 2017


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """Two photos on common rows.

    Parameters
    ----------
    left, right
        The rectified photos, of equal size.
    valid_left, valid_right
        ``(H, W)`` bool, False where the photo held nothing; True everywhere in a cropped pair.
    rectification
        How it was done.
    """

    left: Photo
    right: Photo
    valid_left: NDArray[np.bool_]
    valid_right: NDArray[np.bool_]
    rectification: Rectification

    @property
    def largest_disparity(self) -> int | None:
        """A search range in pixels, with room for what lies nearer than all matches; None without matches."""
        report = self.rectification.report
        if report is None or report["disparity_max"] is None:
            return None
        low, high = max(0.0, report["disparity_min"]), max(0.0, report["disparity_max"])
        return min(math.ceil(high + 0.25 * (high - low)) + 8, self.left.width - 1)

    def finished(
        self,
        result: HdrResult,
        originals: Sequence[Photo] | None = None,
        *,
        response: ResponseCurve | None = None,
    ) -> HdrResult:
        """Return a result of this pair with what is to be said of its rectification.

        Parameters
        ----------
        result
            What `stereohdr.fuse` made of the rectified pair.
        originals
            The left and the right photo before rectification: the result is brought back to the pixels of the one
            that is its main view, see `unrectified`. None leaves it in the rectified view.
        response
            As it was given to `stereohdr.fuse`.
        """
        if originals is not None:
            original = originals[result.main == "right"]
            result = unrectified(result, self.rectification, original, response=response)
        doubt = doubts(self.rectification)
        sentences = result.warnings if doubt is None else (*result.warnings, doubt)
        return replace(result, rectification=self.rectification.report, warnings=sentences)


def rectify_pair(
    left: Photo,
    right: Photo,
    *,
    main: View = "left",
    calibration: StereoCalibration | None = None,
    pose_from_pictures: bool = False,
    response: ResponseCurve | None = None,
    crop: bool = True,
) -> RectifiedPair:
    """Bring two photos onto common rows: ``y_left = y_right``, ``x_left = x_right + d`` with ``d >= 0``.

    Parameters
    ----------
    left, right
        Photos of the left and the right camera, at any exposures. They may differ in size.
    main
        The view whose scale is kept.
    calibration
        The rig. None: everything is found from the pictures.
    pose_from_pictures
        With a calibration: take only its lenses, and find from the pictures how the cameras stand.
    response
        The camera's response, with which pixels are mixed, see `stereohdr.rectification.resampling`.
    crop
        Cut to what both photos cover. False keeps everything, with masks.

    Returns
    -------
    The pair. Its `Rectification.report` holds, ready for JSON:

    ``source``
        ``calibration``, ``pictures`` or ``calibration and pictures``.
    ``model``
        What was fitted to the pictures, None when nothing was.
    ``dy_median``, ``dy_p95``
        Pixels, of ``abs(y_left - y_right)`` at matches that no fit has seen; None when these are too few.
    ``inliers``, ``held_out``
        Number of matches that the geometry was fitted to, and that it was measured with.
    ``disparity_min``, ``disparity_max``
        Pixels, between which 99 % of the matches lie in the rectified pair; None without matches.
    ``disparity_offset``
        Whole pixels that were taken off the disparity.
    ``vergence_degrees``
        Angle between the optical axes.
    ``size``
        Width and height of the rectified views.

    Raises
    ------
    InputError
        The calibration is for another image size or has no pose; the pictures do not tell the geometry, or not
        well enough (median of ``abs(dy)`` above 0.5 px); the cameras do not stand side by side, or look more than
        15 degrees apart.
    ResponseError
        `response` has another channel count than the photos.
    MissingDependencyError
        OpenCV is not installed.

    Warns
    -----
    StereoHdrWarning
        The rows of a calibrated pair differ by more than 1 px: the calibration does not fit the photos.

    Notes
    -----
    A match that was held out counts when it agrees with an epipolar geometry fitted to the matches held out alone
    (within 3 px, or 0.3 % of the picture: lenses bend epipolar lines), or with the rectification (within 3 px);
    the others are wrong matches.
    """
    sizes = ((left.width, left.height), (right.width, right.height))
    if left.channels != right.channels:
        raise InputError(
            f"the two photos differ in channels: {left.name} has {left.channels}, {right.name} has "
            f"{right.channels}; convert both to grey or both to RGB"
        )
    if calibration is not None:
        _check_calibration(calibration, (left, right), pose_from_pictures)
    matches = match_features(left, right)
    if calibration is None or pose_from_pictures:
        rectification = _from_pictures(matches, sizes, calibration, main, crop)
    else:
        rectification = _from_calibration(matches, sizes, calibration, main, crop)
    doubt = doubts(rectification)
    if doubt is not None:
        warnings.warn(doubt, StereoHdrWarning, stacklevel=2)
    return rectified_photos(left, right, rectification, response=response)


def rectified_photos(
    left: Photo, right: Photo, rectification: Rectification, *, response: ResponseCurve | None = None
) -> RectifiedPair:
    """Rectify two photos the way that another pair of the same cameras was.

    Raises
    ------
    InputError
        A photo has another size than the one that the rectification was made for.
    ResponseError
        `response` has another channel count than the photos.
    """
    resampled = []
    scale = min(largest_scale(left), largest_scale(right))  # one for both: codes of linear sensors are comparable
    for photo, view in ((left, rectification.left), (right, rectification.right)):
        if (photo.width, photo.height) != view.size:
            raise InputError(
                f"{photo.name}: is {photo.width}x{photo.height}, the rectification is for "
                f"{view.size[0]}x{view.size[1]}; give photos of the same camera in the same mode"
            )
        resampled.append(resampled_photo(photo, view, rectification.size, scale=scale, response=response))
    (new_left, valid_left), (new_right, valid_right) = resampled
    return RectifiedPair(new_left, new_right, valid_left, valid_right, rectification)


def doubts(rectification: Rectification) -> str | None:
    """Return a sentence when the photos contradict the calibration that they were rectified with, else None."""
    report = rectification.report
    if report is None or report["dy_median"] is None or report["dy_median"] <= DOUBTFUL_MEDIAN:
        return None
    return (
        f"after rectification the rows of the two views differ by {report['dy_median']:.1f} px (median of "
        f"{report['held_out']} matches): the cameras have moved since they were calibrated; calibrate them again, "
        f"or find the pose from the pictures (command line: --rectify auto beside --calib)"
    )


def _check_calibration(
    calibration: StereoCalibration, photos: tuple[Photo, Photo], pose_from_pictures: bool
) -> None:
    for side, camera, photo in (
        ("left", calibration.left, photos[0]),
        ("right", calibration.right, photos[1]),
    ):
        size = (photo.width, photo.height)
        if camera.size is not None and camera.size != size:
            raise InputError(
                f"{photo.name}: is {size[0]}x{size[1]}, but the calibration of the {side} camera is for "
                f"{camera.size[0]}x{camera.size[1]}; give photos of that size, neither scaled nor cropped, or "
                f"calibrate again"
            )
        centre = camera.matrix[:2, 2]
        if camera.size is None and np.abs(centre / size - 0.5).max() > CENTRE_SLACK:
            raise InputError(
                f"{photo.name}: is {size[0]}x{size[1]}, but the {side} camera of the calibration has its centre "
                f"at ({centre[0]:.0f}, {centre[1]:.0f}), so it is for another size; give photos of that size, "
                f"neither scaled nor cropped, or calibrate again"
            )
    if not calibration.has_pose and not pose_from_pictures:
        raise InputError(
            "the calibration holds the lenses of the cameras but not how they stand to one another; find that "
            "from the pictures (command line: --rectify auto), or give a calibration of the pair"
        )


def _from_calibration(
    matches: Matches, sizes: Sizes, calibration: StereoCalibration, main: View, crop: bool
) -> Rectification:
    rectification = rectification_of(calibration, sizes, main=main, crop=crop)
    agreeing = _agreeing(matches, sizes, calibration, rectification.focal)
    report = {
        "source": "calibration",
        "model": None,
        "inliers": 0,
        **_vertical(agreeing, calibration, rectification.focal),
    }
    return _reported(rectification, report, agreeing)


def _from_pictures(
    matches: Matches, sizes: Sizes, calibration: StereoCalibration | None, main: View, crop: bool
) -> Rectification:
    """Return the rectification that three quarters of the matches call for, measured with the others."""
    held = np.zeros(len(matches), dtype=bool)
    held[np.random.default_rng(SEED).permutation(len(matches))[: len(matches) // HELD_OUT]] = True
    lenses = None if calibration is None else (calibration.left, calibration.right)
    rig = estimate_rig(matches[~held], sizes, lenses=lenses)
    focal = (rig.calibration.left if main == "left" else rig.calibration.right).focal
    unseen = _agreeing(matches[held], sizes, rig.calibration, focal)
    measured = _vertical(unseen, rig.calibration, focal)
    if measured["dy_median"] is None or measured["dy_median"] > LARGEST_MEDIAN:
        raise InputError(_failure(measured, matches, sizes))
    agreeing = rig.matches.joined(unseen)
    low, high = _disparity_range(agreeing, rig.calibration, focal)
    _check_order(high, rig, sizes)
    rectification = rectification_of(
        rig.calibration, sizes, main=main, crop=crop, disparity_offset=_offset(low, high, rig, sizes)
    )
    report = {
        "source": "pictures" if calibration is None else "calibration and pictures",
        "model": rig.model,
        "inliers": len(rig.matches),
        **measured,
    }
    return _reported(rectification, report, agreeing)


def _agreeing(matches: Matches, sizes: Sizes, calibration: StereoCalibration, focal: float) -> Matches:
    """Return the matches that agree with an epipolar geometry of their own, or with the rectification."""
    rows = np.abs(differences(calibration, matches, focal=focal)[:, 1])
    return matches[epipolar_inliers(matches, sizes) | (rows <= RIGHT_MATCH)]


def _vertical(matches: Matches, calibration: StereoCalibration, focal: float) -> dict[str, Any]:
    if len(matches) < FEWEST_HELD_OUT:
        return {"dy_median": None, "dy_p95": None, "held_out": len(matches)}
    rows = np.abs(differences(calibration, matches, focal=focal)[:, 1])
    median, p95 = np.percentile(rows, (50, 95))
    return {"dy_median": float(median), "dy_p95": float(p95), "held_out": len(matches)}


def _disparity_range(matches: Matches, calibration: StereoCalibration, focal: float) -> tuple[float, float]:
    """Return between which disparities the scene lies, from the matches whose neighbours agree with them."""
    from scipy.spatial import KDTree

    disparities = differences(calibration, matches, focal=focal)[:, 0]
    neighbours, agreeing = NEIGHBOURS
    if len(matches) > neighbours:
        _, nearest = KDTree(matches.left).query(matches.left, k=neighbours + 1)
        around = disparities[np.asarray(nearest)[:, 1:]]
        near = np.abs(around - disparities[:, None]) <= max(2.0, 0.01 * np.ptp(disparities))
        supported = near.sum(axis=1) >= agreeing
        disparities = disparities[supported] if supported.any() else disparities
    low, high = np.percentile(disparities, RANGE_PERCENTILES)
    return float(low), float(high)


def _reported(rectification: Rectification, report: dict[str, Any], matches: Matches) -> Rectification:
    low = high = None
    if len(matches) >= FEWEST_HELD_OUT:
        offset = rectification.disparity_offset
        low, high = _disparity_range(matches, rectification.calibration, rectification.focal)
        low, high = low - offset, high - offset
    report |= {
        "disparity_min": low,
        "disparity_max": high,
        "disparity_offset": rectification.disparity_offset,
        "vergence_degrees": vergence_degrees(rectification.calibration),
        "size": list(rectification.size),
    }
    return replace(rectification, report=report)


def _offset(low: float, high: float, rig: EstimatedRig, sizes: Sizes) -> int:
    """Return the whole pixels to take off disparities from `low` to `high`."""
    pixels, share = MARGIN
    margin = max(pixels, share * (high - low))
    needed = low < 0 if rig.model == "as it is" else low < margin
    return math.floor(low - margin) if needed or low > WORTH_SHIFTING * sizes[0][0] else 0


def _check_order(high: float, rig: EstimatedRig, sizes: Sizes) -> None:
    """Check that the photos are not exchanged: what is nearer moves to the left in the right view."""
    share, deviations = SURELY_EXCHANGED
    least = 1.0 if rig.model == "as it is" else share * sizes[0][0] + deviations * rig.infinity_deviation
    if high < -least:
        raise InputError(
            "the photos look exchanged: what is near lies further to the right in the photo given as the right "
            "one; give the photo of the left camera first"
        )


def _failure(measured: dict[str, Any], matches: Matches, sizes: Sizes) -> str:
    """Return why the pictures do not do, as well as it can be told."""
    consistent = matches[epipolar_inliers(matches, sizes)]
    wide, high = np.std(consistent.left - consistent.right, axis=0)
    if epipole_in_picture(consistent, sizes):
        reason = "one camera seems to stand before the other; place them side by side"
    elif high > wide:
        reason = "one camera seems to stand above the other; turn both photos by 90 degrees"
    else:
        reason = (
            "the lenses distort too much for that, or the scene moved between the photos; calibrate the cameras "
            "(stereohdr calibrate) and give --calib"
        )
    if measured["dy_median"] is None:
        return f"only {measured['held_out']} matches are left to measure the rectification with: {reason}"
    return (
        f"the pictures do not tell well enough how to rectify them: rows still differ by "
        f"{measured['dy_median']:.2f} px (median of {measured['held_out']} matches, at most {LARGEST_MEDIAN:g} is "
        f"accepted); {reason}"
    )
