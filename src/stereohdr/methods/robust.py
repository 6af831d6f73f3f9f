"""Method ``robust``, the default: the paper's stages, each in a form that holds where one view sees little.

An auxiliary exposure that is shorter extends the highlights, one that is longer the shadows; the last stage is one
of two accordingly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import RobustConfig
from stereohdr.disparity.two_way import ViewMatch, fill_disparity, given_match, hidden, match_two_ways
from stereohdr.disparity.vertical_offset import level_rows
from stereohdr.model import (
    RESPONSE_KNOTS,
    Disparity,
    DisparityFlag,
    HdrResult,
    Photo,
    ResponseCurve,
    SourceFlag,
    StereoPair,
)
from stereohdr.radiance import common_luminance, exposure_map, initial_radiance
from stereohdr.response.cdf_matching import knot_codes
from stereohdr.response.parametric import fit_parametric_response
from stereohdr.response.toe import calibrate_toe, resolve_black
from stereohdr.restoration.agreement import agrees_with_main, supported
from stereohdr.restoration.highlights import Evidence, restore_highlights
from stereohdr.restoration.shadows import clean_shadows
from stereohdr.stage_log import StageLog
from stereohdr.survey import Survey, joint_counts, matched_samples, survey_pair
from stereohdr.warping import warp_backward

NEARER_BY = 5.0
"""What the auxiliary view sees before a borrowed place is another surface if it is nearer by this many pixels:
borrowed disparities are uncertain by a few."""

LARGEST_OFFSET = 1.0
"""A vertical offset between the views of more than this many rows, rounded to 0.1, is worth a warning."""

RADIANCE_STAGES = ("warped", "main_radiance", "borrowed")
"""Stages in units of radiance."""


def fuse_robust(
    pair: StereoPair,
    config: RobustConfig,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
) -> HdrResult:
    """Fuse a pair whose main view is the left one."""
    # Only the ratio of the exposures matters: in units of the main one, no rounding depends on the unit of time.
    result = _fuse_relative(
        _relative(pair), config, response=response, disparity=disparity, log=log, threads=threads
    )
    time = np.float32(pair.exposures[0])
    for name in RADIANCE_STAGES:
        if name in log.arrays:
            log.arrays[name] = log.arrays[name] / time
    return replace(result, radiance=result.radiance / time)


def _relative(pair: StereoPair) -> StereoPair:
    """Return the pair with an exposure time of 1 for the main view, and the ratio for the auxiliary view."""
    t_main, t_auxiliary = pair.exposures
    left, right = (
        replace(photo, exposure_time=time, iso=None, f_number=None, full_scale=None)
        for photo, time in ((pair.left, 1.0), (pair.right, t_auxiliary / t_main))
    )
    return replace(pair, left=left, right=right)


def _fuse_relative(
    pair: StereoPair,
    config: RobustConfig,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
) -> HdrResult:
    given_response = response

    with log.stage("survey"):  # at reduced size
        survey = survey_pair(
            pair,
            response=response,
            max_disparity=config.max_disparity,
            config=config.survey,
            fit=config.response,
            threads=threads,
        )
        response = survey.response or ResponseCurve.srgb(pair.main_photo.channels)
        level = _level(pair, survey, config, log)

    with log.stage("disparity"):  # D_m, D_a
        if disparity is not None:
            match_m, match_a = given_match(disparity)
        else:
            match_m, match_a = _match(pair, response, survey.disparities, level, config, threads)
        D_m, D_a = match_m.disparity, match_a.disparity
        log.keep(main_disparity=D_m.values, auxiliary_disparity=D_a.values, confidence=match_m.confidence)

    with log.stage("response"):
        if given_response is None:
            refined = _refined_response(pair, D_m, config, threads) if config.response_rounds > 1 else None
            if survey.response is None and refined is None:
                log.warn(
                    f"{pair.left.name} and {pair.right.name} do not tell the camera's response (hardly any "
                    f"radiance is coded by both); the sRGB curve is used instead"
                )
            response = refined or response

    with log.stage("warping"):
        warped = _warp(pair, D_m, response, level, config, threads)
        log.keep(warped=warped.radiance)

    with log.stage("agreement"):
        valid = _valid_matches(pair, warped, D_m, response, config)
        log.keep(valid=valid)
        if given_response is None and config.toe:
            response = calibrate_toe(response, _joint_counts(pair, D_m, valid), exposure_ratio=pair.exposure_ratio)
        if given_response is None:
            response = resolve_black(response, pair.main_photo.white)

    with log.stage("fusion"):
        R_m = initial_radiance(pair.main_photo, response, exposure=pair.exposures[0])
        S = _out_of_range(pair.main_photo, config)
        log.keep(main_radiance=R_m, exposure_map=S)
        if pair.exposures[1] < pair.exposures[0]:
            R, weight, source = _restore_highlights(
                pair, R_m, warped, valid, D_m, D_a, response, level, config, log, threads
            )
        else:
            R, weight, source = _clean_shadows(pair, R_m, warped, valid, D_m, response, config, threads)
        source = np.where((weight == 0) & S, SourceFlag.NO_INFORMATION, source).astype(np.uint8)
        log.keep(weight=weight)

    matched = D_m.flags == DisparityFlag.MATCHED
    found = D_m.values[matched]
    return HdrResult(
        radiance=R,
        source=source,
        weight=weight,
        disparity=D_a,
        main_disparity=D_m,
        confidence=match_m.confidence,
        response=response,
        method="robust",
        config=config,
        statistics={
            "clipped_share": float(S.mean()),
            "matched_share": float(matched.mean()),
            "occluded_share": float((D_m.flags == DisparityFlag.OCCLUDED).mean()),
            "rejected_share": float((matched & ~valid).mean()),
            "no_information_share": float((source == SourceFlag.NO_INFORMATION).mean()),
            "vertical_offset": survey.vertical_offset,
            "disparity_searched_from": float(survey.disparities[0]),
            "disparity_searched": float(survey.disparities[1]),
            "disparity_min": float(found.min()) if found.size else 0.0,
            "disparity_max": float(found.max()) if found.size else 0.0,
        },
    )


@dataclass(frozen=True, eq=False)
class _Warped:
    """The auxiliary view in the main view's pixels."""

    radiance: NDArray[np.float32]
    """``(H, W, C)``."""
    inside: NDArray[np.bool_]
    """``(H, W)``, where the place lies inside the auxiliary view."""
    white: NDArray[np.bool_]
    """``(H, W, C)``, where a clipped pixel takes part: the radiance is a lower bound."""


def _level(pair: StereoPair, survey: Survey, config: RobustConfig, log: StageLog) -> float:
    """Return the rows by which the auxiliary view is shifted to be level; warn when that is much."""
    offset = survey.vertical_offset
    if round(abs(offset), 1) > LARGEST_OFFSET:
        log.warn(
            f"{pair.left.name} and {pair.right.name}: the rows are about {abs(offset):.1f} px apart, so the views "
            f"are not rectified well; rectify them for a better result"
        )
    return offset if abs(offset) >= config.survey.smallest_offset else 0.0


def _match(
    pair: StereoPair,
    response: ResponseCurve,
    disparities: tuple[int, int],
    level: float,
    config: RobustConfig,
    threads: int | None,
) -> tuple[ViewMatch, ViewMatch]:
    main, auxiliary = common_luminance(pair, response)
    return match_two_ways(
        main,
        level_rows(auxiliary, level),
        disparities=disparities,
        census=config.census,
        semiglobal=config.semiglobal,
        config=config.two_way,
        threads=threads,
    )


def _refined_response(
    pair: StereoPair, D_m: Disparity, config: RobustConfig, threads: int | None
) -> ResponseCurve | None:
    """Fit the response once more, to matched pixels at full size, which are many and not averaged."""
    knots = [photo.codes * np.float32((RESPONSE_KNOTS - 1) / photo.white) for photo in _photos(pair)]
    samples = matched_samples(knots[0], knots[1], D_m, pair.exposures, fit=config.response, threads=threads)
    fitted = fit_parametric_response(samples, config=config.response)
    return None if fitted is None else fitted[0]


def _photos(pair: StereoPair) -> tuple[Photo, Photo]:
    return pair.main_photo, pair.auxiliary_photo


def _warp(
    pair: StereoPair,
    D_m: Disparity,
    response: ResponseCurve,
    level: float,
    config: RobustConfig,
    threads: int | None,
) -> _Warped:
    """Fetch every main pixel's place in the auxiliary view, matched or not."""
    everywhere = Disparity(D_m.values, np.full_like(D_m.flags, DisparityFlag.MATCHED))
    R_a = initial_radiance(pair.auxiliary_photo, response, exposure=pair.exposures[1])
    R_w, inside = warp_backward(level_rows(R_a, level), everywhere, threads=threads)
    white = level_rows(_white(pair.auxiliary_photo, config).astype(np.float32), level)
    white, _ = warp_backward(white, everywhere, threads=threads)
    return _Warped(R_w, inside, white > 0)


def _white(photo: Photo, config: RobustConfig) -> NDArray[np.bool_]:
    return photo.codes >= config.agreement.white_code / 255 * photo.white


def _out_of_range(photo: Photo, config: RobustConfig) -> NDArray[np.bool_]:
    """Return the map S of equation 1, and what is white in a single channel."""
    return exposure_map(photo, config=config.exposure_map) | _any_channel(photo.codes >= photo.white)


def _valid_matches(
    pair: StereoPair, warped: _Warped, D_m: Disparity, response: ResponseCurve, config: RobustConfig
) -> NDArray[np.bool_]:
    agrees = agrees_with_main(
        pair.main_photo,
        warped.radiance,
        warped.inside[..., None] & ~warped.white,
        response,
        exposures=pair.exposures,
        config=config.agreement,
    )
    matched = warped.inside & (D_m.flags == DisparityFlag.MATCHED)
    return supported(matched & agrees, radius=config.agreement.support)


def _joint_counts(pair: StereoPair, D_m: Disparity, valid: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Return how often the knots of the shorter exposure meet those of the longer one, ``(C, 256, 256)``."""
    main, auxiliary = (
        knot_codes(np.arange(photo.white + 1), photo.white).astype(np.uint8)[photo.codes]
        for photo in _photos(pair)
    )
    counts = joint_counts(main, auxiliary, D_m.values, valid, np.ones_like(valid))
    return counts.swapaxes(1, 2) if pair.exposures[1] < pair.exposures[0] else counts


def _restore_highlights(
    pair: StereoPair,
    R_m: NDArray[np.float32],
    warped: _Warped,
    valid: NDArray[np.bool_],
    D_m: Disparity,
    D_a: Disparity,
    response: ResponseCurve,
    level: float,
    config: RobustConfig,
    log: StageLog,
    threads: int | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.integer]]:
    """Return radiance, share of the auxiliary view and source flags for a shorter auxiliary exposure."""
    main = pair.main_photo
    clipped = _white(main, config)
    # What is not valid is taken from the background beside it, if that can be.
    flags = np.where(valid, DisparityFlag.MATCHED, DisparityFlag.MISMATCHED).astype(np.uint8)
    background = Disparity(fill_disparity(Disparity(D_m.values, flags)), D_m.flags)
    borrowed = _warp(pair, background, response, level, config, threads)
    possible = (
        borrowed.inside
        & ~hidden(background, D_a, tolerance=NEARER_BY)
        & agrees_with_main(
            main,
            borrowed.radiance,
            borrowed.inside[..., None] & ~borrowed.white,
            response,
            exposures=pair.exposures,
            slack=config.agreement.borrowed_slack,
            config=config.agreement,
        )
    )
    measured = Evidence(warped.radiance, np.broadcast_to(valid[..., None], clipped.shape))
    R = restore_highlights(
        R_m,
        clipped,
        measured,
        Evidence(borrowed.radiance, np.broadcast_to(possible[..., None], clipped.shape)),
        config=config.highlights,
        threads=threads,
    )
    log.keep(borrowed=borrowed.radiance)
    changed = _any_channel(R_m != R)
    source = _source(changed, valid, D_m)
    source[changed & valid & _any_channel(clipped & warped.white)] = SourceFlag.NO_INFORMATION
    return R, changed.astype(np.float32), source


def _clean_shadows(
    pair: StereoPair,
    R_m: NDArray[np.float32],
    warped: _Warped,
    valid: NDArray[np.bool_],
    D_m: Disparity,
    response: ResponseCurve,
    config: RobustConfig,
    threads: int | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.integer]]:
    """Return radiance, share of the auxiliary view and source flags for a longer auxiliary exposure."""
    R, share = clean_shadows(
        pair.main_photo,
        R_m,
        warped.radiance,
        valid[..., None] & ~warped.white,
        response,
        exposure=pair.exposures[0],
        config=config.shadows,
        threads=threads,
    )
    largest_share = reduce(np.maximum, np.moveaxis(share, 2, 0))
    weight = np.where(_any_channel(R_m != R), largest_share, np.float32(0))
    return R, weight, _source(weight > 0, valid, D_m)


def _any_channel(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels of ``(H, W, C)`` where any channel is True (faster than NumPy's ``any``)."""
    return reduce(np.logical_or, np.moveaxis(mask, 2, 0))


def _source(changed: NDArray[np.bool_], valid: NDArray[np.bool_], D_m: Disparity) -> NDArray[np.integer]:
    source = np.full(changed.shape, SourceFlag.MEASURED)
    source[changed] = SourceFlag.FILLED_REJECTED
    source[changed & (D_m.flags == DisparityFlag.OCCLUDED)] = SourceFlag.FILLED_OCCLUDED
    source[changed & valid] = SourceFlag.AUXILIARY
    return source
