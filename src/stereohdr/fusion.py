"""Weight map and fusion of the main view with the restored auxiliary view (equation 12)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import DomainTransformConfig
from stereohdr.model import SourceFlag
from stereohdr.restoration import edge_preserving_filter

NEGLIGIBLE_WEIGHT = 1 / 256
"""Smaller weights change less than a code would; they become 0, so that a measured pixel stays as it is."""


def weight_map(
    exposure_map: NDArray[np.bool_],
    guide: NDArray[np.float32],
    *,
    config: DomainTransformConfig | None = None,
) -> NDArray[np.float32]:
    """Smooth the map S without crossing edges of the main view.

    Parameters
    ----------
    exposure_map
        ``(H, W)`` bool, S.
    guide
        ``(H, W, C)`` float32, main radiance in the units of `DomainTransformConfig.range_sigma`.
    config
        Edge-preserving filter.

    Returns
    -------
    ``(H, W)`` float32, W in 0..1. Source: paper Figure 13.
    """
    smooth = edge_preserving_filter(exposure_map[..., None].astype(np.float32), guide, config=config)[..., 0]
    smooth = np.clip(smooth, 0.0, 1.0)
    return np.where(smooth < NEGLIGIBLE_WEIGHT, np.float32(0.0), smooth)


def blend(
    main: NDArray[np.float32],
    restored: NDArray[np.float32],
    weight: NDArray[np.float32],
    *,
    lowest: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Blend both views: ``R = (1 - W) R_m^i + W R_a^f``.

    Parameters
    ----------
    main, restored
        ``(H, W, C)`` float32, R_m^i and R_a^f.
    weight
        ``(H, W)`` float32, 0..1; pixels of weight 0 keep `main` exactly.
    lowest
        ``(C,)`` float32, smallest radiance that occurs in either photo; the unconstrained Poisson solution may
        fall below it, even below 0, and is raised to it.

    Returns
    -------
    ``(H, W, C)`` float32. Source: equation 12.
    """
    share = weight[..., None]
    blended = np.maximum((1 - share) * main + share * restored, lowest)
    return np.where(share > 0, blended, main)


def source_flags(
    *,
    weight: NDArray[np.float32],
    wanted_weight: NDArray[np.float32],
    exposure_map: NDArray[np.bool_],
    valid: NDArray[np.bool_],
    rejected: NDArray[np.bool_],
) -> NDArray[np.uint8]:
    """Say for each pixel where its radiance comes from.

    Parameters
    ----------
    weight, wanted_weight
        ``(H, W)`` float32, W as used, and before it was set to 0 where nothing was restored.
    exposure_map
        ``(H, W)`` bool, S.
    valid, rejected
        ``(H, W)`` bool, warped pixels that were kept, and that were rejected.

    Returns
    -------
    ``(H, W)`` uint8 of `SourceFlag`.
    """
    flags = np.full(weight.shape, SourceFlag.MEASURED, dtype=np.uint8)
    used = weight > 0
    flags[used] = SourceFlag.FILLED_OCCLUDED
    flags[used & rejected] = SourceFlag.FILLED_REJECTED
    flags[used & valid] = SourceFlag.AUXILIARY
    flags[~used & (wanted_weight > 0)] = SourceFlag.WEIGHT_CUT
    flags[~used & exposure_map] = SourceFlag.NO_INFORMATION
    return flags
