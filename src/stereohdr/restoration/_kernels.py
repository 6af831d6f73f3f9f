"""Hot loops of the restoration; readable twins in tests/reference/restoration.py."""

from __future__ import annotations

import numpy as np

from stereohdr.kernels import kernel


@kernel
def fill_along_rays(segments, valid, luminance, guide, hole, source):
    """Write into ``source[y, x]`` of each hole the flat index of the pixel that fills it, or -1.

    The four rays go left, right, up, down through the hole's own segment to the first valid pixel; of those
    found, the one whose `luminance` is nearest the `guide` at the hole wins, ties in that order.
    """
    height, width = segments.shape
    # For each direction the first valid pixel met, by one sweep against that direction.
    left = np.full((height, width), -1, dtype=np.int32)
    right = np.full((height, width), -1, dtype=np.int32)
    up = np.full((height, width), -1, dtype=np.int32)
    down = np.full((height, width), -1, dtype=np.int32)
    for y in range(height):
        for x in range(width):
            if valid[y, x]:
                left[y, x] = y * width + x
                up[y, x] = y * width + x
                continue
            if x > 0 and segments[y, x - 1] == segments[y, x]:
                left[y, x] = left[y, x - 1]
            if y > 0 and segments[y - 1, x] == segments[y, x]:
                up[y, x] = up[y - 1, x]
    for y in range(height - 1, -1, -1):
        for x in range(width - 1, -1, -1):
            if valid[y, x]:
                right[y, x] = y * width + x
                down[y, x] = y * width + x
                continue
            if x < width - 1 and segments[y, x + 1] == segments[y, x]:
                right[y, x] = right[y, x + 1]
            if y < height - 1 and segments[y + 1, x] == segments[y, x]:
                down[y, x] = down[y + 1, x]
    values = luminance.reshape(-1)
    for y in range(height):
        for x in range(width):
            source[y, x] = -1
            if not hole[y, x]:
                continue
            nearest = np.float32(np.inf)
            for candidate in (left[y, x], right[y, x], up[y, x], down[y, x]):
                if candidate >= 0:
                    difference = abs(values[candidate] - guide[y, x])
                    if difference < nearest:
                        nearest = difference
                        source[y, x] = candidate


@kernel
def fill_from_nearest(segments, valid, hole, source):
    """Give holes without a source that of the valid pixel fewest eight-connected steps away in the segment.

    Among equally near pixels the first in reading order. `source` stays -1 in segments without a valid pixel.
    """
    height, width = segments.shape
    nearest = np.full((height, width), -1, dtype=np.int32)
    steps = np.full((height, width), -1, dtype=np.int32)
    front = np.empty(height * width, dtype=np.int32)
    following = np.empty(height * width, dtype=np.int32)
    size = 0
    for y in range(height):
        for x in range(width):
            if valid[y, x]:
                nearest[y, x] = y * width + x
                steps[y, x] = 0
                front[size] = y * width + x
                size += 1
    step = 0
    while size > 0:
        step += 1
        next_size = 0
        for i in range(size):
            y = front[i] // width
            x = front[i] % width
            for yy in range(max(0, y - 1), min(height, y + 2)):
                for xx in range(max(0, x - 1), min(width, x + 2)):
                    if segments[yy, xx] != segments[y, x]:
                        continue
                    if steps[yy, xx] < 0:
                        steps[yy, xx] = step
                        nearest[yy, xx] = nearest[y, x]
                        following[next_size] = yy * width + xx
                        next_size += 1
                    elif steps[yy, xx] == step and nearest[y, x] < nearest[yy, xx]:
                        nearest[yy, xx] = nearest[y, x]
        front, following = following, front
        size = next_size
    for y in range(height):
        for x in range(width):
            if hole[y, x] and source[y, x] < 0:
                source[y, x] = nearest[y, x]


@kernel
def pass_across(image, feedback, start):
    """Filter rows of ``image``, ``(H, W, C)`` float32, in place, forth and back.

    ``feedback[i, x]``, ``(rows, W)`` float32, is that between columns x - 1 and x of row start + i.
    """
    _, width, channels = image.shape
    one = np.float32(1.0)
    for i in range(feedback.shape[0]):
        y = start + i
        for x in range(1, width):
            v = feedback[i, x]
            for c in range(channels):
                image[y, x, c] = (one - v) * image[y, x, c] + v * image[y, x - 1, c]
        for x in range(width - 2, -1, -1):
            v = feedback[i, x + 1]
            for c in range(channels):
                image[y, x, c] = (one - v) * image[y, x, c] + v * image[y, x + 1, c]


@kernel
def pass_down(image, feedback, start):
    """Filter columns of ``image``, ``(H, W, C)`` float32, in place, forth and back.

    ``feedback[y, j]``, ``(H, columns)`` float32, is that between rows y - 1 and y of column start + j.
    """
    height, _, channels = image.shape
    columns = feedback.shape[1]
    one = np.float32(1.0)
    for y in range(1, height):
        for j in range(columns):
            v = feedback[y, j]
            for c in range(channels):
                image[y, start + j, c] = (one - v) * image[y, start + j, c] + v * image[y - 1, start + j, c]
    for y in range(height - 2, -1, -1):
        for j in range(columns):
            v = feedback[y + 1, j]
            for c in range(channels):
                image[y, start + j, c] = (one - v) * image[y, start + j, c] + v * image[y + 1, start + j, c]


@kernel
def nearest_background(disparity, known, hole, source):
    """Write into ``source[y, x]`` of each hole the column of the background pixel of its row, or -1.

    Of the nearest known pixels to the left and to the right, the one of smaller disparity; the nearer one, then
    the left one, where these are equal.
    """
    height, width = disparity.shape
    left = np.empty(width, dtype=np.int32)
    for y in range(height):
        last = -1
        for x in range(width):
            if known[y, x]:
                last = x
            left[x] = last
        right = -1
        for x in range(width - 1, -1, -1):
            if known[y, x]:
                right = x
            source[y, x] = -1
            if not hole[y, x]:
                continue
            chosen = left[x]
            if chosen < 0:
                chosen = right
            elif right >= 0:
                difference = disparity[y, right] - disparity[y, chosen]
                if difference < 0 or (difference == 0 and right - x < x - chosen):
                    chosen = right
            source[y, x] = chosen
