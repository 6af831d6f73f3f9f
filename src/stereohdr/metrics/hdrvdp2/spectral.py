"""Spectral tables: what one unit of a display's channel does to the L and M cones and to the rods.

The numbers are integrals over 360 to 780 nm of sensitivity times emission: cone fundamentals of Smith and Pokorny
(1975), rods CIE 1951 V'(lambda) (both from the Colour and Vision Research Laboratory), emission spectra of the
three displays and daylight D65 of HDR-VDP-2. The S cones are not used by the metric.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DAYLIGHT = ((0.6018471522, 0.3167082956, 0.9046706546),)
"""D65, one channel: L, M, rod."""

DISPLAYS = {
    "ccfl-lcd": (
        (0.1989961203, 0.04100586041, 0.01437736862),
        (0.404762607, 0.2549233064, 0.4809208411),
        (0.05439061926, 0.05001224896, 0.4542758957),
    ),
    "crt": (
        (0.1935214386, 0.04505320909, 0.04707366618),
        (0.4142240108, 0.256275196, 0.5384547675),
        (0.05071663629, 0.04523801972, 0.4004139423),
    ),
    "led-lcd": (
        (0.1787174708, 0.04729528934, 0.06886827322),
        (0.4417184176, 0.2649529315, 0.5844392093),
        (0.03729898381, 0.03406751621, 0.3309735868),
    ),
}
"""Displays by name; rows R, G, B, columns L, M, rod."""

DEFAULT_DISPLAY = "ccfl-lcd"
"""Display of colour images when none is named."""


def channel_responses(channels: int, rgb_display: str | None) -> NDArray[np.float64]:
    """Return ``(channels, 3)``: response of the L cones, M cones and rods to one unit of each channel.

    Parameters
    ----------
    channels
        1 or 3.
    rgb_display
        Key of `DISPLAYS`; None takes daylight for one channel and `DEFAULT_DISPLAY` for three.
    """
    if channels == 1:
        if rgb_display is None:
            return np.array(DAYLIGHT)
        return np.array(DISPLAYS[rgb_display]).sum(axis=0, keepdims=True)
    return np.array(DISPLAYS[rgb_display or DEFAULT_DISPLAY])
