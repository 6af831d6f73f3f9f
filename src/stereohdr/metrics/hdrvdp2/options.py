"""Options of HDR-VDP-2, under the names that they have in the original, and the viewing geometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

from stereohdr.errors import ConfigError, InputError
from stereohdr.metrics.hdrvdp2.spectral import DISPLAYS

GEOMETRIC_MEAN = -1.0
"""Value of `HdrVdp2Options.surround_l` that takes the geometric mean of the reference."""


@dataclass(frozen=True)
class HdrVdp2Options:
    """What can be changed about the observer and the display."""

    do_masking: bool = True
    """Contrast masking by the image's own bands; False compares with the threshold on a uniform field."""
    do_mtf: bool = True
    """Scatter of light in the eye."""
    do_spatial_pooling: bool = True
    """Scale the visibility map by its sum over its maximum: detection by any part of the image."""
    do_si_gauss: bool = False
    """Experimental spatial integration of the original, off there too; only False is accepted."""
    surround_l: float | Sequence[float] = 1e-5
    """Light around the image, in the unit of the linear channels (cd/m^2), > 0: one number for all channels
    or one per channel. -1 takes the geometric mean of every channel of the reference."""
    rgb_display: str | None = None
    """Emission spectra of the display: ``ccfl-lcd`` (default of colour images), ``crt`` or ``led-lcd``. A
    one-channel image with a named display has the sum of its primaries; otherwise daylight D65."""
    spectral_responses: tuple[tuple[float, float, float], ...] | None = None
    """Only of the encoding ``generic``: for each channel the response of the L cones, the M cones and the rods
    to one unit of it (integrals of spectral sensitivity times emission, as in the module `spectral`)."""
    peak_sensitivity: float = 2.4
    """lg of the peak contrast sensitivity of the photoreceptors."""
    rod_sensitivity: float = 0.0
    """lg of an extra factor on the sensitivity of the rods."""

    def __post_init__(self) -> None:
        if self.do_si_gauss:
            raise ConfigError("do_si_gauss must be False: the original's experimental option is not implemented")
        for value in self.surrounds:
            if not (isinstance(value, Real) and (value == GEOMETRIC_MEAN or 0 < value < math.inf)):
                raise ConfigError(f"surround_l must be > 0, or -1 for the geometric mean, got {self.surround_l!r}")
        if self.rgb_display is not None and self.rgb_display not in DISPLAYS:
            raise ConfigError(f"rgb_display must be one of {', '.join(DISPLAYS)}, got {self.rgb_display!r}")
        for name in ("peak_sensitivity", "rod_sensitivity"):
            if not math.isfinite(getattr(self, name)):
                raise ConfigError(f"{name} must be finite, got {getattr(self, name)!r}")
        for row in self.spectral_responses or ():
            if len(row) != 3 or not all(value >= 0 and math.isfinite(value) for value in row):
                raise ConfigError(
                    f"spectral_responses must have three numbers >= 0 (L, M, rod) per channel, got {row!r}"
                )

    @property
    def surrounds(self) -> tuple[float, ...]:
        """`surround_l` as a tuple: one number, or one per channel."""
        return tuple(self.surround_l) if isinstance(self.surround_l, Sequence) else (self.surround_l,)


def pixels_per_degree(diagonal: float, resolution: tuple[int, int], distance: float) -> float:
    """Return how many pixels of a display one degree of the visual field covers.

    Parameters
    ----------
    diagonal
        Visible diagonal of the display in inches (25.4 mm), > 0.
    resolution
        Columns and rows of the display, square pixels.
    distance
        Distance of the eye in metres, > 0.

    Returns
    -------
    Pixels per degree, averaged over the height of the display.

    Raises
    ------
    InputError
        A length or the resolution is not positive.

    Examples
    --------
    >>> round(pixels_per_degree(24, (1920, 1200), 0.5), 4)
    33.5102
    """
    columns, rows = resolution
    for name, value in (("diagonal", diagonal), ("columns", columns), ("rows", rows), ("distance", distance)):
        if not (value > 0 and math.isfinite(value)):
            raise InputError(f"the display's {name} must be > 0, got {value!r}")
    height = 25.4 * diagonal / math.sqrt(1.0 + (columns / rows) ** 2)
    degrees = math.degrees(2.0 * math.atan(0.5 * height / (1000.0 * distance)))
    return rows / degrees
