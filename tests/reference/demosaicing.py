"""Twin of stereohdr.demosaicing._kernels: the filters as Malvar, He and Cutler print them (times 8)."""

import numpy as np

GREEN_AT_RED_OR_BLUE = np.array(
    [[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]
)
SAME_ROW_AT_GREEN = np.array(
    [[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]
)
OPPOSITE_COLOUR = np.array(
    [[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]
)


def interpolate_colours(mosaic, colours, white, strength, rgb):
    padded = np.pad(mosaic, 2, mode="reflect").astype(float)
    height, width = mosaic.shape
    cell = np.tile(colours, (3, 3))
    for y in range(height):
        for x in range(width):
            window = padded[y : y + 5, x : x + 5]
            channels = cell[y % 2 :, x % 2 :][:5, :5]
            own, at_edge = channels[2, 2], False
            for channel in range(3):
                if channel == own:
                    rgb[y, x, channel] = mosaic[y, x]
                    continue
                if own != 1:
                    kernel = GREEN_AT_RED_OR_BLUE if channel == 1 else OPPOSITE_COLOUR
                else:
                    kernel = SAME_ROW_AT_GREEN if channels[2, 1] == channel else SAME_ROW_AT_GREEN.T
                averaged = (channels == channel) & (kernel != 0)
                samples = window[averaged]
                if (samples >= white).any():
                    rgb[y, x, channel] = white
                    at_edge |= samples.min() < white / 2
                    continue
                value = (window * kernel)[averaged].sum() / 8
                bending = (channels == own) & (kernel != 0)
                if (window[bending] < white).all():
                    value += strength[channel, own] * (window * kernel)[bending].sum() / 8
                rgb[y, x, channel] = int(np.floor(np.clip(value, samples.min(), samples.max()) + 0.5))
            if at_edge:
                rgb[y, x] = white
