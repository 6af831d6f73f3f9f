"""Poisson image editing of the holes (equation 11; Perez, Gangnet and Blake, SIGGRAPH 2003)."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu


def poisson_edit(
    filled: NDArray[np.float32],
    valid: NDArray[np.bool_],
    holes: NDArray[np.bool_],
    main: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Replace the holes by the radiance whose gradient is nearest the main view's.

    Parameters
    ----------
    filled
        ``(H, W, C)`` float32, R_a^e; only its values at `valid` pixels next to a hole matter.
    valid
        ``(H, W)`` bool, pixels with known radiance (Dirichlet boundary).
    holes
        ``(H, W)`` bool, Omega, disjoint from `valid`.
    main
        ``(H, W, C)`` float32, R_m^i, whose gradient is the guidance.

    Returns
    -------
    edited
        ``(H, W, C)`` float32, R_a^f: equal to `filled` outside the holes.
    unbounded
        ``(H, W)`` bool, holes that touch no valid pixel: they keep the main view's radiance.

    Notes
    -----
    Four-connected; no flux across the image border nor towards pixels that are neither hole nor valid. With
    u = R_a^f - R_m^i equation 11 is Laplace's equation: u is the membrane through the differences at the
    boundary. One sparse factorisation serves all channels.
    """
    unbounded = holes & ~_touches(holes, valid)
    unknown = holes & ~unbounded
    edited = filled.copy()
    edited[unbounded] = main[unbounded]
    count = int(unknown.sum())
    if count == 0:
        return edited, unbounded

    channels = main.shape[2]
    index = np.full(unknown.shape, -1, dtype=np.int64)
    index[unknown] = np.arange(count)
    difference = filled.astype(np.float64) - main
    degree = np.zeros(count)
    right = np.zeros((count, channels))
    rows, columns = [], []
    for here, there in _neighbour_views(unknown.ndim):
        own, other = index[here], index[there]
        linked = (own >= 0) & (other >= 0)
        rows.append(own[linked])
        columns.append(other[linked])
        degree[own[linked]] += 1.0
        bounded = (own >= 0) & valid[there]
        degree[own[bounded]] += 1.0
        right[own[bounded]] += difference[there][bounded]
    row, column = np.concatenate(rows), np.concatenate(columns)
    matrix = sparse.csc_matrix(
        (
            np.concatenate([degree, np.full(row.size, -1.0)]),
            (np.concatenate([np.arange(count), row]), np.concatenate([np.arange(count), column])),
        ),
        shape=(count, count),
    )
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    membrane = factor.solve(right)
    edited[unknown] = (main[unknown] + membrane).astype(np.float32)
    return edited, unbounded


def _neighbour_views(dimensions: int) -> list[tuple[tuple[slice, ...], tuple[slice, ...]]]:
    """Return pairs of index expressions that address each pixel and its neighbour, four directions in 2-D."""
    views = []
    for axis in range(dimensions):
        low = tuple(slice(None, -1) if a == axis else slice(None) for a in range(dimensions))
        high = tuple(slice(1, None) if a == axis else slice(None) for a in range(dimensions))
        views += [(low, high), (high, low)]
    return views


def _touches(holes: NDArray[np.bool_], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the holes whose four-connected component has a valid pixel beside it."""
    components, count = cast(tuple[NDArray[np.int32], int], ndimage.label(holes))
    bounded = np.zeros(count + 1, dtype=bool)
    for here, there in _neighbour_views(holes.ndim):
        bounded[components[here][valid[there]]] = True
    bounded[0] = False
    return bounded[components]
