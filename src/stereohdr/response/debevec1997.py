"""Inverse response from samples of known exposure ratio (Debevec and Malik, SIGGRAPH 1997)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stereohdr.model import MID_KNOT, RESPONSE_KNOTS


def debevec_weight(knots: ArrayLike) -> NDArray[np.float64]:
    """Return the hat weight ``min(z + 1, 256 - z)`` of codes 0..255, float64, 1 to 128."""
    z = np.asarray(knots, dtype=np.float64)
    return np.minimum(z + 1, RESPONSE_KNOTS - z)


def solve_response(
    samples: NDArray[np.integer], exposure_times: ArrayLike, *, smoothness: float = 20.0
) -> NDArray[np.float64]:
    """Solve for the inverse response of one channel.

    Minimises ``w(z)^2 (g(z) - ln E_i - ln t_j)^2`` over all samples plus
    ``(smoothness * w(z) * g''(z))^2`` over all inner codes, with ``g(128) = 0``.

    Parameters
    ----------
    samples
        ``(N, P)`` integers 0..255: the code of sample point i in photo j.
    exposure_times
        ``(P,)`` positive, seconds (only ratios matter).
    smoothness
        lambda, >= 0.

    Returns
    -------
    ``(256,)`` float64, ``g`` = ln exposure to six decimals, exactly 0 at code 128.

    Notes
    -----
    Source: Debevec and Malik 1997, equation 3. The unknown ``ln E_i`` of each sample is eliminated first: it
    is the weighted mean of its rows, so subtracting that mean leaves 256 unknowns instead of 256 + N.
    """
    samples = np.asarray(samples, dtype=np.intp)
    log_times = np.log(np.asarray(exposure_times, dtype=np.float64))
    points, photos = samples.shape
    weight = debevec_weight(samples)
    share = weight**2 / (weight**2).sum(axis=1, keepdims=True)

    data = np.zeros((points, photos, RESPONSE_KNOTS))
    point = np.arange(points)
    for j in range(photos):
        data[point, j, samples[:, j]] += 1.0
        for k in range(photos):
            data[point, j, samples[:, k]] -= share[:, k]
    right = log_times - (share * log_times).sum(axis=1, keepdims=True)
    data *= weight[..., None]
    right = right * weight

    inner = np.arange(1, RESPONSE_KNOTS - 1)
    bending = np.zeros((inner.size, RESPONSE_KNOTS))
    row = np.arange(inner.size)
    factor = smoothness * debevec_weight(inner)
    bending[row, inner - 1] = factor
    bending[row, inner] = -2 * factor
    bending[row, inner + 1] = factor

    anchor = np.zeros((1, RESPONSE_KNOTS))
    anchor[0, MID_KNOT] = 1.0

    system = np.concatenate([data.reshape(-1, RESPONSE_KNOTS), bending, anchor])
    target = np.concatenate([right.ravel(), np.zeros(inner.size + 1)])
    curve = np.linalg.lstsq(system, target, rcond=None)[0]
    # Rounded far below what matters, so that the summation order of a threaded BLAS does not show.
    return np.round(curve - curve[MID_KNOT], 6)
