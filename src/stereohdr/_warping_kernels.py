"""Hot loop of the backward warping; readable twin in tests/reference/warping.py."""

from __future__ import annotations

import numpy as np

from stereohdr.kernels import kernel


@kernel
def fetch_rows(image, disparity, known, start, stop, fetched, arrived):
    """Write for rows start to stop what lies at column ``x - d`` of `image`, ``(H, W, C)``, where d is known."""
    width, channels = image.shape[1], image.shape[2]
    for y in range(start, stop):
        for x in range(width):
            place = x - np.float64(disparity[y, x])
            inside = known[y, x] and 0 <= place <= width - 1
            arrived[y, x] = inside
            if not inside:
                fetched[y, x] = 0
                continue
            before = int(place)
            after = min(before + 1, width - 1)
            share = np.float32(place - before)
            rest = np.float32(1) - share
            for c in range(channels):
                value = image[y, before, c]
                fetched[y, x, c] = rest * value + share * image[y, after, c] if share > 0 else value
