"""Quality from the errors of the pyramid's planes, by the formulas of three releases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_FLOOR = 1e-12

_FREQUENCIES_221 = (60.0, 30.0, 15.0, 7.5, 3.75, 1.875, 0.9375, 0.4688, 0.2344, 0.1172)
_WEIGHTS_221 = (0.0, 0.2832, 0.2832, 0.2142, 0.2690, 0.0398, 0.0003, 0.0003, 0.0, 0.0)
_FREQUENCIES_220 = (15.0, 7.5, 3.75, 1.875, 0.9375, 0.4688, 0.2344)
_WEIGHTS_220 = (0.2832, 0.2142, 0.2690, 0.0398, 0.0003, 0.0003, 0.0002)
_WEIGHTS_213 = (0.2963, 0.2111, 0.1737, 0.0581, -0.0280, 0.0586, 0.2302)


@dataclass(frozen=True)
class PlaneError:
    """What one plane of the pyramid contributes to the quality."""

    band: int
    """0 is the high-pass residual, the last the base band."""
    orientation: int
    """0 to 3; 0 in bands without orientations."""
    frequency: float
    """Nominal frequency of the band in cycles per degree."""
    error: float
    """e: root of the sum of squared differences in thresholds, divided by the number of pixels."""


def quality_221(planes: Sequence[PlaneError]) -> float:
    """Return Q of version 2.2.1: 100 for identical images, less for visible differences, without lower bound."""
    loss = _weighted_sum(planes, _FREQUENCIES_221, _WEIGHTS_221, reference=math.log(_FLOOR))
    return 100.0 - loss


def quality_220(planes: Sequence[PlaneError]) -> tuple[float, float]:
    """Return Q (higher is worse) and Q_MOS (0 worst to 100 best) of version 2.2.0."""
    q = _weighted_sum(planes, _FREQUENCIES_220, _WEIGHTS_220) / len(planes)
    return q, _opinion_score(3.455 * (q + 0.8886))


def quality_213(planes: Sequence[PlaneError]) -> tuple[float, float]:
    """Return Q and Q_MOS of version 2.1.3, whose default surround is the geometric mean of the reference."""
    q = _weighted_sum(planes, _FREQUENCIES_220, _WEIGHTS_213) / len(planes)
    return q, _opinion_score(4.446 * (q + 0.8994))


def _weighted_sum(
    planes: Sequence[PlaneError],
    frequencies: tuple[float, ...],
    weights: tuple[float, ...],
    reference: float = 0.0,
) -> float:
    total = 0.0
    for plane in planes:
        weight = float(np.interp(plane.frequency, frequencies[::-1], weights[::-1]))
        total += weight * (math.log(plane.error + _FLOOR) - reference)
    return total


def _opinion_score(x: float) -> float:
    """Return ``100 / (1 + exp(x))``, which does not overflow."""
    return 50.0 * (1.0 - math.tanh(0.5 * x))
