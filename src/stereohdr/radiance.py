"""Codes to radiance, luminance, and the map S of under- and over-exposed pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import ExposureMapConfig
from stereohdr.model import Photo, ResponseCurve

REC601 = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Luma weights for gamma-encoded codes."""

REC709 = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""Luminance weights for linear radiance."""


def initial_radiance(photo: Photo, response: ResponseCurve, *, exposure: float) -> NDArray[np.float32]:
    """Return the initial radiance of one view, ``E = exp(g(z)) / t``.

    Parameters
    ----------
    photo
        ``(H, W, C)`` codes.
    response
        Curve with C channels.
    exposure
        Effective exposure time t in seconds.

    Returns
    -------
    ``(H, W, C)`` float32, linear, relative (1 / seconds). Source: paper Figure 3, R^i.
    """
    return response.apply(photo.codes, photo.white) / np.float32(exposure)


def luminance(radiance: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Return the Rec.709 luminance ``(H, W)`` float32 of linear radiance ``(H, W, C)``; grey passes through."""
    return _weighted(radiance, REC709)


def code_luma(photo: Photo) -> NDArray[np.float32]:
    """Return the Rec.601 luma ``(H, W)`` float32 of the codes, scaled so that white is 255."""
    return _weighted(photo.codes, REC601) * np.float32(255.0 / photo.white)


def _weighted(image: NDArray[Any], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    # Not a matrix product: its summation order depends on the BLAS, and S on the last bit.
    if image.shape[2] == 1:
        return np.ascontiguousarray(image[..., 0], dtype=np.float32)
    r, g, b = (image[..., c].astype(np.float32) * weights[c] for c in range(3))
    return r + g + b


def exposure_map(photo: Photo, *, config: ExposureMapConfig | None = None) -> NDArray[np.bool_]:
    """Return the map S of under- and over-exposed pixels, ``(H, W)`` bool.

    Notes
    -----
    Source: equation 1, with codes 0 and 255 included: a clipped pixel is what S is for.
    """
    config = config or ExposureMapConfig()
    luma = code_luma(photo)
    return (luma < config.under_threshold) | (luma > config.over_threshold)
