"""Fusion of both views: by a weight map (equation 12), or by weights from the codes (Debevec and Malik)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import DomainTransformConfig
from stereohdr.model import Photo, SourceFlag
from stereohdr.restoration import edge_preserving_filter

NEGLIGIBLE_WEIGHT = 1 / 256
"""Smaller weights change less than a code would; they become 0, so that a measured pixel stays as it is."""


def weight_map(
    exposure_map: NDArray[np.bool_],
    guide: NDArray[np.float32],
    *,
    config: DomainTransformConfig | None = None,
    threads: int | None = None,
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
    threads
        Threads to use; does not change the result.

    Returns
    -------
    ``(H, W)`` float32, W in 0..1. Source: paper Figure 13.
    """
    rough = exposure_map[..., None].astype(np.float32)
    smooth = np.clip(edge_preserving_filter(rough, guide, config=config, threads=threads)[..., 0], 0.0, 1.0)
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


BOUND_WEIGHT = 1e-6
"""Weight of a clipped code that still bounds the radiance; any code that is not clipped outweighs it."""


def code_weight(photo: Photo, *, shorter: bool) -> NDArray[np.float32]:
    """Return how far each code can be trusted: a hat that vanishes where the sensor clips.

    Parameters
    ----------
    photo
        ``(H, W, C)`` codes.
    shorter
        Whether this is the shorter one of two exposures. What is white in both is at least as bright as the
        shorter exposure says, what is black in both at most as bright as the longer one says: these codes have
        `BOUND_WEIGHT`, those of the other photo 0.

    Returns
    -------
    ``(H, W, C)`` float32: ``min(z, white - z)`` in units of half the white level, 0..1. Source: Debevec and Malik
    1997, equation 4.
    """
    codes = np.arange(photo.white + 1, dtype=np.float64)
    hat = np.minimum(codes, photo.white - codes) / (0.5 * photo.white)
    hat[-1 if shorter else 0] = BOUND_WEIGHT
    return hat.astype(np.float32)[photo.codes]


def merge_views(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    main_weight: NDArray[np.float32],
    auxiliary_weight: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Merge the views channel by channel, as exposures of one camera are merged.

    Parameters
    ----------
    main, auxiliary
        ``(H, W, C)`` float32, radiance of the main view, positive, and of the auxiliary view warped into it.
    main_weight, auxiliary_weight
        ``(H, W, C)`` float32, >= 0; 0 for the auxiliary view where nothing was warped to.

    Returns
    -------
    merged
        ``(H, W, C)`` float32, ``ln R = (w_m ln R_m + w_a ln R_a) / (w_m + w_a)``; `main` exactly where the
        auxiliary view has no share.
    share
        ``(H, W, C)`` float32, ``w_a / (w_m + w_a)``, 0 where that is below `NEGLIGIBLE_WEIGHT`.

    Notes
    -----
    Source: Debevec and Malik 1997, equation 6.
    """
    total = main_weight + auxiliary_weight
    share = auxiliary_weight / np.where(total > 0, total, np.float32(1))
    share = np.where(share < NEGLIGIBLE_WEIGHT, np.float32(0), share)
    used = share > 0
    log_main, log_auxiliary = np.log(main), np.log(np.where(used, auxiliary, main))
    merged = np.exp(log_main + share * (log_auxiliary - log_main))
    return np.where(used, merged, main), share


def merge_flags(
    weight: NDArray[np.float32], *, exposure_map: NDArray[np.bool_], filled: NDArray[np.bool_] | None = None
) -> NDArray[np.uint8]:
    """Say for each pixel of a merge where its radiance comes from.

    Parameters
    ----------
    weight
        ``(H, W)`` float32, share of the auxiliary view.
    exposure_map
        ``(H, W)`` bool, S.
    filled
        ``(H, W)`` bool, pixels whose auxiliary radiance is borrowed from another place; none by default.

    Returns
    -------
    ``(H, W)`` uint8 of `SourceFlag`.
    """
    used = weight > 0
    flags = np.where(used, SourceFlag.AUXILIARY, SourceFlag.MEASURED).astype(np.uint8)
    if filled is not None:
        flags[used & filled] = SourceFlag.FILLED_OCCLUDED
    flags[~used & exposure_map] = SourceFlag.NO_INFORMATION
    return flags
