"""Errors of disparity maps, by region."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.model import Disparity


def known(disparity: Disparity, truth: Disparity, region: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Return where both maps have a value, within `region`, ``(H, W)`` bool."""
    both = disparity.valid & truth.valid
    return both if region is None else both & region


def bad_share(
    disparity: Disparity, truth: Disparity, *, threshold: float, region: NDArray[np.bool_] | None = None
) -> float:
    """Return the share (0..1) of pixels that are off by more than `threshold` pixels ("bad-N"); NaN without any.

    Parameters
    ----------
    disparity, truth
        Maps of the same view. Pixels without a value in either do not count.
    threshold
        Pixels, >= 0.
    region
        ``(H, W)`` bool, where to look; everywhere by default.
    """
    there = known(disparity, truth, region)
    error = np.abs(disparity.values[there] - truth.values[there])
    return float(np.mean(error > threshold)) if error.size else float("nan")


def end_point_error(disparity: Disparity, truth: Disparity, *, region: NDArray[np.bool_] | None = None) -> float:
    """Return the mean absolute disparity error in pixels; NaN without any pixel. Parameters as in `bad_share`."""
    there = known(disparity, truth, region)
    error = np.abs(disparity.values[there] - truth.values[there])
    return float(error.mean()) if error.size else float("nan")
