"""Neural contrast sensitivity: that of the eye without its optics and photoreceptors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.metrics.hdrvdp2.interpolation import UniformTable
from stereohdr.metrics.hdrvdp2.receptors import LOG_RANGE

_LUMINANCES = (0.002, 0.02, 0.2, 2.0, 20.0, 150.0)
"""Adapting luminances of the columns below, cd/m^2."""
_PARAMETERS = (
    (0.991265, 0.800889, 0.476505, 0.405782, 0.334278, 0.394533),
    (3.74038, 3.54104, 4.37453, 4.40602, 3.79542, 2.7755),
    (0.50722, 0.682505, 0.750315, 0.935314, 1.07327, 1.16577),
    (4.46044, 4.94958, 5.28678, 5.61425, 6.4635, 7.45665),
)
"""q1 to q4, fitted to measurements."""

_TABLE_SIZE = 256


def neural_sensitivity(
    frequency: NDArray[np.float64] | float, luminance: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return the contrast sensitivity; the arguments are broadcast.

    Parameters
    ----------
    frequency
        Cycles per degree, >= 0; the sensitivity is 0 at 0.
    luminance
        Adapting luminance in cd/m^2; as at the ends outside 0.002 to 150.
    """
    log_luminance = np.log10(np.clip(luminance, _LUMINANCES[0], _LUMINANCES[-1]))
    q1, q2, q3, q4 = (np.interp(log_luminance, np.log10(_LUMINANCES), row) for row in _PARAMETERS)
    rho = np.asarray(frequency, dtype=np.float64)
    rise = (1.0 - np.exp(-((rho / 7.0) ** 2))) ** q3
    # Written as a product, because `rise` is zero at the frequency zero.
    return q4 * np.sqrt(rise / (1.0 + (q1 * rho) ** q2))


def sensitivity_table(frequency: float) -> UniformTable:
    """Return the sensitivity at one frequency (cycles per degree, > 0) over lg of the luminance."""
    luminances = 10.0 ** np.linspace(*LOG_RANGE, _TABLE_SIZE)
    return UniformTable(*LOG_RANGE, neural_sensitivity(frequency, luminances))
