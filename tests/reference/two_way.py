"""Twins of stereohdr.disparity._two_way_kernels, pixel by pixel from the definitions."""

import numpy as np

from stereohdr import DisparityFlag


def partner_column(x, disparity, sign, width):
    """None if it is outside."""
    place = x + sign * float(disparity)
    return x + sign * round(float(disparity)) if 0 <= place <= width - 1 else None


def confirm(own, other, sign, tolerance):
    confirmed = np.zeros(own.shape, bool)
    for y, x in np.ndindex(own.shape):
        partner = partner_column(x, own[y, x], sign, own.shape[1])
        confirmed[y, x] = partner is not None and abs(other[y, partner] - own[y, x]) <= tolerance
    return confirmed


def combine(own, other, own_margin, other_margin, own_confirmed, other_confirmed, settings):
    tolerance, one_run, usual_margin = settings
    second = ~own_confirmed & other_confirmed
    values = np.where(second, other, own)
    margin = np.where(second, other_margin, own_margin).astype(np.float64)
    both = own_confirmed & other_confirmed & (np.abs(own - other) <= tolerance)
    confidence = np.where(both, 1, one_run) * margin / (margin + usual_margin)
    return values, np.where(own_confirmed | other_confirmed, confidence, 0)


def mark(confirmed, other, other_confirmed, sign):
    flags = np.where(confirmed, DisparityFlag.MATCHED, DisparityFlag.OCCLUDED)
    for y, x in np.argwhere(other_confirmed):
        partner = partner_column(x, other[y, x], sign, other.shape[1])
        if partner is not None and not confirmed[y, partner]:
            flags[y, partner] = DisparityFlag.MISMATCHED
    return flags


def fill_disparity(values, flags):
    matched = flags == DisparityFlag.MATCHED
    filled = np.full(values.shape, np.median(values[matched]) if matched.any() else 0, np.float32)
    for y, x in np.ndindex(values.shape):
        columns = np.flatnonzero(matched[y])
        nearest = [*columns[columns <= x][-1:], *columns[columns >= x][:1]]
        if nearest:
            filled[y, x] = values[y, nearest].min()
    return filled
