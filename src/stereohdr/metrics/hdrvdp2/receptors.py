"""Response of the photoreceptors: luminance to a scale on which one unit is one just noticeable difference."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereohdr.metrics.hdrvdp2.interpolation import UniformTable

LOG_RANGE = (-5.0, 5.0)
"""lg of the luminances, cd/m^2, that the tables cover."""

_TABLE_SIZE = 2048
_SENSITIVITY_SCALE = 0.006894596
"""Brings the integrated sensitivity to a peak contrast sensitivity of 1."""


def joint_sensitivity(luminance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the contrast sensitivity of cones and rods together at a luminance in cd/m^2."""
    return 30.162 * ((4.0627 / luminance) ** 1.6596 + 1.0) ** -0.2712


def rod_sensitivity(luminance: NDArray[np.float64], log_factor: float = 0.0) -> NDArray[np.float64]:
    """Return the contrast sensitivity of the rods at a luminance in cd/m^2, times 10^`log_factor`."""
    distance = np.log10(luminance / 1.1732)
    above = np.exp(-(np.abs(distance) ** 2.9899) / 0.5547)
    below = np.exp(-(np.abs(distance) ** 1.2167) / 1.1478)
    return 10.0 ** (1.1414 + log_factor) * np.where(luminance > 1.1732, above, below)


@dataclass(frozen=True)
class ResponseTables:
    """Response over lg of the luminance."""

    cone: UniformTable
    """Of the L cones, or of the M cones."""
    rod: UniformTable
    """Of the rods."""


@lru_cache(maxsize=8)
def response_tables(peak_sensitivity: float, log_rod_factor: float) -> ResponseTables:
    """Integrate the sensitivities to responses.

    Parameters
    ----------
    peak_sensitivity
        lg of the peak contrast sensitivity.
    log_rod_factor
        lg of the extra factor of the rods.
    """
    log_luminance = np.linspace(*LOG_RANGE, _TABLE_SIZE)
    luminance = 10.0**log_luminance
    rods = rod_sensitivity(luminance, log_rod_factor)
    # What both reach without the rods is left to the L and M cones, which share it and its luminance.
    both_cones = np.maximum(joint_sensitivity(luminance) - rods, 1e-3)
    cones = 0.5 * np.interp(np.minimum(2.0 * luminance, luminance[-1]), luminance, both_cones)
    scale = _SENSITIVITY_SCALE / 10.0**-peak_sensitivity

    def integrated(sensitivity: NDArray[np.float64]) -> UniformTable:
        steps = 0.5 * (sensitivity[1:] + sensitivity[:-1]) * np.diff(log_luminance) * np.log(10.0)
        return UniformTable(*LOG_RANGE, scale * np.append(0.0, np.cumsum(steps)))

    return ResponseTables(integrated(cones), integrated(rods))


def log_luminance(luminance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return lg of a luminance in cd/m^2, clipped to `LOG_RANGE` (also zero and below)."""
    clipped = np.clip(luminance, 10.0 ** LOG_RANGE[0], 10.0 ** LOG_RANGE[1])
    return np.log10(clipped, out=clipped)


def achromatic_response(
    l_cone: NDArray[np.float64],
    m_cone: NDArray[np.float64],
    rod: NDArray[np.float64],
    tables: ResponseTables,
) -> NDArray[np.float64]:
    """Return the response of cones and rods without its mean, ``(H, W)``, from their input in cd/m^2."""
    cones = tables.cone.at(log_luminance(l_cone))
    cones += tables.cone.at(log_luminance(m_cone))
    cones -= cones.mean()
    rods = tables.rod.at(log_luminance(rod))
    rods -= rods.mean()
    cones += rods
    return cones
