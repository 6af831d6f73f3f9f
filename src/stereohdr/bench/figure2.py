"""Figure 2: response curves from histograms, from SIFT matches, and from a bracket or the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereohdr.bench.contenders import best_known_response
from stereohdr.config import PaperConfig
from stereohdr.datasets.scene import EvaluationScene
from stereohdr.errors import StereoHdrError
from stereohdr.metrics.radiometric import response_rmse
from stereohdr.model import ResponseCurve
from stereohdr.response import estimate_response

COLOURS = {"reference": (90, 90, 90), "cdf": (30, 110, 220), "sift": (220, 120, 30)}
"""Colour of each curve in the picture."""


def response_curves(scene: EvaluationScene) -> tuple[dict[str, ResponseCurve], dict[str, str]]:
    """Estimate the response of a scene in every way.

    Returns
    -------
    curves
        ``reference`` (the truth or the bracket's curve, where known), ``cdf``, ``sift``.
    errors
        Why a curve is missing.
    """
    curves: dict[str, ResponseCurve] = {}
    errors: dict[str, str] = {}
    known = best_known_response(scene)
    if known is not None:
        curves["reference"] = known
    base = PaperConfig().response
    for samples in ("cdf", "sift"):
        try:
            curves[samples] = estimate_response(scene.pair, config=replace(base, samples=samples))
        except StereoHdrError as error:
            errors[samples] = str(error)
    return curves, errors


def curve_errors(curves: dict[str, ResponseCurve]) -> dict[str, float]:
    """Return the RMS error of ln X against ``reference`` by curve; empty without a reference."""
    if "reference" not in curves:
        return {}
    truth = curves["reference"]
    return {name: response_rmse(curve, truth) for name, curve in curves.items() if name != "reference"}


def draw_curves(curves: dict[str, ResponseCurve], title: str) -> NDArray[np.uint8]:
    """Draw ln X over the code, one panel per channel, as in Figure 2; returns ``(H, W, 3)`` uint8."""
    from PIL import Image, ImageDraw, ImageFont

    channels = next(iter(curves.values())).channels
    panel, margin = 380, 46
    image = Image.new("RGB", (channels * (panel + margin) + margin, panel + 2 * margin + 24), (255, 255, 255))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    draw.text((margin, 10), title, font=font, fill=(0, 0, 0))
    values = np.concatenate([curve.log_exposure.ravel() for curve in curves.values()])
    low, high = float(values.min()), float(values.max())
    for channel in range(channels):
        left, top = margin + channel * (panel + margin), margin
        draw.rectangle((left, top, left + panel, top + panel), outline=(0, 0, 0))
        name = ("red", "green", "blue")[channel] if channels == 3 else "grey"
        draw.text((left + 8, top + 6), name, font=font, fill=(0, 0, 0))
        for tick in range(int(np.ceil(low)), int(high) + 1, 2):
            y = top + panel * (high - tick) / (high - low)
            draw.line((left, y, left + 5, y), fill=(0, 0, 0))
            draw.text((left - 6, y), str(tick), font=font, fill=(0, 0, 0), anchor="rm")
        for code in (0, 64, 128, 192, 255):
            x = left + panel * code / 255
            draw.line((x, top + panel - 5, x, top + panel), fill=(0, 0, 0))
            draw.text((x, top + panel + 4), str(code), font=font, fill=(0, 0, 0), anchor="mt")
        for curve_name, curve in curves.items():
            g = curve.log_exposure[channel]
            points = [(left + panel * z / 255, top + panel * (high - v) / (high - low)) for z, v in enumerate(g)]
            draw.line(points, fill=COLOURS[curve_name], width=2)
    for n, curve_name in enumerate(curves):
        draw.text((margin + 120 * n, panel + margin + 26), f"- {curve_name}", font=font, fill=COLOURS[curve_name])
    return np.asarray(image)


def save_curves(path: Path, scene: EvaluationScene, curves: dict[str, ResponseCurve]) -> None:
    """Write the picture of a scene's curves."""
    from stereohdr.io.images import write_png

    write_png(path, draw_curves(curves, f"{scene.name}: ln exposure over code"))
