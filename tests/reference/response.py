"""Twin of stereohdr.response.debevec1997: the full system with every ln E_i as an unknown."""

import numpy as np


def solve_response(samples, exposure_times, smoothness=20.0):
    points, photos = samples.shape
    rows, right = [], []
    for i in range(points):
        for j in range(photos):
            z = samples[i, j]
            w = min(z + 1, 256 - z)
            row = np.zeros(256 + points)
            row[z] = w
            row[256 + i] = -w
            rows.append(row)
            right.append(w * np.log(exposure_times[j]))
    for z in range(1, 255):
        row = np.zeros(256 + points)
        row[z - 1 : z + 2] = smoothness * min(z + 1, 256 - z) * np.array([1.0, -2.0, 1.0])
        rows.append(row)
        right.append(0.0)
    row = np.zeros(256 + points)
    row[128] = 1.0
    rows.append(row)
    right.append(0.0)
    return np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0][:256]
