"""Pictures that show at a glance whether a rectification or a calibration is good."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.rectification.calibration import BoardCalibration
from stereohdr.rectification.features import normalised_view
from stereohdr.rectification.pair import RectifiedPair

Picture = NDArray[np.uint8]

VIEW_WIDTH = 900
"""Pixels to which a view is reduced."""

LINES = 24
"""Lines that are drawn across both views."""

_LINE, _GOOD, _BAD = (60, 220, 90), (60, 220, 90), (235, 60, 50)

BAD_ERROR = 1.0
"""Pixels of reprojection error at which a corner is drawn red; between 0 and this, from green on."""


def rows_picture(pair: RectifiedPair) -> Picture:
    """Return both rectified views side by side, brought to equal brightness, with lines along the rows.

    Returns
    -------
    ``(H, W, 3)`` uint8. What a line meets on the left it must meet on the right.
    """
    from PIL import Image, ImageDraw

    width, height = pair.rectification.size
    scale = min(1.0, VIEW_WIDTH / width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    sheet = Image.new("RGB", (2 * size[0] + 8, size[1]), (24, 24, 26))
    for number, photo in enumerate((pair.left, pair.right)):
        view = Image.fromarray(normalised_view(photo)).resize(size, Image.Resampling.LANCZOS)
        sheet.paste(view.convert("RGB"), (number * (size[0] + 8), 0))
    draw = ImageDraw.Draw(sheet)
    for line in range(1, LINES):
        y = line * size[1] // LINES
        draw.line([(0, y), (sheet.width, y)], fill=_LINE)
    return np.asarray(sheet)


def coverage_picture(result: BoardCalibration) -> Picture:
    """Return where in both views corners were seen, green where they fit and red where they do not.

    Returns
    -------
    ``(H, W, 3)`` uint8.
    """
    from PIL import Image, ImageDraw

    size = result.pairs[0][0].size
    scale = min(1.0, VIEW_WIDTH / size[0])
    width, height = (max(1, round(side * scale)) for side in size)
    sheet = Image.new("RGB", (2 * width + 8, height), (90, 90, 90))
    draw = ImageDraw.Draw(sheet)
    for side in (0, 1):
        start = side * (width + 8)
        draw.rectangle([start, 0, start + width - 1, height - 1], fill=(24, 24, 26))
        own = width / result.pairs[0][side].size[0]
        for pair, errors in zip(result.pairs, result.errors, strict=True):
            share = min(1.0, float(errors[side]) / BAD_ERROR)
            colour = tuple(round(good + share * (bad - good)) for good, bad in zip(_GOOD, _BAD, strict=True))
            for x, y in pair[side].corners * own:
                draw.ellipse([start + x - 2, y - 2, start + x + 2, y + 2], fill=colour)
    return np.asarray(sheet)
