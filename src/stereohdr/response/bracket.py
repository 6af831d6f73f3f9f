"""Response of a camera from a bracket: photos of a still scene from one place, at several exposures."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ExposureError, InputError, ResponseError
from stereohdr.model import (
    IDENTICAL_EXPOSURE_TOLERANCE,
    LARGEST_LOG_EXPOSURE,
    MID_KNOT,
    RESPONSE_KNOTS,
    Photo,
    ResponseCurve,
)
from stereohdr.response.cdf_matching import MINIMUM_PAIRS, knot_codes
from stereohdr.response.debevec1997 import solve_response

USED_CODES = (2, 250)
"""Lowest and highest code (of 255) that take part: nearer to the ends, clipping shifts the medians."""

SUPPORT = 20
"""A code that fewer pixels have says nothing reliable about its partner in the other photo."""

LARGEST_RATIO = 20.0
"""Photos further apart in exposure are compared only when they are neighbours in the bracket."""

LEAST_RISE = 1e-4
"""ln X rises by at least this from code to code."""

ORDER_SLACK = 0.02
"""Share of the white level by which a longer exposure may be darker on average (glare, borders of film scans)."""


def check_bracket(photos: Sequence[Photo]) -> None:
    """Check that the photos can be a bracket of one view.

    Parameters
    ----------
    photos
        In any order.

    Raises
    ------
    InputError
        Fewer than two photos, or they differ in size, channels or white level.
    ExposureError
        An exposure is unknown, two are the same, or they contradict the brightness of the photos.
    """
    if len(photos) < 2:
        raise InputError(
            f"a bracket has two or more photos of one view at different exposures, got {len(photos)}; "
            f"give all photos of the bracket"
        )
    first = photos[0]
    for photo in photos[1:]:
        for what, one, other in (
            ("size", f"{first.width}x{first.height}", f"{photo.width}x{photo.height}"),
            ("channels", first.channels, photo.channels),
            ("white level", first.white, photo.white),
        ):
            if one != other:
                raise InputError(
                    f"{photo.name}: the photos of a bracket must not differ in {what}: it has {other}, "
                    f"{first.name} has {one}; give photos of one camera, registered and of equal size"
                )
    by_exposure = sorted(zip(bracket_exposures(photos), photos, strict=True), key=lambda pair: pair[0])
    for (time, photo), (longer, brighter) in pairwise(by_exposure):
        if longer - time <= IDENTICAL_EXPOSURE_TOLERANCE * longer:
            raise ExposureError(
                f"{photo.name} and {brighter.name} have the same exposure ({time:g} s); leave one of them out"
            )
        if brighter.codes.mean() < photo.codes.mean() - ORDER_SLACK * photo.white:
            raise ExposureError(
                f"the exposures contradict the photos: {brighter.name} ({longer:g} s) should be brighter than "
                f"{photo.name} ({time:g} s), but it is darker; give the times in the order of the photos"
            )


def bracket_exposures(photos: Sequence[Photo]) -> tuple[float, ...]:
    """Return the effective exposure time of each photo in seconds, at the first photo's ISO and f-number.

    Exposure value = time x (ISO / 100) / f_number^2; ISO and f-number count when all photos state them.

    Raises
    ------
    ExposureError
        An exposure time is unknown; or ISO or f-number changes, and not all photos state it.
    """
    for photo in photos:
        if photo.exposure_time is None:
            raise ExposureError(
                f"{photo.name}: the exposure time is not known; give the times of all photos in seconds "
                f"(command line: --exposures 1/60,1/15,1/4)"
            )
    gains = np.ones(len(photos))
    for label, values, power in (
        ("ISO", [photo.iso for photo in photos], 1.0),
        ("f-number", [photo.f_number for photo in photos], -2.0),
    ):
        stated = [value for value in values if value is not None]
        if len(stated) == len(photos):
            gains *= (np.array(stated) / stated[0]) ** power
        elif len(set(stated)) > 1:
            silent = photos[values.index(None)]
            raise ExposureError(
                f"{silent.name}: does not state its {label}, and those of the other photos differ; "
                f"state it for all photos, or for none and give effective exposure times"
            )
    return tuple(
        float(photo.exposure_time or 0.0) * gain for photo, gain in zip(photos, gains.tolist(), strict=True)
    )


def bracket_sample_pairs(photos: Sequence[Photo]) -> list[tuple[NDArray[np.intp], NDArray[np.float64]]]:
    """Return codes that saw the same radiance in two photos of a registered bracket.

    For two photos, and for each code of either, the partner is the median code in the other photo of *all*
    pixels that have this code; the pair is kept when neither is clipped. Going both ways, and leaving no pixel
    out beforehand, keeps noise and clipping from pulling the pairs to one side.

    Parameters
    ----------
    photos
        Two or more photos ``(H, W, C)``, see `check_bracket`.

    Returns
    -------
    For each channel: codes ``(N, 2)`` intp, 0..255, shorter exposure first (deeper codes rounded to the knots of
    a response curve), and the effective exposure times ``(N, 2)`` float64, seconds, of the two photos.

    Raises
    ------
    InputError, ExposureError
        See `check_bracket`.

    Notes
    -----
    Source: the comparametric (brightness transfer) function of Grossberg and Nayar 2003, read off pixel by pixel
    rather than from histograms, because the photos are registered.
    """
    check_bracket(photos)
    times = bracket_exposures(photos)
    order = np.argsort(times)
    exposures = [times[i] for i in order]
    knots = [knot_codes(photos[i].codes, photos[i].white).astype(np.uint8) for i in order]
    compared = [
        (short, long)
        for short in range(len(photos))
        for long in range(short + 1, len(photos))
        if long == short + 1 or exposures[long] <= LARGEST_RATIO * exposures[short]
    ]
    samples = []
    for channel in range(photos[0].channels):
        codes = [_median_pairs(knots[short][..., channel], knots[long][..., channel]) for short, long in compared]
        pair_times = [
            np.tile([exposures[short], exposures[long]], (len(found), 1))
            for (short, long), found in zip(compared, codes, strict=True)
        ]
        samples.append((np.concatenate(codes), np.concatenate(pair_times)))
    return samples


def estimate_bracket_response(photos: Sequence[Photo], *, smoothness: float = 20.0) -> ResponseCurve:
    """Estimate the inverse response of a camera from a registered bracket.

    Parameters
    ----------
    photos
        Two or more photos ``(H, W, C)`` of a still scene from one place. Three or more, with ratios of 2 to 8
        between neighbours, determine the curve well; two leave its bend to the smoothness.
    smoothness
        lambda of `solve_response`.

    Returns
    -------
    One strictly increasing curve per channel. A channel that is clipped nearly everywhere takes the mean of the
    others.

    Raises
    ------
    InputError, ExposureError
        See `check_bracket`.
    ResponseError
        No channel has enough unclipped codes in common.

    Notes
    -----
    Source: Debevec and Malik 1997, on the pairs of `bracket_sample_pairs`. For three exposures of a simulated
    camera (sRGB, S-shaped or linear, ratio 4) the RMS error of ln X over codes 5..250 is below 0.01.
    """
    curves = [
        solve_response(codes, times, smoothness=smoothness) if len(codes) >= MINIMUM_PAIRS else None
        for codes, times in bracket_sample_pairs(photos)
    ]
    known = [_rising(curve) for curve in curves if curve is not None]
    if not known or max(np.abs(curve).max() for curve in known) > LARGEST_LOG_EXPOSURE:
        codes = f"codes {min(p.codes.min() for p in photos)} to {max(p.codes.max() for p in photos)}"
        raise ResponseError(
            f"{photos[0].name} and {len(photos) - 1} more: too little is coded unclipped by two photos of the "
            f"bracket ({codes}, white level {photos[0].white}), so the response cannot be estimated; give a saved "
            f"response, exposures that are closer together, or the right white level"
        )
    mean = np.mean(known, axis=0)
    return ResponseCurve(np.stack([mean if curve is None else _rising(curve) for curve in curves]))


def _rising(curve: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the curve made strictly increasing, outwards from its middle.

    Codes that no photo uses, such as those below the fog of scanned film, get whatever the smoothness
    extrapolates, which may fall.
    """
    ramp = LEAST_RISE * np.arange(RESPONSE_KNOTS)
    level = curve - ramp
    level[MID_KNOT:] = np.maximum.accumulate(level[MID_KNOT:])
    level[: MID_KNOT + 1] = np.minimum.accumulate(level[MID_KNOT::-1])[::-1]
    level += ramp
    return level - level[MID_KNOT]


def _median_pairs(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return pairs ``(N, 2)`` of codes of the two channels, each code with the median of its partners."""
    joint = np.bincount(
        (first.astype(np.uint16) * RESPONSE_KNOTS + second).ravel(), minlength=RESPONSE_KNOTS**2
    ).reshape(RESPONSE_KNOTS, RESPONSE_KNOTS)
    forward, backward = _codes_with_medians(joint), _codes_with_medians(joint.T)
    return np.concatenate([forward, backward[:, ::-1]])


def _codes_with_medians(joint: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the rows of a joint histogram, each with the median column of its entries, where both are usable."""
    below = np.cumsum(joint, axis=1)
    count = below[:, -1:]
    lower, upper = (2 * below >= count).argmax(axis=1), (2 * below > count).argmax(axis=1)
    pairs = np.stack([np.arange(RESPONSE_KNOTS), np.rint((lower + upper) / 2).astype(np.intp)], axis=1)
    low, high = USED_CODES
    usable = ((pairs >= low) & (pairs <= high)).all(axis=1) & (count[:, 0] >= SUPPORT)
    return pairs[usable]
