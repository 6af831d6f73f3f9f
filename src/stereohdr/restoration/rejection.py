"""Rejection of uncertain warped pixels by comparing 3x3 bit patterns (reference 28 of the paper)."""

from __future__ import annotations

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

    A pixel's pattern has one bit per pixel of its 3x3 patch, set where the luminance is at least the patch
    mean. The patch consists of the places where a warped pixel arrived (in both views the same places): a
    hole has no radiance to compare.

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
    return arrived & (_pattern(main, arrived, config) == _pattern(warped, arrived, config))


def _pattern(
    luminance: NDArray[np.float32], present: NDArray[np.bool_], config: RejectionConfig
) -> NDArray[np.uint16]:
    height, width = luminance.shape
    values = np.pad(luminance.astype(np.float64), 1)
    inside = np.pad(present, 1)

    def shifted(array: NDArray, dy: int, dx: int) -> NDArray:
        return array[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]

    total = np.zeros((height, width))
    count = np.zeros((height, width))
    for offset in OFFSETS:
        there = shifted(inside, *offset)
        total += np.where(there, shifted(values, *offset), 0.0)
        count += there
    mean = total / np.maximum(count, 1)
    threshold = mean * (1.0 - config.tolerance)
    bits = np.zeros((height, width), dtype=np.uint16)
    for n, offset in enumerate(OFFSETS):
        at_least = shifted(inside, *offset) & (shifted(values, *offset) >= threshold)
        bits |= at_least.astype(np.uint16) << np.uint16(n)
    return bits
