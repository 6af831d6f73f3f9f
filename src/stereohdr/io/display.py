"""Relative radiance on a display: diffuse white, the PQ curve, BT.2020 colours, highlights that do not fit.

References
----------
ITU-R BT.2408-7, "Guidance for operational practices in HDR television production": diffuse white is 203 cd/m².
SMPTE ST 2084:2014, the PQ curve; ITU-R BT.2020-2, the wide primaries.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import ConfigError, StereoHdrWarning
from stereohdr.io.notes import WHITE_RANGE
from stereohdr.tone_mapping import log_average, luminance

if TYPE_CHECKING:
    from numpy.typing import NDArray

DIFFUSE_WHITE = 203.0
"""Luminance of diffuse white, cd/m² (BT.2408)."""

PQ_PEAK = 10_000.0
"""The largest luminance that PQ holds, cd/m²."""

MIDDLE_GREY = 0.18
"""Reflectance that the log-average of a scene is taken for."""

BT709_TO_BT2020 = np.array(
    [
        [0.627403896, 0.329283038, 0.043313066],
        [0.069097289, 0.919540395, 0.011362316],
        [0.016391439, 0.088013308, 0.895595253],
    ]
)
"""Linear RGB with BT.709 primaries to linear RGB with BT.2020 primaries, both with white D65 (BT.2087-0)."""

_M1, _M2 = 2610 / 16384, 2523 / 32
_C1, _C2, _C3 = 3424 / 4096, 2413 / 128, 2392 / 128


def diffuse_white(radiance: NDArray[np.float32]) -> float:
    """Choose the radiance that is shown as diffuse white: the log-average of the luminance becomes 18 % of it.

    The scale of a radiance image is arbitrary, so that this is a choice, not a measurement. Black pixels do
    not count; an image that is black everywhere gets 1.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, C 1 or 3, >= 0.

    Returns
    -------
    The radiance of diffuse white, in the unit of `radiance`.

    Notes
    -----
    Source: the key of 0.18 of Reinhard et al. 2002, with which the preview is made, too.
    """
    average = log_average(luminance(radiance)) or MIDDLE_GREY
    return float(np.clip(average / MIDDLE_GREY, *WHITE_RANGE))


def checked_white(white: float) -> float:
    """Return `white` if it can be the radiance of diffuse white.

    Raises
    ------
    ConfigError
        It is not a positive number that float32 computes with.
    """
    if not WHITE_RANGE[0] <= white <= WHITE_RANGE[1]:
        raise ConfigError(
            f"the radiance of diffuse white must be a number from {WHITE_RANGE[0]:g} to {WHITE_RANGE[1]:g}, "
            f"got {white}"
        )
    return float(white)


def relative_to_white(
    radiance: NDArray[np.float32], white: float, peak: float, *, name: str
) -> NDArray[np.float32]:
    """Scale radiance so that diffuse white is 1, and bring what exceeds the peak down to it, with its hue.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, >= 0.
    white
        Radiance of diffuse white.
    peak
        The largest channel value that is kept, in units of diffuse white.
    name
        What the warning calls the file.

    Returns
    -------
    ``(H, W, C)`` float32, 0 to `peak`.

    Warns
    -----
    StereoHdrWarning
        Pixels had to be darkened.
    """
    largest = radiance.max(axis=2, keepdims=True)
    limit = np.float32(min(white * peak, float(np.finfo(np.float32).max)))
    beyond = largest > limit
    share = np.count_nonzero(beyond) / beyond.size
    if share:
        warnings.warn(
            f"{name}: {100 * share:.3g} % of the pixels are brighter than {peak:.3g} times diffuse white, the "
            f"most that is stored, and were darkened to that; a larger white than {white:.4g} keeps them",
            StereoHdrWarning,
            stacklevel=2,
        )
    factor = np.divide(limit, largest, out=np.ones_like(largest), where=beyond)
    return (radiance * factor) * np.float32(1 / white)


def pq_encode(luminance: NDArray[Any]) -> NDArray[np.float64]:
    """Return the PQ code, 0 to 1, of a luminance in cd/m², 0 to 10,000; larger ones get 1."""
    power = (np.clip(luminance, 0.0, PQ_PEAK).astype(np.float64) / PQ_PEAK) ** _M1
    return ((_C1 + _C2 * power) / (1 + _C3 * power)) ** _M2


def pq_decode(code: NDArray[Any]) -> NDArray[np.float64]:
    """Return the luminance in cd/m², 0 to 10,000, of a PQ code, 0 to 1."""
    power = np.clip(code, 0.0, 1.0).astype(np.float64) ** (1 / _M2)
    return PQ_PEAK * (np.maximum(power - _C1, 0) / (_C2 - _C3 * power)) ** (1 / _M1)
