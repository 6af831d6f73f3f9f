"""Warping of the auxiliary view into the main view: forward (equation 10) and backward."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr._warping_kernels import fetch_rows
from stereohdr.model import Disparity, DisparityFlag
from stereohdr.strips import run_strips

STRIP_ROWS = 64


def warp_forward(
    radiance: NDArray[np.float32], disparity: Disparity
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Move every auxiliary pixel with a known disparity to its place in the main view.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, radiance of the auxiliary view.
    disparity
        Disparity of the auxiliary view; rounded to whole pixels.

    Returns
    -------
    warped
        ``(H, W, C)`` float32, R_a^w, in the main view's pixels; 0 where nothing arrived.
    arrived
        ``(H, W)`` bool, True where a pixel arrived.

    Notes
    -----
    Source: equation 10, ``x_main = x_auxiliary + d``. When several pixels arrive at one place the largest
    disparity (the nearest surface) wins.
    """
    height, width = disparity.values.shape
    shift = np.rint(disparity.values).astype(np.intp)
    y, x = np.nonzero(disparity.valid)
    d = shift[y, x]
    inside = x + d < width
    y, x, d = y[inside], x[inside], d[inside]
    # Of repeated targets the last assignment stays: nearest surfaces come last.
    order = np.argsort(d, kind="stable")
    y, x, d = y[order], x[order], d[order]
    warped = np.zeros_like(radiance)
    arrived = np.zeros((height, width), dtype=bool)
    warped[y, x + d] = radiance[y, x]
    arrived[y, x + d] = True
    return warped, arrived


def warp_backward(
    image: NDArray[np.float32], disparity: Disparity, *, threads: int | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Fetch for every matched main pixel its partner in the auxiliary view.

    Parameters
    ----------
    image
        ``(H, W, C)`` float32 of the auxiliary view.
    disparity
        Disparity of the **main** view.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    warped
        ``(H, W, C)`` float32 in the main view's pixels; 0 where nothing was fetched.
    arrived
        ``(H, W)`` bool, True where the disparity is ``MATCHED`` and ``x - d`` lies inside the auxiliary view.

    Notes
    -----
    ``x_auxiliary = x_main - d``, interpolated linearly between the two columns around it; whole disparities fetch
    the pixels as they are.
    """
    image = np.ascontiguousarray(image, dtype=np.float32)
    values = np.ascontiguousarray(disparity.values, dtype=np.float32)
    matched = np.ascontiguousarray(disparity.flags == DisparityFlag.MATCHED)
    warped, arrived = np.empty_like(image), np.empty(values.shape, dtype=bool)

    def task(start: int, stop: int) -> None:
        fetch_rows(image, values, matched, start, stop, warped, arrived)

    run_strips(task, len(image), strip_rows=STRIP_ROWS, threads=threads)
    return warped, arrived


def without_occluded(disparity: Disparity) -> Disparity:
    """Return the map with only its ``MATCHED`` pixels known: the others have no place in the other view."""
    matched = disparity.flags == DisparityFlag.MATCHED
    return Disparity(
        disparity.values, np.where(matched, disparity.flags, DisparityFlag.NOT_COMPUTED).astype(np.uint8)
    )


def main_view_disparity(of_auxiliary: Disparity) -> Disparity:
    """Carry a disparity map of the auxiliary view over to the main view.

    Returns
    -------
    ``(H, W)`` in the main view's pixels: the ``MATCHED`` values of `of_auxiliary`, each at its (rounded) partner,
    the largest where several meet; ``NOT_COMPUTED`` where none arrives.
    """
    values, arrived = warp_forward(
        of_auxiliary.values[..., None].astype(np.float32), without_occluded(of_auxiliary)
    )
    flags = np.where(arrived, DisparityFlag.MATCHED, DisparityFlag.NOT_COMPUTED).astype(np.uint8)
    return Disparity(values[..., 0], flags)


def auxiliary_view_disparity(of_main: Disparity) -> Disparity:
    """Carry a disparity map of the main view over to the auxiliary view; see `main_view_disparity`."""
    return main_view_disparity(of_main.mirrored()).mirrored()  # in a mirror the views change places
