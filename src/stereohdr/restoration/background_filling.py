"""Filling of unmatched pixels from the background beside them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.model import Disparity, DisparityFlag
from stereohdr.restoration._kernels import nearest_background


def fill_from_background(
    warped: NDArray[np.float32], disparity: Disparity, holes: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Give each hole what the nearest background pixel of its row has: what is hidden belongs to the background.

    Parameters
    ----------
    warped
        ``(H, W, C)`` float32 in the pixels of `disparity`.
    disparity
        ``(H, W)`` map; values are copied from its ``MATCHED`` pixels only.
    holes
        ``(H, W)`` bool, disjoint from them.

    Returns
    -------
    filled
        ``(H, W, C)`` float32. Of the nearest matched pixels to the left and to the right, the one of smaller
        disparity is copied; the nearer one, then the left one, where these are equal.
    found
        ``(H, W)`` bool, holes that were filled; rows without a matched pixel keep theirs.
    """
    known = disparity.flags == DisparityFlag.MATCHED
    column = np.empty(known.shape, dtype=np.int32)
    nearest_background(disparity.values, known, holes, column)
    found = column >= 0
    y, x = np.nonzero(found)
    filled = warped.copy()
    filled[y, x] = warped[y, column[y, x]]
    return filled, found
