"""Twins of stereohdr._survey_kernels."""

import numpy as np
from scipy import ndimage


def log_gradient(codes):
    """Of which `flat_rows` asks whether it is small."""
    log_code = np.log(codes.mean(axis=2, dtype=np.float64) + 3)
    return ndimage.gaussian_gradient_magnitude(log_code, 1.0, mode="nearest")


def joint_counts(main, auxiliary, disparity, used_main, used_auxiliary):
    height, width, channels = main.shape
    counts = np.zeros((channels, 256, 256), int)
    for y, x, c in np.ndindex(height, width, channels):
        d = float(disparity[y, x])
        partner = x - round(d)
        if used_main[y, x] and 0 <= x - d <= width - 1 and used_auxiliary[y, partner]:
            counts[c, main[y, x, c], auxiliary[y, partner, c]] += 1
    return counts
