"""The conditions of a comparison. Scores of different protocols must not be compared."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr import __version__
from stereohdr.errors import ConfigError, InputError
from stereohdr.metrics.radiometric import aligning_scale
from stereohdr.model import Photo
from stereohdr.radiance import luminance

DARKEST = 1e-5
"""cd/m2: what is darker, above all 0, is raised to it, so that stops and logarithms exist."""


@dataclass(frozen=True)
class Protocol:
    """How relative radiance is shown to the metrics."""

    pixels_per_degree: float = 30.0
    """Angular resolution of the observer's view, > 0."""
    encoding: str = "auto"
    """Colour encoding for HDR-VDP-2; ``auto`` is ``rgb-bt.709`` for RGB and ``luminance`` for grey."""
    peak_luminance: float = 100.0
    """cd/m2 of the reference's `peak_percentile`; 0 leaves the reference as it is (already absolute)."""
    peak_percentile: float = 99.0
    """Percentile of the reference's luminance that is shown at `peak_luminance`, 0 to 100."""
    align: bool = True
    """Whether the test is brought to the reference's scale by one factor first."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.pixels_per_degree) and self.pixels_per_degree > 0):
            raise ConfigError(f"pixels per degree must be a positive number, got {self.pixels_per_degree}")
        if not (math.isfinite(self.peak_luminance) and self.peak_luminance >= 0):
            raise ConfigError(f"peak luminance must be a number of cd/m2 >= 0, got {self.peak_luminance}")
        if not 0 <= self.peak_percentile <= 100:
            raise ConfigError(f"peak percentile must be from 0 to 100, got {self.peak_percentile}")

    def encoding_for(self, channels: int) -> str:
        """Return the encoding for an image of 1 or 3 channels."""
        if self.encoding != "auto":
            return self.encoding
        return "luminance" if channels == 1 else "rgb-bt.709"

    def report(self, *, scale: float, factor: float, channels: int) -> str:
        """Return the line to print with every score, so that it can be reproduced."""
        shown = (
            f"reference p{self.peak_percentile:g} luminance at {self.peak_luminance:g} cd/m2"
            if self.peak_luminance
            else "reference taken as absolute"
        )
        aligned = f"test aligned by {factor:.6g}" if self.align else "test not aligned"
        return (
            f"stereohdr {__version__}; {self.pixels_per_degree:g} pixels per degree; "
            f"{self.encoding_for(channels)}; {shown} (x {scale:.6g}); {aligned}"
        )

    def show(
        self, test: NDArray[Any], reference: NDArray[Any], *, main: Photo | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
        """Put both images on the absolute scale.

        Parameters
        ----------
        test, reference
            ``(H, W, C)`` radiance, finite, >= 0.
        main
            Photo of the same view: its well-exposed pixels decide the alignment; all pixels without it.

        Returns
        -------
        test, reference
            ``(H, W, C)`` float64, cd/m2, at least 1e-5.
        report
            See `report`.

        Raises
        ------
        InputError
            Different shapes, a value that is not finite or negative, or an all-black image.
        """
        if test.shape != reference.shape or test.ndim != 3:
            raise InputError(f"cannot compare images of shapes {test.shape} and {reference.shape}")
        for name, image in (("test", test), ("reference", reference)):
            if not (np.isfinite(image).all() and (image >= 0).all()):
                raise InputError(f"the {name} image must be finite and not negative")
            if not image.any():
                raise InputError(f"the {name} image is black throughout; there is nothing to compare")
        scale = 1.0
        if self.peak_luminance:
            peak = float(np.percentile(luminance(reference), self.peak_percentile))
            if peak <= 0:
                raise InputError(
                    f"the reference's {self.peak_percentile:g}th luminance percentile is 0; choose a higher one"
                )
            scale = self.peak_luminance / peak
        shown_reference = np.maximum(reference.astype(np.float64) * scale, DARKEST)
        factor = scale
        if self.align:
            positive = np.maximum(test.astype(np.float64), np.finfo(np.float32).tiny)
            factor = aligning_scale(positive, shown_reference, main)
        shown_test = np.maximum(test.astype(np.float64) * factor, DARKEST)
        return shown_test, shown_reference, self.report(scale=scale, factor=factor, channels=test.shape[2])
