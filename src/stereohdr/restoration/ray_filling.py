"""Hole filling along four rays inside segments (paper section 2.3, Figure 11)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.radiance import luminance
from stereohdr.restoration._kernels import fill_along_rays, fill_from_nearest


def fill_holes(
    warped: NDArray[np.float32],
    valid: NDArray[np.bool_],
    holes: NDArray[np.bool_],
    main: NDArray[np.float32],
    segments: NDArray[np.int32],
) -> NDArray[np.float32]:
    """Give every hole a radiance from its own segment.

    Parameters
    ----------
    warped
        ``(H, W, C)`` float32, warped auxiliary radiance R_a^w.
    valid
        ``(H, W)`` bool, pixels of `warped` to copy from.
    holes
        ``(H, W)`` bool, pixels to fill; disjoint from `valid`.
    main
        ``(H, W, C)`` float32, initial main radiance R_m^i.
    segments
        ``(H, W)`` int32, segments G_m of the main view.

    Returns
    -------
    ``(H, W, C)`` float32, R_a^h: `warped` with the holes filled by the first valid pixel to the left, right,
    above or below in the same segment whose luminance is nearest the main view's; without any, by the valid
    pixel of the segment that is the fewest steps away; without any, by the main view.
    """
    main_luminance = luminance(main)
    source = np.empty(valid.shape, dtype=np.int32)
    fill_along_rays(segments, valid, luminance(warped), main_luminance, holes, source)
    fill_from_nearest(segments, valid, holes, source)
    filled = warped.copy()
    found = source >= 0
    filled[found] = warped.reshape(-1, warped.shape[2])[source[found]]
    lost = holes & ~found
    filled[lost] = main[lost]
    return filled
