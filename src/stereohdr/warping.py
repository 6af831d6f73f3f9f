"""Forward warping of the auxiliary view into the main view (equation 10)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.model import Disparity


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
