"""Poisson image editing of the holes (equation 11; Perez, Gangnet and Blake, SIGGRAPH 2003)."""

from __future__ import annotations

from functools import partial
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.restoration.screened_poisson import solve_screened_poisson
from stereohdr.strips import run_together

ACCURACY = 3e-8
"""Error of the membrane relative to the largest difference at the boundary: about what float32 can tell."""


def poisson_edit(
    filled: NDArray[np.float32],
    valid: NDArray[np.bool_],
    holes: NDArray[np.bool_],
    main: NDArray[np.float32],
    *,
    threads: int | None = None,
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
    threads
        Threads to use, one per channel at most; does not change the result.

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
    boundary.
    """
    unbounded = holes & ~_touches(holes, valid)
    unknown = holes & ~unbounded
    edited = filled.copy()
    edited[unbounded] = main[unbounded]
    if not unknown.any():
        return edited, unbounded
    nothing = np.zeros(unknown.shape, dtype=np.float32)
    links = _links(unknown | valid)

    def edit(channel: int) -> None:
        difference = np.where(valid, filled[..., channel] - main[..., channel], np.float32(0))
        membrane = solve_screened_poisson(
            unknown,
            difference,
            data=nothing,
            data_weight=nothing,
            gradient_x=nothing,
            gradient_y=nothing,
            weight_x=links[0],
            weight_y=links[1],
            tolerance=ACCURACY * float(np.abs(difference).max()),
            threads=1,
        )
        edited[unknown, channel] = main[unknown, channel] + membrane[unknown]

    run_together(*(partial(edit, c) for c in range(main.shape[2])), threads=threads)
    return edited, unbounded


def _links(known: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return 1 where a pixel and the next one in its row, and in its column, are known, else 0."""
    along, down = (np.zeros(known.shape, dtype=np.float32) for _ in range(2))
    along[:, :-1] = known[:, :-1] & known[:, 1:]
    down[:-1] = known[:-1] & known[1:]
    return along, down


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
