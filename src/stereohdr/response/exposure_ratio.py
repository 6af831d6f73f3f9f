"""The ratio of two exposures, estimated from the photos when nobody recorded the times."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ExposureError, InputError
from stereohdr.model import IDENTICAL_EXPOSURE_TOLERANCE, RESPONSE_KNOTS, Photo, ResponseCurve
from stereohdr.response.cdf_matching import knot_histograms
from stereohdr.response.debevec1997 import debevec_weight
from stereohdr.response.parametric import FEWEST_SAMPLES, LARGEST_COUNT, mid_rank_pairs

TYPICAL_TIME = 1 / 30
"""Seconds: the geometric mean of two estimated exposure times. Only their ratio is estimated."""


@dataclass(frozen=True)
class RatioEstimate:
    """How much longer the right photo was exposed than the left one."""

    ratio: float
    """Right exposure over left exposure."""
    spread: float
    """Median relative deviation of the single code pairs from the ratio; large where the response does not fit."""
    assumed: str
    """The response that was assumed: ``given``, ``linear`` (both photos say so) or ``srgb``."""


def estimate_exposure_ratio(left: Photo, right: Photo, *, response: ResponseCurve | None = None) -> RatioEstimate:
    """Estimate the exposure ratio of two photos of one scene from their histograms.

    Parameters
    ----------
    left, right
        Photos with the same channels, of nearly the same scene; they need not be rectified.
    response
        Inverse response of the camera with as many channels. When None, what both photos bring (camera raw files),
        else the sRGB curve.

    Raises
    ------
    InputError
        The photos or the response differ in channels.
    ExposureError
        Hardly any code of one photo has a partner in the other that is well exposed, too.

    Notes
    -----
    Codes of equal rank saw equal radiance; the ratio is the weighted median of ``X(z_right) / X(z_left)``. Photos
    alone fix response and ratio only together: if X explains them with the ratio k, so does X^gamma with k^gamma
    (Grossberg and Nayar, "Determining the camera response from images: what is knowable?", PAMI 2003). So the
    result is exact for a known response, and otherwise as good as the assumption that the camera is like sRGB.
    """
    if left.channels != right.channels or (response is not None and response.channels != left.channels):
        raise InputError(
            f"{left.name} and {right.name}: the exposure ratio needs photos, and a response, of equal channels; "
            f"convert them to grey or RGB"
        )
    assumed = "given"
    if response is None and left.linear and right.linear:
        response, assumed = left.response, "linear"
    if response is None:
        response, assumed = ResponseCurve.srgb(left.channels), "srgb"
    logs, weights = [], []
    for channel, histograms in enumerate(zip(knot_histograms(left), knot_histograms(right), strict=True)):
        pairs = mid_rank_pairs(*histograms, 0.0)
        x_left, x_right = (_exposure(response, channel, pairs[:, side]) for side in (0, 1))
        logs.append(np.log(x_right / x_left))
        hats = np.minimum(debevec_weight(pairs[:, 0]), debevec_weight(pairs[:, 1]))
        weights.append(np.minimum(pairs[:, 2], LARGEST_COUNT) * hats)
    values, weight = np.concatenate(logs), np.concatenate(weights)
    if len(values) < FEWEST_SAMPLES:
        raise ExposureError(
            f"{left.name} and {right.name}: hardly anything is well exposed in both, so the ratio of their "
            f"exposures cannot be estimated; give the exposure times"
        )
    middle = _weighted_median(values, weight)
    spread = math.expm1(_weighted_median(np.abs(values - middle), weight))
    ratio = math.exp(middle)
    if left.full_scale is not None and right.full_scale is not None:
        ratio *= right.full_scale / left.full_scale
    return RatioEstimate(ratio, spread, assumed)


def with_estimated_exposures(
    left: Photo, right: Photo, *, response: ResponseCurve | None = None
) -> tuple[Photo, Photo]:
    """Return both photos with estimated exposure times, marked as such.

    Their ratio is that of `estimate_exposure_ratio`; their geometric mean is `TYPICAL_TIME`. What the photos state
    about time, ISO and f-number is left out.

    Raises
    ------
    InputError, ExposureError
        See `estimate_exposure_ratio`; and exposures that are the same.
    """
    ratio = estimate_exposure_ratio(left, right, response=response).ratio
    if abs(ratio - 1) <= 10 * IDENTICAL_EXPOSURE_TOLERANCE:
        raise ExposureError(
            f"{left.name} and {right.name}: the photos look equally exposed (estimated ratio {ratio:.2f}); two "
            f"different exposures are needed to extend the dynamic range"
        )
    half = math.sqrt(ratio)
    return _exposed(left, TYPICAL_TIME / half), _exposed(right, TYPICAL_TIME * half)


def _exposed(photo: Photo, time: float) -> Photo:
    return replace(photo, exposure_time=time, f_number=None, iso=None, exposure_source="estimated")


def _exposure(response: ResponseCurve, channel: int, knots: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.interp(knots, np.arange(RESPONSE_KNOTS), np.exp(response.log_exposure[channel]))


def _weighted_median(values: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, 0.5 * below[-1])])
