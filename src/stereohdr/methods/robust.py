"""Method ``robust``, the default: the paper's stages, each in a form that holds where one view sees little.

An auxiliary exposure that is shorter extends the highlights, one that is longer the shadows; the last stage is one
of two accordingly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import RobustConfig
from stereohdr.disparity.tiled import MatchingPlan, match_within
from stereohdr.disparity.two_way import ViewMatch, fill_disparity, given_match, hidden
from stereohdr.disparity.vertical_offset import level_rows, level_strip, rows_behind
from stereohdr.memory import Budget, check_plan
from stereohdr.methods.robust_plan import plan_robust
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
from stereohdr.restoration.highlights import (
    SMALLEST_RISE,
    Evidence,
    JointEvidence,
    join_evidence,
    restore_logarithms,
)
from stereohdr.restoration.shadows import clean_shadows
from stereohdr.stage_log import StageLog
from stereohdr.strips import run_strips, run_together
from stereohdr.survey import Survey, joint_counts, matched_samples, survey_pair
from stereohdr.warping import warp_backward

NEARER_BY = 5.0
"""What the auxiliary view sees before a borrowed place is another surface if it is nearer by this many pixels:
borrowed disparities are uncertain by a few."""

LARGEST_OFFSET = 1.0
"""A vertical offset between the views of more than this many rows, rounded to 0.1, is worth a warning."""

STRIP_ROWS = 64
"""Rows that are warped and compared at a time."""

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
    memory: Budget,
) -> HdrResult:
    """Fuse a pair whose main view is the left one."""
    # Only the ratio of the exposures matters: in units of the main one, no rounding depends on the unit of time.
    result = _fuse_relative(
        _relative(pair), config, response=response, disparity=disparity, log=log, threads=threads, memory=memory
    )
    time = np.float32(pair.exposures[0])
    for name in RADIANCE_STAGES:
        if name in log.arrays:
            log.arrays[name] /= time
    np.divide(result.radiance, time, out=result.radiance)
    return result


def _relative(pair: StereoPair) -> StereoPair:
    """Return the pair with an exposure time of 1 for the main view, and the ratio for the auxiliary view."""
    t_main, t_auxiliary = pair.exposures
    return replace(pair, left=pair.left.with_exposure(1.0), right=pair.right.with_exposure(t_auxiliary / t_main))


def _fuse_relative(
    pair: StereoPair,
    config: RobustConfig,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
    memory: Budget,
) -> HdrResult:
    given_response = response

    with log.stage("survey"):  # at reduced size
        survey = survey_pair(
            pair,
            response=response,
            max_disparity=config.max_disparity,
            config=config.survey,
            fit=config.response,
            memory=memory.limit - memory.held,
            threads=threads,
        )
        response = survey.response or ResponseCurve.srgb(pair.main_photo.channels)
        level = _level(pair, survey, config, log)
        plan, matching = plan_robust(
            pair,
            None if disparity is not None else survey.disparities,
            config,
            memory,
            clipped=_any_channel(_white(pair.main_photo, config)),
            keep_stages=log.keeps_arrays,
            threads=threads,
        )
        check_plan(plan, f"{pair.left.name} and {pair.right.name}")

    with log.stage("disparity"):  # D_m, D_a
        if disparity is not None:
            match_m, match_a = given_match(disparity)
        else:
            match_m, match_a = _match(pair, response, survey.disparities, level, matching, config, threads)
        D_m, D_a = match_m.disparity, match_a.disparity
        del match_a  # nobody asks for its confidence
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
        valid = _valid_matches(pair, warped, D_m, response, config, threads)
        log.keep(valid=valid)
        if given_response is None and config.toe:
            counts = _joint_counts(pair, D_m, valid, threads)
            response = calibrate_toe(response, counts, exposure_ratio=pair.exposure_ratio)
        if given_response is None:
            response = resolve_black(response, pair.main_photo.white)

    with log.stage("fusion"):
        S = _out_of_range(pair.main_photo, config)
        if log.keeps_arrays:
            log.keep(main_radiance=initial_radiance(pair.main_photo, response, exposure=1.0), exposure_map=S)
        if pair.exposures[1] < pair.exposures[0]:
            R, weight, source = _restore_highlights(
                pair, warped, valid, D_m, D_a, response, level, config, log, threads
            )
        else:
            R, weight, source = _clean_shadows(pair, warped, valid, D_m, response, config, threads)
        source[(weight == 0) & S] = SourceFlag.NO_INFORMATION
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
            **plan.statistics(),
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
    plan: MatchingPlan,
    config: RobustConfig,
    threads: int | None,
) -> tuple[ViewMatch, ViewMatch]:
    main, auxiliary = common_luminance(pair, response, threads=threads)
    auxiliary = level_rows(auxiliary, level)
    return match_within(
        main,
        auxiliary,
        plan,
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
    shape = pair.main_photo.codes.shape
    warped = _Warped(np.empty(shape, np.float32), np.empty(shape[:2], bool), np.empty(shape, bool))

    def task(start: int, stop: int) -> None:
        rows = slice(start, stop)
        part = _warp_rows(pair, D_m, response, level, config, rows)
        warped.radiance[rows], warped.inside[rows], warped.white[rows] = part.radiance, part.inside, part.white

    run_strips(task, shape[0], strip_rows=STRIP_ROWS, threads=threads)
    return warped


def _warp_rows(
    pair: StereoPair, D_m: Disparity, response: ResponseCurve, level: float, config: RobustConfig, rows: slice
) -> _Warped:
    strip, height = (rows.start, rows.stop), pair.main_photo.height
    photo = pair.auxiliary_photo.rows(slice(*rows_behind(strip, level, height)))
    R_a = initial_radiance(photo, response, exposure=pair.exposures[1])
    white = _white(photo, config).astype(np.float32)
    everywhere = Disparity(D_m.values[rows], np.full_like(D_m.flags[rows], DisparityFlag.MATCHED))
    (R_w, inside), (white, _) = (
        warp_backward(level_strip(image, level, strip, height), everywhere, threads=1) for image in (R_a, white)
    )
    return _Warped(R_w, inside, white > 0)


def _white(photo: Photo, config: RobustConfig) -> NDArray[np.bool_]:
    return photo.codes >= config.agreement.white_code / 255 * photo.white


def _out_of_range(photo: Photo, config: RobustConfig) -> NDArray[np.bool_]:
    """Return the map S of equation 1, and what is white in a single channel."""
    return exposure_map(photo, config=config.exposure_map) | _any_channel(photo.codes >= photo.white)


def _valid_matches(
    pair: StereoPair,
    warped: _Warped,
    D_m: Disparity,
    response: ResponseCurve,
    config: RobustConfig,
    threads: int | None,
) -> NDArray[np.bool_]:
    agreeing = np.empty(warped.inside.shape, dtype=bool)

    def task(start: int, stop: int) -> None:
        rows = slice(start, stop)
        part = _Warped(warped.radiance[rows], warped.inside[rows], warped.white[rows])
        matched = part.inside & (D_m.flags[rows] == DisparityFlag.MATCHED)
        agreeing[rows] = matched & _agrees(pair, part, response, config, rows, slack=config.agreement.slack)

    run_strips(task, len(agreeing), strip_rows=STRIP_ROWS, threads=threads)
    return supported(agreeing, radius=config.agreement.support)


def _agrees(
    pair: StereoPair, warped: _Warped, response: ResponseCurve, config: RobustConfig, rows: slice, *, slack: float
) -> NDArray[np.bool_]:
    """Return whether what was warped to some rows can be what the main view saw."""
    return agrees_with_main(
        pair.main_photo.rows(rows),
        warped.radiance,
        warped.inside[..., None] & ~warped.white,
        response,
        exposures=pair.exposures,
        slack=slack,
        config=config.agreement,
    )


def _joint_counts(
    pair: StereoPair, D_m: Disparity, valid: NDArray[np.bool_], threads: int | None
) -> NDArray[np.integer]:
    """Return how often the knots of the shorter exposure meet those of the longer one, ``(C, 256, 256)``."""
    main, auxiliary = run_together(*(partial(_knots, photo) for photo in _photos(pair)), threads=threads)
    counts = joint_counts(main, auxiliary, D_m.values, valid, np.ones_like(valid))
    return counts.swapaxes(1, 2) if pair.exposures[1] < pair.exposures[0] else counts


def _knots(photo: Photo) -> NDArray[np.uint8]:
    table = knot_codes(np.arange(photo.white + 1), photo.white).astype(np.uint8)
    knots = np.empty(photo.codes.shape, dtype=np.uint8)
    for start in range(0, len(knots), STRIP_ROWS):  # an index takes eight times the memory of 8-bit codes
        knots[start : start + STRIP_ROWS] = table[photo.codes[start : start + STRIP_ROWS]]
    return knots


def _restore_highlights(
    pair: StereoPair,
    warped: _Warped,
    valid: NDArray[np.bool_],
    D_m: Disparity,
    D_a: Disparity,
    response: ResponseCurve,
    level: float,
    config: RobustConfig,
    log: StageLog,
    threads: int | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Return radiance, share of the auxiliary view and source flags for a shorter auxiliary exposure."""
    clipped = _white(pair.main_photo, config)
    unseen = np.empty(valid.shape, dtype=bool)
    evidence = _evidence(pair, warped, valid, D_m, D_a, response, level, config, log, threads)
    R = np.empty_like(warped.radiance)  # its logarithm at first

    def begin(start: int, stop: int) -> None:
        rows = slice(start, stop)
        unseen[rows] = valid[rows] & _any_channel(clipped[rows] & warped.white[rows])
        np.log(initial_radiance(pair.main_photo.rows(rows), response, exposure=1.0), out=R[rows])

    run_strips(begin, len(R), strip_rows=STRIP_ROWS, threads=threads)
    restore_logarithms(R, clipped, evidence, config=config.highlights, threads=threads)
    changed = np.empty(valid.shape, dtype=bool)

    def finish(start: int, stop: int) -> None:
        rows = slice(start, stop)
        R_m = initial_radiance(pair.main_photo.rows(rows), response, exposure=1.0)
        risen = R[rows] > np.log(R_m) + np.float32(0.5 * SMALLEST_RISE)
        changed[rows] = _any_channel(risen)
        R_m[risen] = np.exp(R[rows][risen])
        R[rows] = R_m

    run_strips(finish, len(R), strip_rows=STRIP_ROWS, threads=threads)
    source = _source(changed, valid, D_m)
    source[changed & unseen] = SourceFlag.NO_INFORMATION
    return R, changed.astype(np.float32), source


def _evidence(
    pair: StereoPair,
    warped: _Warped,
    valid: NDArray[np.bool_],
    D_m: Disparity,
    D_a: Disparity,
    response: ResponseCurve,
    level: float,
    config: RobustConfig,
    log: StageLog,
    threads: int | None,
) -> JointEvidence:
    """Return what the auxiliary view tells about highlights.

    What is not valid is taken from the background beside it, if that can be. To save memory, the result takes the
    place of `warped.radiance`, unless that is kept.
    """
    flags = np.where(valid, np.uint8(DisparityFlag.MATCHED), np.uint8(DisparityFlag.MISMATCHED))
    background = Disparity(fill_disparity(Disparity(D_m.values, flags)), D_m.flags)
    log_radiance, kept = warped.radiance, None
    if log.keeps_arrays:
        log_radiance, kept = np.empty_like(log_radiance), np.empty_like(log_radiance)
        log.keep(borrowed=kept)
    evidence = JointEvidence(log_radiance, np.empty(log_radiance.shape, dtype=np.uint8))

    def task(start: int, stop: int) -> None:
        rows = slice(start, stop)
        behind, seen = (Disparity(D.values[rows], D.flags[rows]) for D in (background, D_a))
        borrowed = _warp_rows(pair, background, response, level, config, rows)
        if kept is not None:
            kept[rows] = borrowed.radiance
        possible = (
            borrowed.inside
            & ~hidden(behind, seen, tolerance=NEARER_BY)
            & _agrees(pair, borrowed, response, config, rows, slack=config.agreement.borrowed_slack)
        )
        known = (
            Evidence(radiance, np.broadcast_to(usable[..., None], radiance.shape))
            for radiance, usable in ((warped.radiance[rows], valid[rows]), (borrowed.radiance, possible))
        )
        joint = join_evidence(*known)
        evidence.log_radiance[rows], evidence.source[rows] = joint.log_radiance, joint.source

    run_strips(task, len(valid), strip_rows=STRIP_ROWS, threads=threads)
    return evidence


def _clean_shadows(
    pair: StereoPair,
    warped: _Warped,
    valid: NDArray[np.bool_],
    D_m: Disparity,
    response: ResponseCurve,
    config: RobustConfig,
    threads: int | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Return radiance, share of the auxiliary view and source flags for a longer auxiliary exposure."""
    R_m = initial_radiance(pair.main_photo, response, exposure=1.0)
    R, share = clean_shadows(
        pair.main_photo,
        R_m,
        warped.radiance,
        valid[..., None] & ~warped.white,
        response,
        exposure=1.0,
        config=config.shadows,
        threads=threads,
    )
    largest_share = reduce(np.maximum, np.moveaxis(share, 2, 0))
    weight = np.where(_any_channel(R_m != R), largest_share, np.float32(0))
    return R, weight, _source(weight > 0, valid, D_m)


def _any_channel(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels of ``(H, W, C)`` where any channel is True (faster than NumPy's ``any``)."""
    return reduce(np.logical_or, np.moveaxis(mask, 2, 0))


def _source(changed: NDArray[np.bool_], valid: NDArray[np.bool_], D_m: Disparity) -> NDArray[np.uint8]:
    source = np.full(changed.shape, SourceFlag.MEASURED, dtype=np.uint8)
    source[changed] = SourceFlag.FILLED_REJECTED
    source[changed & (D_m.flags == DisparityFlag.OCCLUDED)] = SourceFlag.FILLED_OCCLUDED
    source[changed & valid] = SourceFlag.AUXILIARY
    return source
