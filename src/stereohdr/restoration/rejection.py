"""Rejection of uncertain warped pixels by comparing 3x3 bit patterns (reference 28 of the paper)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import RejectionConfig

OFFSETS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]


def reject_uncertain(
    main: NDArray[np.float32],
    warped: NDArray[np.float32],
    arrived: NDArray[np.bool_],
    *,
    config: RejectionConfig | None = None,
) -> NDArray[np.bool_]:
    """Keep the warped pixels whose neighbourhood has the same structure in both views.

    A pixel's pattern has one bit per pixel of its 3x3 patch, set where the luminance is at least the patch mean. A
    hole has the radiance 0 in the warped view, so a pixel beside a hole is kept only if the main view is dark
    there, too. At the image border the patch is what lies inside.

    Parameters
    ----------
    main, warped
        ``(H, W)`` float32 luminance of R_m^i and R_a^w.
    arrived
        ``(H, W)`` bool, where `warped` has a value.
    config
        Tolerance; or no rejection at all.

    Returns
    -------
    ``(H, W)`` bool, True where the warped pixel is kept. Source: paper section 2.3, Figure 10.
    """
    config = config or RejectionConfig()
    if not config.enabled:
        return arrived.copy()
    filled = np.where(arrived, warped, np.float32(0.0))
    return arrived & (_pattern(main, config.tolerance) == _pattern(filled, config.tolerance))


def _pattern(luminance: NDArray[np.float32], tolerance: float) -> NDArray[np.uint16]:
    height, width = luminance.shape
    values = np.pad(luminance.astype(np.float64), 1)
    inside = np.pad(np.ones((height, width), dtype=bool), 1)

    def shifted(array: NDArray[Any], dy: int, dx: int) -> NDArray[Any]:
        return array[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]

    total = sum(shifted(values, *offset) for offset in OFFSETS)
    count = sum(shifted(inside, *offset).astype(np.float64) for offset in OFFSETS)
    threshold = total / count * (1.0 - tolerance)
    bits = np.zeros((height, width), dtype=np.uint16)
    for n, offset in enumerate(OFFSETS):
        at_least = shifted(inside, *offset) & (shifted(values, *offset) >= threshold)
        bits |= at_least.astype(np.uint16) << np.uint16(n)
    return bits
