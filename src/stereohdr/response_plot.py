"""Picture of a response curve with the samples that it was fitted to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.model import RESPONSE_KNOTS
from stereohdr.response.rig import RigResponse

PANEL, STRIP, MARGIN = 400, 110, 52
"""Pixels: side of a channel's panel, height of its strip of residuals, space around both."""

RESIDUAL_LIMIT = 0.5
"""Largest residual (ln X) that the strip shows; larger ones lie on its border."""

MOST_DOTS = 4000
"""Samples drawn per channel, evenly picked."""

NAMES = {1: ("grey",), 3: ("red", "green", "blue")}
COLOURS = {"grey": (60, 60, 60), "red": (200, 40, 40), "green": (30, 140, 50), "blue": (40, 80, 200)}
DOT = (170, 170, 170)


def response_picture(response: RigResponse, *, title: str = "") -> NDArray[np.uint8]:
    """Draw ln X over the code, one panel per channel, and the residuals below.

    A sample stands at its first code, at the height that its second code says: with a perfect curve it lies on it.

    Parameters
    ----------
    response
        Curve and samples.
    title
        Line above the panels.

    Returns
    -------
    ``(H, W, 3)`` uint8.
    """
    from PIL import Image, ImageDraw, ImageFont

    curve = response.curve
    size = (curve.channels * (PANEL + MARGIN) + MARGIN, PANEL + STRIP + 3 * MARGIN)
    image = Image.new("RGB", size, (255, 255, 255))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    draw.text((MARGIN, 14), title, font=font, fill=(0, 0, 0))
    low, high = float(curve.log_exposure.min()), float(curve.log_exposure.max())
    knots = np.arange(RESPONSE_KNOTS)
    for channel, (name, g) in enumerate(zip(NAMES[curve.channels], curve.log_exposure, strict=True)):
        left = MARGIN + channel * (PANEL + MARGIN)
        rows = response.samples[channel]
        rows = rows[:: max(1, -(-len(rows) // MOST_DOTS))]
        said = np.interp(rows[:, 1], knots, g) + rows[:, 3]
        residual = np.interp(rows[:, 0], knots, g) - said
        top = _Axes(draw, font, (left, MARGIN, PANEL, PANEL), (low, high), _ticks(low, high))
        top.dots(rows[:, 0], said)
        draw.line(top.points(knots, g), fill=COLOURS[name], width=2)
        draw.text((left + 10, MARGIN + 8), f"{name}: ln exposure", font=font, fill=COLOURS[name])
        strip = (left, 2 * MARGIN + PANEL, PANEL, STRIP)
        limits = (-RESIDUAL_LIMIT, RESIDUAL_LIMIT)
        below = _Axes(draw, font, strip, limits, [-RESIDUAL_LIMIT, 0, RESIDUAL_LIMIT], codes=True)
        below.dots(rows[:, 0], residual)
        draw.line(below.points(np.array([0, RESPONSE_KNOTS - 1]), np.zeros(2)), fill=COLOURS[name])
        draw.text((left + 10, strip[1] - 18), "residual", font=font, fill=(0, 0, 0))
    return np.asarray(image)


class _Axes:
    """A frame with ticks, and the way from codes and values to pixels."""

    def __init__(
        self,
        draw: Any,
        font: Any,
        box: tuple[int, int, int, int],
        limits: tuple[float, float],
        ticks: list[float],
        *,
        codes: bool = False,
    ) -> None:
        self.draw, self.box, self.limits = draw, box, limits
        left, top, width, height = box
        draw.rectangle((left, top, left + width, top + height), outline=(0, 0, 0))
        for tick in ticks:
            y = self.points(np.zeros(1), np.array([tick]))[0][1]
            draw.line((left, y, left + 5, y), fill=(0, 0, 0))
            draw.text((left - 6, y), f"{tick:g}", font=font, fill=(0, 0, 0), anchor="rm")
        for code in (0, 64, 128, 192, 255):
            x = left + width * code / (RESPONSE_KNOTS - 1)
            draw.line((x, top + height - 5, x, top + height), fill=(0, 0, 0))
            if codes:
                draw.text((x, top + height + 4), str(code), font=font, fill=(0, 0, 0), anchor="mt")

    def points(self, codes: NDArray[Any], values: NDArray[Any]) -> list[tuple[float, float]]:
        left, top, width, height = self.box
        low, high = self.limits
        x = left + width * codes / (RESPONSE_KNOTS - 1)
        y = top + height * (high - np.clip(values, low, high)) / (high - low)
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def dots(self, codes: NDArray[Any], values: NDArray[Any]) -> None:
        for x, y in ((round(x), round(y)) for x, y in self.points(codes, values)):
            self.draw.rectangle((x - 1, y - 1, x + 1, y + 1), fill=DOT)


def _ticks(low: float, high: float) -> list[float]:
    return [float(tick) for tick in range(int(np.ceil(low)), int(high) + 1)]
