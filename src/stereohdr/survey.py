"""A first look at a pair at reduced size: which disparities occur, and a first response of the camera.

Both need each other a little: matching wants radiance, the response wants pixels that correspond. At a few hundred
columns a full search is cheap, and a nominal response is good enough for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr._survey_kernels import count_pairs, flat_rows
from stereohdr.config import ParametricResponseConfig, SurveyConfig
from stereohdr.disparity.tiled import MatchingPlan, match_within, plan_matching
from stereohdr.disparity.two_way import ViewMatch
from stereohdr.disparity.vertical_offset import vertical_offset
from stereohdr.model import RESPONSE_KNOTS, Disparity, DisparityFlag, Photo, ResponseCurve, StereoPair
from stereohdr.radiance import clip_to_common_interval, common_luminance, luminance
from stereohdr.response.parametric import fit_parametric_response, median_code_pairs, mid_rank_pairs
from stereohdr.strips import run_strips, run_together

FLAT_GRADIENT = 0.15
"""Only pixels whose log code changes less than this per (reduced) pixel tell about the response: elsewhere a small
error of the disparity changes the code."""

DARKEST_CODE = 3.0
"""Added to the code before the logarithm: noise of the darkest codes is no gradient."""

GRADIENT_RADIUS = 4
"""Pixels on either side that have a part in the gradient."""

SAME_RESPONSE = 0.3
"""A response whose ln X is nowhere further than this from the nominal one (codes 10 to 245) is no reason to match
again: the census and the common interval hardly change."""

SMALLEST_OVERLAP = 0.2
"""Share of the columns that both views are taken to see at least."""

FAR_MARGIN = 0.1
"""The disparity range found is widened at the far end by this share of itself."""

NEAR_MARGIN = 0.3
"""The same at the near end, where small objects may be lost at reduced size."""

MARGIN_PIXELS = 2.0
"""Reduced pixels that are added at either end."""

STRIP_ROWS = 64


@dataclass(frozen=True, eq=False)
class Survey:
    """What was found.

    Parameters
    ----------
    response
        Curves of the camera; None if the pair does not tell.
    residual
        RMS residual of the response's sample pairs (ln X); NaN for a response that was given.
    disparities
        Smallest and largest disparity to search, pixels of the full image.
    confirmed_share
        Share (0..1) of the reduced pixels whose match is confirmed.
    vertical_offset
        Rows by which the auxiliary view is too low (row of the auxiliary view minus row of the main view).
    """

    response: ResponseCurve | None
    residual: float
    disparities: tuple[int, int]
    confirmed_share: float
    vertical_offset: float


REDUCED_BYTES = 120
"""Memory per reduced pixel beside the matching, measured."""


@dataclass(frozen=True, eq=False)
class _Reduced:
    """Both views at reduced size, in response knots (0..255)."""

    main: NDArray[np.float32]
    auxiliary: NDArray[np.float32]
    exposures: tuple[float, float]
    factor: int


def survey_pair(
    pair: StereoPair,
    *,
    response: ResponseCurve | None = None,
    max_disparity: int | None = None,
    config: SurveyConfig | None = None,
    fit: ParametricResponseConfig | None = None,
    memory: int | None = None,
    threads: int | None = None,
) -> Survey:
    """Match a reduced pair over all plausible disparities and learn what it tells.

    Parameters
    ----------
    pair
        Photos; the main view is the left one.
    response
        Known response; estimated when None.
    max_disparity
        Known largest disparity, pixels of the full image; the range is then 0 to this.
    config, fit
        Settings of the search and of the response.
    memory
        Bytes that it may take beside the photos, if it can; does not change the result. None for no limit.
    threads
        Threads to use; does not change the result.

    Notes
    -----
    The pair is matched with the sRGB curve when the response is unknown. The response is then fitted to codes of
    equal rank in the part that both views see, by the median disparity (Grossberg and Nayar 2003), and to the
    codes of matched pixels in flat places; the fit with the smaller residual is kept. If it is far from the sRGB
    curve, both steps are repeated with it.
    """
    config = config or SurveyConfig()
    reduced = _reduced_pair(pair, config, threads)
    search = _search_range(reduced.main.shape[1], reduced.factor, max_disparity, config)
    nominal = response or ResponseCurve.srgb(pair.left.channels)
    plan = _plan(reduced.main.shape[:2], search, memory)
    match = _match(reduced, nominal, search, plan, threads)
    residual = math.nan
    if response is None:
        response, residual = _fitted(reduced, match.disparity, fit, threads)
        if response is not None and _differ(response, nominal):
            match = _match(reduced, response, search, plan, threads)
            response, residual = _fitted(reduced, match.disparity, fit, threads)
    confirmed = match.disparity.flags == DisparityFlag.MATCHED
    disparities = (0, max_disparity) if max_disparity is not None else _range_found(match, reduced, config, search)
    offset = _vertical_offset(pair, response or nominal, match, reduced.factor, threads)
    return Survey(response, residual, disparities, float(confirmed.mean()), offset)


def survey_bytes(
    pair: StereoPair,
    *,
    max_disparity: int | None = None,
    config: SurveyConfig | None = None,
    memory: int | None = None,
) -> int:
    """Return the memory in bytes that `survey_pair` takes at most, beside the photos."""
    config = config or SurveyConfig()
    factor = _factor(pair, config)
    height, width = pair.left.height // factor, pair.left.width // factor
    search = _search_range(width, factor, max_disparity, config)
    return _plan((height, width), search, memory).bytes + REDUCED_BYTES * height * width


def _plan(shape: tuple[int, int], search: tuple[int, int], memory: int | None) -> MatchingPlan:
    """Return how to match, within what the memory leaves for it."""
    left = None if memory is None else memory - REDUCED_BYTES * shape[0] * shape[1]
    return plan_matching(shape, search, memory=left)


def reduced_codes(photo: Photo, factor: int) -> NDArray[np.float32]:
    """Return block means of the codes in response knots, ``(H // factor, W // factor, C)`` float32, 0..255.

    A block with a white code is white: the mean of clipped and other codes means nothing.
    """
    codes = photo.codes[: photo.height // factor * factor, : photo.width // factor * factor]
    wide = np.uint32 if factor < 256 else np.uint64  # large enough for the sum of a block
    mean = _over_blocks(np.add, codes.astype(wide), factor) / factor**2 * ((RESPONSE_KNOTS - 1) / photo.white)
    white = _over_blocks(np.maximum, codes, factor) >= photo.white
    return np.where(white, np.float32(RESPONSE_KNOTS - 1), mean).astype(np.float32)


def _over_blocks(operation: np.ufunc, image: NDArray[Any], factor: int) -> NDArray[Any]:
    """Join the pixels of each block of `factor` x `factor`: first its rows, then its columns."""
    # Whole slices, since a reduction along a short axis is slow.
    rows = reduce(operation, [image[start::factor] for start in range(factor)])
    return reduce(operation, [rows[:, start::factor] for start in range(factor)])


def _vertical_offset(
    pair: StereoPair, response: ResponseCurve, match: ViewMatch, factor: int, threads: int | None
) -> float:
    """Measure at full size, at the middle of the reduced pixels whose match is confirmed."""
    reduced_points = np.argwhere(match.disparity.flags == DisparityFlag.MATCHED)
    if len(reduced_points) == 0:
        return 0.0
    main, auxiliary = common_luminance(pair, response, threads=threads)
    disparities = match.disparity.values[tuple(reduced_points.T)] * factor
    points = reduced_points * factor + factor // 2
    return vertical_offset(main, auxiliary, points, disparities, uncertainty=factor)


def _factor(pair: StereoPair, config: SurveyConfig) -> int:
    factor = max(1, math.ceil(pair.left.width / config.width))
    return max(1, min(factor, pair.left.height, pair.left.width))


def _reduced_pair(pair: StereoPair, config: SurveyConfig, threads: int | None) -> _Reduced:
    factor = _factor(pair, config)
    photos = (pair.main_photo, pair.auxiliary_photo)
    codes = run_together(*(partial(reduced_codes, photo, factor) for photo in photos), threads=threads)
    return _Reduced(codes[0], codes[1], pair.exposures, factor)


def _search_range(width: int, factor: int, max_disparity: int | None, config: SurveyConfig) -> tuple[int, int]:
    """Return the disparities to try, in pixels of a pair that is reduced to this width."""
    if max_disparity is not None:
        return 0, min(width - 1, math.ceil(max_disparity / factor))
    lowest = -min(width - 1, round(config.negative_share * width))
    return lowest, min(width - 1, max(1, round(config.search_share * width)))


def _match(
    reduced: _Reduced,
    response: ResponseCurve,
    search: tuple[int, int],
    plan: MatchingPlan,
    threads: int | None,
) -> ViewMatch:
    """Return the match of the main view."""
    views = zip((reduced.main, reduced.auxiliary), reduced.exposures, strict=True)
    views = run_together(*(partial(_radiance, codes, response, time) for codes, time in views), threads=threads)
    main, auxiliary = clip_to_common_interval(views[0], views[1], response, exposures=reduced.exposures)
    return match_within(luminance(main), luminance(auxiliary), plan, disparities=search, threads=threads)[0]


def _radiance(codes: NDArray[np.float32], response: ResponseCurve, time: float) -> NDArray[np.float32]:
    """Return the radiance of codes in knots, linear between the knots."""
    radiance = np.empty_like(codes)
    for c, curve in enumerate(response.log_exposure):
        knot = np.minimum(codes[..., c].astype(np.intp), RESPONSE_KNOTS - 2)
        table = np.exp(curve) / time
        radiance[..., c] = table[knot] + np.diff(table)[knot] * (codes[..., c] - knot)
    return radiance


def _fitted(
    reduced: _Reduced, disparity: Disparity, fit: ParametricResponseConfig | None, threads: int | None
) -> tuple[ResponseCurve | None, float]:
    """Return the response with the smaller residual, and that."""
    samples = (
        matched_samples(reduced.main, reduced.auxiliary, disparity, reduced.exposures, fit=fit, threads=threads),
        _rank_samples(reduced, disparity, fit),
    )
    fits = [fit_parametric_response(pairs, config=fit) for pairs in samples]
    known = [candidate for candidate in fits if candidate is not None]
    return min(known, key=lambda candidate: candidate[1]) if known else (None, math.nan)


def _differ(response: ResponseCurve, nominal: ResponseCurve) -> bool:
    difference = (response.log_exposure - nominal.log_exposure)[:, 10:246]
    return bool(np.abs(difference).max() > SAME_RESPONSE)


def _rank_samples(
    reduced: _Reduced, disparity: Disparity, fit: ParametricResponseConfig | None
) -> list[NDArray[np.float64]]:
    """Return code pairs of equal rank in the columns that both views see."""
    width = reduced.main.shape[1]
    matched = disparity.flags == DisparityFlag.MATCHED
    typical = round(float(np.median(disparity.values[matched]))) if matched.any() else 0
    shift = int(np.clip(typical, -(1 - SMALLEST_OVERLAP) * width, (1 - SMALLEST_OVERLAP) * width))
    main = reduced.main[:, max(0, shift) : width + min(0, shift)]
    auxiliary = reduced.auxiliary[:, max(0, -shift) : width - max(0, shift)]
    log_ratio = math.log(reduced.exposures[0] / reduced.exposures[1])
    samples = []
    for c in range(main.shape[2]):
        counts = [
            np.bincount(np.rint(view[..., c]).astype(np.intp).ravel(), minlength=RESPONSE_KNOTS)
            for view in (main, auxiliary)
        ]
        samples.append(mid_rank_pairs(counts[0], counts[1], log_ratio, config=fit))
    return samples


def matched_samples(
    main: NDArray[np.floating[Any]],
    auxiliary: NDArray[np.floating[Any]],
    disparity: Disparity,
    exposures: tuple[float, float],
    *,
    fit: ParametricResponseConfig | None = None,
    threads: int | None = None,
) -> list[NDArray[np.float64]]:
    """Return the code pairs of matched pixels in flat places, where a small error of the disparity does no harm.

    Parameters
    ----------
    main, auxiliary
        ``(H, W, C)`` codes in response knots, 0..255.
    disparity
        Disparity of the main view; ``MATCHED`` pixels count.
    exposures
        Exposure times ``(main, auxiliary)`` in seconds.
    fit
        Which codes count, and how many pixels a pair of codes needs.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    Rows for `fit_parametric_response`, one array per channel.
    """
    views = [np.ascontiguousarray(codes, dtype=np.float32) for codes in (main, auxiliary)]
    flat_m, flat_a = (_flat(codes, threads) for codes in views)
    matched = disparity.flags == DisparityFlag.MATCHED
    knots_m, knots_a = (np.rint(codes).astype(np.uint8) for codes in views)
    log_ratio = math.log(exposures[0] / exposures[1])
    counts = joint_counts(knots_m, knots_a, disparity.values, matched & flat_m, flat_a)
    return [median_code_pairs(table, log_ratio, config=fit) for table in counts]


def joint_counts(
    main: NDArray[np.uint8],
    auxiliary: NDArray[np.uint8],
    disparity: NDArray[np.float32],
    used_main: NDArray[np.bool_],
    used_auxiliary: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Count how often the knots of one view meet those of the other.

    Parameters
    ----------
    main, auxiliary
        ``(H, W, C)`` uint8, codes rounded to response knots.
    disparity
        ``(H, W)`` float32, of the main view.
    used_main, used_auxiliary
        ``(H, W)`` bool, the pixels that count, if their partner is inside the other view and counts, too.

    Returns
    -------
    ``(C, 256, 256)``, knots of the main view by knots of the auxiliary view.
    """
    counts = np.zeros((main.shape[2], RESPONSE_KNOTS, RESPONSE_KNOTS), dtype=np.int64)
    images = (main, auxiliary, disparity, used_main, used_auxiliary)
    count_pairs(*(np.ascontiguousarray(image) for image in images), counts)
    return counts


def _flat(codes: NDArray[np.float32], threads: int | None) -> NDArray[np.bool_]:
    """Return where the log code, smoothed with a standard deviation of 1 pixel, hardly changes."""
    flat = np.empty(codes.shape[:2], dtype=bool)
    offset = np.arange(-GRADIENT_RADIUS, GRADIENT_RADIUS + 1)
    weights = np.exp(-0.5 * offset**2) / np.exp(-0.5 * offset**2).sum()
    taps = [values.astype(np.float32) for values in (weights, offset * weights)]
    darkest, steepest = np.float32(DARKEST_CODE), np.float32(FLAT_GRADIENT)

    def task(start: int, stop: int) -> None:
        flat_rows(codes, *taps, darkest, steepest, start, stop, flat)

    run_strips(task, len(codes), strip_rows=STRIP_ROWS, threads=threads)
    return flat


def _range_found(
    match: ViewMatch, reduced: _Reduced, config: SurveyConfig, search: tuple[int, int]
) -> tuple[int, int]:
    """Return the range of the confident disparities, widened, in pixels of the full image."""
    sure = match.confidence >= config.sure
    if not sure.any():
        sure = match.disparity.flags == DisparityFlag.MATCHED
    if not sure.any():
        return search[0] * reduced.factor, search[1] * reduced.factor
    values = match.disparity.values[sure]
    low, high = np.quantile(values, [config.outlier_share, 1 - config.outlier_share])
    if np.mean(values < -1) < config.negative_evidence:
        low = max(0.0, low)
    span = high - low
    lowest = math.floor((low - FAR_MARGIN * span - MARGIN_PIXELS) * reduced.factor)
    highest = math.ceil((high + NEAR_MARGIN * span + MARGIN_PIXELS) * reduced.factor)
    return (max(0, lowest) if low >= 0 else lowest), max(1, highest)
