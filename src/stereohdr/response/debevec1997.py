"""Inverse response from samples of known exposure ratio (Debevec and Malik, SIGGRAPH 1997)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stereohdr.model import MID_KNOT, RESPONSE_KNOTS

if TYPE_CHECKING:
    from scipy import sparse


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
        ``(P,)``, or ``(N, P)`` if they differ by sample; positive, seconds (only ratios matter).
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
    from scipy import sparse  # only here: other users of this module start faster
    from scipy.sparse.linalg import splu

    samples = np.asarray(samples, dtype=np.intp)
    log_times = np.log(np.asarray(exposure_times, dtype=np.float64))
    photos = samples.shape[1]
    weight = debevec_weight(samples)
    share = weight**2 / (weight**2).sum(axis=1, keepdims=True)

    # Row (i, j): w_ij (g(z_ij) - sum_k share_ik g(z_ik)) = w_ij (ln t_j - sum_k share_ik ln t_k).
    factors = weight[:, :, None] * (np.eye(photos)[None] - share[:, None, :])
    data = _sparse_rows(factors.reshape(-1, photos), np.repeat(samples, photos, axis=0))
    right = weight * (log_times - (share * log_times).sum(axis=1, keepdims=True))

    inner = np.arange(1, RESPONSE_KNOTS - 1)
    bending = _sparse_rows(
        smoothness * debevec_weight(inner)[:, None] * [[1.0, -2.0, 1.0]], inner[:, None] + [[-1, 0, 1]]
    )
    anchor = _sparse_rows(np.array([[1.0]]), np.array([[MID_KNOT]]))

    system = sparse.vstack([data, bending, anchor]).tocsr()
    target = np.concatenate([right.ravel(), np.zeros(inner.size + 1)])
    # Sparse normal equations with two steps of refinement: as exact as an orthogonal solve here, and without the
    # threads of a dense BLAS, which stall on busy machines and make the last bits depend on their number.
    factor = splu((system.T @ system).tocsc())
    curve = np.zeros(RESPONSE_KNOTS)
    for _ in range(3):
        curve += factor.solve(system.T @ (target - system @ curve))
    return np.round(curve - curve[MID_KNOT], 6)


def _sparse_rows(values: NDArray[np.float64], columns: NDArray[np.integer]) -> sparse.csr_matrix:
    """Return the matrix whose row r holds ``values[r]`` in ``columns[r]``; repeated columns add up."""
    from scipy import sparse

    rows = np.repeat(np.arange(len(values)), values.shape[1])
    return sparse.csr_matrix((values.ravel(), (rows, columns.ravel())), shape=(len(values), RESPONSE_KNOTS))
