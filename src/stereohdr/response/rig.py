"""Response of a rig: one curve from many pairs, or from a bracket, with what is needed to trust it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import ParametricResponseConfig
from stereohdr.errors import InputError, ResponseError
from stereohdr.model import RESPONSE_KNOTS, Photo, ResponseCurve, StereoPair
from stereohdr.response.bracket import bracket_sample_pairs, estimate_bracket_response
from stereohdr.response.cdf_matching import knot_histograms
from stereohdr.response.debevec1997 import debevec_weight
from stereohdr.response.parametric import fit_parametric_response, mid_rank_pairs


@dataclass(frozen=True, eq=False)
class RigResponse:
    """A response curve and how well the photos agree with it."""

    curve: ResponseCurve
    """One curve per channel."""
    samples: tuple[NDArray[np.float64], ...]
    """For each channel ``(N, 5)``: knots (0..255) of equal radiance in the two photos, pixels behind the pair,
    ln of the ratio of their exposures (first over second), and the number of the pair of photos."""
    residuals: NDArray[np.float64]
    """``(pairs of photos, C)`` RMS of ``g(z_1) - g(z_2) - ln(t_1 / t_2)``, weighted by the smaller hat weight of
    the two codes; NaN where a pair has no sample in a channel."""
    labels: tuple[str, ...]
    """What the pairs of photos are called: their names, in a bracket their exposure times."""

    @property
    def residual(self) -> float:
        """RMS over all samples of all channels (ln X)."""
        errors, weights = zip(
            *(_errors(self.curve.log_exposure[c], rows) for c, rows in enumerate(self.samples)), strict=True
        )
        error, weight = np.concatenate(errors), np.concatenate(weights)
        return float(np.sqrt((weight * error**2).sum() / weight.sum()))


def estimate_rig_response(
    pairs: Sequence[StereoPair], *, config: ParametricResponseConfig | None = None
) -> RigResponse:
    """Fit one response to the samples of all pairs of a rig.

    Parameters
    ----------
    pairs
        Photos ``(H, W, C)`` of the same two cameras, not necessarily rectified; each pair with its own exposures.
    config
        See `stereohdr.response.parametric.fit_parametric_response`.

    Raises
    ------
    InputError
        No pair, or pairs that differ in channels or white level.
    ResponseError
        The pairs have too little in common that is well exposed in both views.

    Notes
    -----
    Samples are codes of equal rank in the histograms of the two views (Grossberg and Nayar 2003); views of
    different surfaces bias them, in another way in each scene, which is why several scenes help.
    """
    if not pairs:
        raise InputError("a response needs at least one pair of photos")
    first = pairs[0].left
    for photo in (photo for pair in pairs for photo in (pair.left, pair.right)):
        if (photo.channels, photo.white) != (first.channels, first.white):
            raise InputError(
                f"{photo.name} has {photo.channels} channel(s) and white level {photo.white}, {first.name} has "
                f"{first.channels} and {first.white}; give photos of one camera model and mode"
            )
    samples: list[list[NDArray[np.float64]]] = [[] for _ in range(first.channels)]
    for number, pair in enumerate(pairs):
        log_ratio = float(np.log(pair.exposures[0] / pair.exposures[1]))
        histograms = [knot_histograms(photo) for photo in (pair.main_photo, pair.auxiliary_photo)]
        for channel in range(first.channels):
            rows = mid_rank_pairs(histograms[0][channel], histograms[1][channel], log_ratio, config=config)
            samples[channel].append(_numbered(rows, number))
    joined = tuple(np.concatenate(rows) for rows in samples)
    fitted = fit_parametric_response([rows[:, :4] for rows in joined], config=config)
    if fitted is None:
        raise ResponseError(
            f"{first.name} and {2 * len(pairs) - 1} more: hardly any radiance is well exposed in both views, so "
            f"the response cannot be estimated; give pairs whose exposures are closer together"
        )
    labels = tuple(f"{pair.left.name}, {pair.right.name}" for pair in pairs)
    return RigResponse(fitted[0], joined, _residuals(fitted[0], joined, len(pairs)), labels)


def estimate_view_response(photos: Sequence[Photo]) -> RigResponse:
    """Estimate the response from a bracket of one view (see `estimate_bracket_response`), with its residuals.

    Raises
    ------
    InputError, ExposureError, ResponseError
        See `estimate_bracket_response`.
    """
    curve = estimate_bracket_response(photos)
    found, samples = bracket_sample_pairs(photos), []
    steps = sorted({tuple(row) for _, times in found for row in times.tolist()})
    for codes, times in found:
        number = [steps.index(tuple(row)) for row in times.tolist()]
        log_ratio = np.log(times[:, 0] / times[:, 1])
        samples.append(np.column_stack([codes, np.ones(len(codes)), log_ratio, number]).astype(np.float64))
    labels = tuple(f"{short:.4g} s, {long:.4g} s" for short, long in steps)
    return RigResponse(curve, tuple(samples), _residuals(curve, samples, len(steps)), labels)


def _numbered(rows: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    return np.column_stack([rows, np.full(len(rows), float(number))])


def _errors(
    curve: NDArray[np.float64], rows: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the residual of each sample of a channel and its weight: the smaller hat of its two codes."""
    knots = np.arange(RESPONSE_KNOTS)
    error = np.interp(rows[:, 0], knots, curve) - np.interp(rows[:, 1], knots, curve) - rows[:, 3]
    return error, np.minimum(debevec_weight(rows[:, 0]), debevec_weight(rows[:, 1]))


def _residuals(curve: ResponseCurve, samples: Sequence[NDArray[np.float64]], pairs: int) -> NDArray[np.float64]:
    residuals = np.full((pairs, len(samples)), np.nan)
    for channel, rows in enumerate(samples):
        error, weight = _errors(curve.log_exposure[channel], rows)
        for number in range(pairs):
            own = rows[:, 4] == number
            if own.any():
                mean = (weight[own] * error[own] ** 2).sum() / weight[own].sum()
                residuals[number, channel] = np.sqrt(mean)
    return residuals
