"""Hot loops of the two-way matching; readable twins in tests/reference/two_way.py.

All images are ``(H, W)``. A pixel's partner is in the same row of the other view at the column ``x + sign * d``,
rounded; the disparity is rounded, not the column, so that in a mirror halves go the same way.
"""

from __future__ import annotations

import numpy as np

from stereohdr.kernels import kernel

OCCLUDED, MATCHED, MISMATCHED = np.uint8(2), np.uint8(1), np.uint8(3)
"""As in `DisparityFlag`."""


@kernel
def partner_column(x, disparity, sign, width):
    """Return the column of a pixel's partner, or -1 if that is outside."""
    place = x + sign * np.float64(disparity)
    if not 0 <= place <= width - 1:
        return -1
    return min(max(x + sign * int(np.rint(disparity)), 0), width - 1)


@kernel
def confirm(own, other, sign, tolerance, confirmed):
    """Write where a pixel's partner has nearly the same disparity."""
    height, width = own.shape
    for y in range(height):
        for x in range(width):
            partner = partner_column(x, own[y, x], sign, width)
            confirmed[y, x] = partner >= 0 and abs(other[y, partner] - own[y, x]) <= tolerance


@kernel
def combine(own, other, own_margin, other_margin, own_confirmed, other_confirmed, settings, values, confidence):
    """Write disparity and confidence from two runs: those of the first, unless only the second is confirmed.

    `settings` are the tolerance, the confidence of a single run, and the margin at which it halves.
    """
    tolerance, one_run, usual_margin = settings
    height, width = own.shape
    for y in range(height):
        for x in range(width):
            first, second = own_confirmed[y, x], other_confirmed[y, x]
            values[y, x] = own[y, x] if first or not second else other[y, x]
            confidence[y, x] = 0
            if first or second:
                margin = np.float32(own_margin[y, x] if first else other_margin[y, x])
                agreed = first and second and abs(own[y, x] - other[y, x]) <= tolerance
                clearness = margin / (margin + usual_margin) if margin > 0 else np.float32(0)
                confidence[y, x] = clearness if agreed else one_run * clearness


@kernel
def mark(confirmed, other, other_confirmed, sign, flags):
    """Write flags: what is not confirmed is hidden, unless a confirmed pixel of the other view meets it.

    `sign` is that of the other view.
    """
    height, width = confirmed.shape
    for y in range(height):
        for x in range(width):
            flags[y, x] = OCCLUDED
        for x in range(width):
            if other_confirmed[y, x]:
                partner = partner_column(x, other[y, x], sign, width)
                if partner >= 0:
                    flags[y, partner] = MISMATCHED
        for x in range(width):
            if confirmed[y, x]:
                flags[y, x] = MATCHED


@kernel
def fill_rows(values, flags, filled, found):
    """Give every pixel that is not matched the smaller disparity of the nearest matched pixels of its row.

    Write in `found` ``(H,)`` which rows have a matched pixel; nothing is written to the others.
    """
    height, width = values.shape
    for y in range(height):
        last = -1
        for x in range(width):
            if flags[y, x] == MATCHED:
                filled[y, x] = values[y, x]
                for gap in range(last + 1, x):
                    filled[y, gap] = values[y, x] if last < 0 else min(values[y, last], values[y, x])
                last = x
        found[y] = last >= 0
        if last >= 0:
            filled[y, last:] = values[y, last]
