"""ColorVideoVDP through its own package (extra ``cvvdp``)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import MissingDependencyError


def cvvdp_jod(test: NDArray[Any], reference: NDArray[Any], *, pixels_per_degree: float) -> float:
    """Return ColorVideoVDP's quality in just-objectionable differences, at most 10.

    Parameters
    ----------
    test, reference
        ``(H, W, C)``, absolute, cd/m2, BT.709 primaries; grey is shown as neutral RGB.
    pixels_per_degree
        Angular resolution, > 0.

    Raises
    ------
    MissingDependencyError
        The package is not installed.

    Notes
    -----
    Source: Mantiuk et al. 2024, doi:10.1145/3658144; computed by the authors' package ``cvvdp`` on a linear
    HDR display of that resolution.
    """
    try:
        import pycvvdp  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingDependencyError(
            "ColorVideoVDP is not installed; install stereohdr[cvvdp], or leave the metric cvvdp out"
        ) from error

    display = pycvvdp.vvdp_display_photo_eotf(Y_peak=10000, contrast=1_000_000, source_colorspace="BT.709-linear")
    geometry = pycvvdp.vvdp_display_geometry(
        resolution=[test.shape[1], test.shape[0]], ppd=float(pixels_per_degree)
    )
    metric = pycvvdp.cvvdp(display_photometry=display, display_geometry=geometry, quiet=True)
    images = [np.repeat(i, 3, axis=2) if i.shape[2] == 1 else i for i in (test, reference)]
    quality, _ = metric.predict(*(i.astype(np.float32) for i in images), dim_order="HWC")
    return float(quality)
