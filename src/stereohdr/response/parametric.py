"""Response from few parameters, fitted to pairs of codes that see equal radiance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import ParametricResponseConfig
from stereohdr.model import LARGEST_LOG_EXPOSURE, MID_KNOT, RESPONSE_KNOTS, ResponseCurve

FITS = 30
"""Reweighted fits of one set of curves; they settle in about ten."""

STRONGER_RIDGE = 10.0
"""Factor on the ridge while a curve falls somewhere, or leaves all bounds."""

RIDGE_TRIALS = 8
"""From the default on, the last trial leaves a mixture of a gamma and the sRGB curve."""

UNDETERMINED = 1e-6
"""Pull towards the sRGB curve, against fits with total weight 1: decides what no sample decides."""

LARGEST_COUNT = 400.0
"""Samples behind one pair of codes count up to this number, lest large areas of one colour decide alone."""

END_CODES = 30
"""So many codes at either end of the range count less, the less the nearer to the end."""

FEWEST_SAMPLES = 8
"""Below this number of code pairs in all channels together there is nothing to fit."""


def fit_parametric_response(
    samples: Sequence[NDArray[np.float64]], *, config: ParametricResponseConfig | None = None
) -> tuple[ResponseCurve, float] | None:
    """Fit rising curves ``ln X = g(z)`` to pairs of codes.

    ``g(z) = a ln u + s G(z) + b_1 u + ... + b_n u^n`` plus what makes ``g(128) = 0``, with ``u = (z + 1/2) / 256``
    and G the logarithm of the inverse sRGB curve: gamma curves, linear sensors and sRGB are exact, a polynomial
    bends them. A pair gives the equation ``g(z_main) - g(z_auxiliary) = ln t_main - ln t_auxiliary``. Least
    squares, reweighted by the Cauchy function of the residual; the channels of a camera are alike, so differences
    between their coefficients cost.

    Parameters
    ----------
    samples
        One array per channel, ``(N, 4)``: knots z_main and z_auxiliary (0..255, fractions allowed), how many
        pixels stand behind the pair, and ln (t_main / t_auxiliary). Rows of several pairs of one camera may be
        joined. A channel may be empty and then follows the others.
    config
        Degree, ridge, tie, scale of the robust weights.

    Returns
    -------
    The curves, and the weighted RMS residual of the pairs (ln X). None when there are too few pairs, or no
    rising curve fits.

    Notes
    -----
    Source: our own. The ridge grows until all curves rise, which ends in a mixture of gamma and sRGB.
    """
    config = config or ParametricResponseConfig()
    if sum(len(rows) for rows in samples) < FEWEST_SAMPLES:
        return None
    rows, target, weight = _equations(samples, config.degree)
    table = _basis(np.arange(RESPONSE_KNOTS, dtype=np.float64), config.degree)
    for trial in range(RIDGE_TRIALS):
        prior = _prior(len(samples), config, ridge=config.ridge * STRONGER_RIDGE**trial)
        coefficients, residual = _robust_fit(rows, target, weight, prior, config.outlier_scale)
        curves = np.round(coefficients.reshape(len(samples), -1) @ table.T, 6)
        if (np.diff(curves, axis=1) > 0).all() and np.abs(curves).max() <= LARGEST_LOG_EXPOSURE:
            return ResponseCurve(curves), residual
    return None


def median_code_pairs(
    counts: NDArray[np.integer], log_ratio: float, *, config: ParametricResponseConfig | None = None
) -> NDArray[np.float64]:
    """Reduce the codes of corresponding pixels to one pair per code of either view.

    Parameters
    ----------
    counts
        ``(256, 256)``, how often knot i of the main view meets knot j of the auxiliary view.
    log_ratio
        ln (t_main / t_auxiliary).
    config
        Which knots count, and how many pixels a pair needs.

    Returns
    -------
    ``(N, 4)`` rows for `fit_parametric_response`: each usable knot of the main view with the (grouped) median of
    its partners, and the other way round. A knot too many of whose partners are out of range is left out: its
    median would be cut short.
    """
    config = config or ParametricResponseConfig()
    pairs = []
    for own_first, table in ((True, counts), (False, counts.T)):
        codes, partners, total = _grouped_medians(table, config)
        columns = (codes, partners) if own_first else (partners, codes)
        pairs.append(np.column_stack([*columns, total, np.full(len(codes), log_ratio)]))
    return np.concatenate(pairs)


def mid_rank_pairs(
    main: NDArray[np.integer],
    auxiliary: NDArray[np.integer],
    log_ratio: float,
    *,
    config: ParametricResponseConfig | None = None,
) -> NDArray[np.float64]:
    """Pair codes of the same rank in two histograms of the same surfaces.

    The rank of a code is the share of pixels below it plus half of those at it, so that coarse codes are not
    paired with the upper end of fine ones.

    Parameters
    ----------
    main, auxiliary
        Histograms of one channel, ``(256,)`` counts of the knots, of the part that both views see.
    log_ratio, config
        As in `median_code_pairs`.

    Returns
    -------
    ``(N, 4)`` rows for `fit_parametric_response`, both ways.

    Notes
    -----
    Source: Grossberg and Nayar 2003 for the idea; mid-ranks are our choice.
    """
    config = config or ParametricResponseConfig()
    low, high = config.lowest_code, config.highest_code
    knots = np.arange(RESPONSE_KNOTS, dtype=np.float64)
    ranks = [(np.cumsum(counts) - 0.5 * counts) / max(1, counts.sum()) for counts in (main, auxiliary)]
    pairs = []
    for own_first, own, other, counts in (
        (True, ranks[0], ranks[1], main),
        (False, ranks[1], ranks[0], auxiliary),
    ):
        partners = np.interp(own, other, knots)
        used = (knots >= low) & (knots <= high) & (partners >= low) & (partners <= high)
        used &= counts >= config.fewest_pixels
        columns = (knots, partners) if own_first else (partners, knots)
        rows = np.column_stack([*columns, counts, np.full(RESPONSE_KNOTS, log_ratio)])
        pairs.append(rows[used])
    return np.concatenate(pairs)


def _grouped_medians(
    table: NDArray[np.integer], config: ParametricResponseConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the usable rows of a joint histogram, the interpolated median column of each, and their counts."""
    low, high = config.lowest_code, config.highest_code
    codes = np.arange(low, high + 1)
    rows = table[low : high + 1].astype(np.float64)
    total = rows.sum(axis=1)
    outside = total - rows[:, low : high + 1].sum(axis=1)
    usable = (total >= config.fewest_pixels) & (outside <= config.most_outside * total)
    codes, rows, total = codes[usable], rows[usable], total[usable]
    cumulative = np.cumsum(rows, axis=1)
    half = 0.5 * total[:, None]
    median = np.argmax(cumulative >= half, axis=1)
    at = np.take_along_axis(rows, median[:, None], axis=1)[:, 0]
    below = np.take_along_axis(cumulative, median[:, None], axis=1)[:, 0] - at
    partners = median - 0.5 + (half[:, 0] - below) / at
    inside = (partners >= low) & (partners <= high)
    return codes[inside].astype(np.float64), partners[inside], total[inside]


def _basis(knots: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    """Return the functions of the model at (fractional) knots, ``(N, degree + 2)``, all 0 at the mid knot."""
    points = np.append(knots, MID_KNOT)
    u = (points + 0.5) / RESPONSE_KNOTS
    srgb = ResponseCurve.srgb(1).log_exposure[0]
    functions = [np.log(u), np.interp(points, np.arange(RESPONSE_KNOTS), srgb)]
    functions += [u**power for power in range(1, degree + 1)]
    values = np.column_stack(functions)
    return values[:-1] - values[-1]


def _equations(
    samples: Sequence[NDArray[np.float64]], degree: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the rows, right sides and weights (sum 1) of all channels; unknowns are channel by channel."""
    terms = degree + 2
    blocks, target, weight = [], [], []
    for channel, pairs in enumerate(samples):
        block = np.zeros((len(pairs), terms * len(samples)))
        block[:, channel * terms : (channel + 1) * terms] = _basis(pairs[:, 0], degree) - _basis(
            pairs[:, 1], degree
        )
        blocks.append(block)
        target.append(pairs[:, 3])
        weight.append(
            np.minimum(pairs[:, 2], LARGEST_COUNT) * np.minimum(_trust(pairs[:, 0]), _trust(pairs[:, 1]))
        )
    weights = np.concatenate(weight)
    return np.concatenate(blocks), np.concatenate(target), weights / weights.sum()


def _trust(knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Debevec's hat weight, cut off: codes in the middle are equally good."""
    return np.minimum(np.minimum(knots + 1, RESPONSE_KNOTS - knots), END_CODES)


def _prior(
    channels: int, config: ParametricResponseConfig, *, ridge: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what is added to the normal equations: matrix and right side."""
    terms = config.degree + 2
    size = channels * terms
    pull = np.full(terms, UNDETERMINED)
    pull[2:] += ridge / channels
    matrix = np.diag(np.tile(pull, channels))
    target = np.zeros((channels, terms))
    target[:, 1] = UNDETERMINED  # the sRGB curve itself
    # The tie: squared distance of each coefficient from its mean over the channels.
    between = np.eye(channels) - np.full((channels, channels), 1 / channels)
    matrix += config.tie / channels * np.kron(between, np.eye(terms))
    return matrix.reshape(size, size), target.ravel()


def _robust_fit(
    rows: NDArray[np.float64],
    target: NDArray[np.float64],
    weight: NDArray[np.float64],
    prior: tuple[NDArray[np.float64], NDArray[np.float64]],
    scale: float,
) -> tuple[NDArray[np.float64], float]:
    matrix, right = prior
    trust = np.ones_like(weight)
    coefficients, error = np.zeros(rows.shape[1]), np.zeros_like(target)
    for _ in range(FITS):
        share = weight * trust
        normal = rows.T @ (share[:, None] * rows) + matrix
        coefficients[:] = np.linalg.solve(normal, rows.T @ (share * target) + right)
        error = rows @ coefficients - target
        trust = 1 / (1 + (error / scale) ** 2)
    share = weight * trust
    return coefficients, float(np.sqrt((share * error**2).sum() / share.sum()))
