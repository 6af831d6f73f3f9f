"""Errors of radiance in stops (factors of two)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.model import Photo, ResponseCurve
from stereohdr.radiance import luminance

WELL_EXPOSED = (20.0, 235.0)
"""Codes (of 255) between which a pixel is trusted to align two images, in every channel."""


def aligning_scale(
    test: NDArray[np.floating[Any]], reference: NDArray[np.floating[Any]], main: Photo | None = None
) -> float:
    """Return the factor that brings `test` to the scale of `reference`.

    Parameters
    ----------
    test, reference
        ``(H, W, C)`` radiance, positive.
    main
        The photo of the view; its well-exposed pixels (all channels in 20..235 of 255) decide. All pixels do when
        it has none, or without a photo.

    Returns
    -------
    The median ratio of the luminances.
    """
    trusted = np.ones(test.shape[:2], dtype=bool)
    if main is not None:
        codes = main.codes * (255.0 / main.white)
        well_exposed = np.all((codes >= WELL_EXPOSED[0]) & (codes <= WELL_EXPOSED[1]), axis=2)
        trusted = well_exposed if well_exposed.any() else trusted
    ratio = luminance(reference)[trusted].astype(np.float64) / luminance(test)[trusted]
    return float(np.exp(np.median(np.log(ratio))))


def log2_error(
    test: NDArray[np.floating[Any]], reference: NDArray[np.floating[Any]], *, scale: float = 1.0
) -> NDArray[np.float64]:
    """Return the error of each pixel's luminance in stops, ``log2(scale * test / reference)``.

    Parameters
    ----------
    test, reference
        ``(H, W, C)`` radiance, positive.
    scale
        Factor on `test`, see `aligning_scale`.

    Returns
    -------
    ``(H, W)`` float64; 1 means twice too bright.

    Raises
    ------
    InputError
        Different shapes, or a luminance that is not positive.
    """
    if test.shape != reference.shape:
        raise InputError(f"cannot compare images of shapes {test.shape} and {reference.shape}")
    first, second = luminance(test).astype(np.float64), luminance(reference).astype(np.float64)
    for name, image in (("test", first), ("reference", second)):
        if not (image > 0).all():
            raise InputError(f"the {name} image must have positive luminance everywhere to be compared in stops")
    return np.log2(first / second * scale)


def log2_rmse(error: NDArray[np.float64], mask: NDArray[np.bool_] | None = None) -> float:
    """Return the root mean square of `error` (stops) over `mask`, ``(H, W)`` bool; NaN for an empty mask."""
    chosen = error if mask is None else error[mask]
    return float(np.sqrt(np.mean(chosen**2))) if chosen.size else float("nan")


def share_off(error: NDArray[np.float64], *, stops: float = 1 / 3, mask: NDArray[np.bool_] | None = None) -> float:
    """Return the share (0..1) of pixels whose `error` exceeds `stops` either way; NaN for an empty mask."""
    chosen = error if mask is None else error[mask]
    return float(np.mean(np.abs(chosen) > stops)) if chosen.size else float("nan")


def response_rmse(estimate: ResponseCurve, truth: ResponseCurve) -> float:
    """Return the RMS error of ln X over codes 5 to 250 and all channels; both curves are 0 at the mid code.

    Raises
    ------
    InputError
        The curves have different channel counts.
    """
    if estimate.channels != truth.channels:
        raise InputError(f"cannot compare curves of {estimate.channels} and {truth.channels} channels")
    error = (estimate.log_exposure - truth.log_exposure)[:, 5:251]
    return float(np.sqrt(np.mean(error**2)))
