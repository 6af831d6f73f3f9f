"""Twin of stereohdr._warping_kernels."""

import math

import numpy as np


def warp_backward(image, disparity, known):
    height, width, _ = image.shape
    warped, arrived = np.zeros(image.shape), np.zeros((height, width), bool)
    for y, x in np.ndindex(height, width):
        place = x - float(disparity[y, x])
        if known[y, x] and 0 <= place <= width - 1:
            before, after = math.floor(place), math.ceil(place)
            share = place - before
            warped[y, x] = (1 - share) * image[y, before] + share * image[y, after]
            arrived[y, x] = True
    return warped, arrived
