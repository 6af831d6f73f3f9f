"""Differences of two pyramids in units of the detection threshold, with contrast masking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereohdr.metrics.hdrvdp2.resize import resized

_TRANSDUCER_EXPONENT = 10.0**0.544068
"""p: how the difference grows."""
_MASKING_EXPONENT = 10.0**0.49576
"""q: how the masker grows."""
_SELF_MASKING = 10.0**0.189065
"""k_self: by the same plane."""
_ORIENTATION_MASKING = 10.0**0.449199
"""k_xo: by the other orientations of the band."""
_BAND_MASKING = 10.0**1.52512
"""k_xn: by the neighbouring bands."""
_PSYCHOMETRIC_EXPONENT = 3.5 / _TRANSDUCER_EXPONENT
"""pf: brings the slope to that of the psychometric function, 3.5."""


def mutual_activity(test: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return m of a plane, ``(rows, columns)``: what both images have, averaged over 3x3 with zeros outside."""
    both = np.minimum(np.abs(test), np.abs(reference))
    padded = np.pad(both, 1)
    rows = padded[:-2] + padded[1:-1]
    rows += padded[2:]
    mean = rows[:, :-2] + rows[:, 1:-1]
    mean += rows[:, 2:]
    mean /= 9.0
    return mean


def signed_power(x: NDArray[np.float64], exponent: float) -> NDArray[np.float64]:
    """Return ``sign(x) |x|^exponent``."""
    power = np.abs(x)
    np.power(power, exponent, out=power)
    return np.copysign(power, x, out=power)


def neighbour_activity(
    activity: list[NDArray[np.float64]], band: int, orientation: int, *, gain: float
) -> NDArray[np.float64]:
    """Return what the neighbouring bands add to the masking of a plane, ``(rows, columns)``.

    Parameters
    ----------
    activity
        `mutual_activity` of every band, ``(planes, rows, columns)``.
    band, orientation
        Which plane.
    gain
        n_b: gain of the pyramid at this band.
    """
    shape = activity[band].shape[1:]
    total = np.zeros(shape)
    # The base band masks nothing; it is masked only by the level above it.
    neighbours = [(band - 1, 0.5 * gain)] if band > 0 else []
    if band < len(activity) - 2:
        neighbours.append((band + 1, 2.0 * gain))
    for neighbour, its_gain in neighbours:
        planes = activity[neighbour]
        # Bands without orientations have one plane for all.
        there = resized(planes[min(orientation, len(planes) - 1)], shape)
        total += np.maximum(there, 0.0) / its_gain
    return total


def masking_signal(
    own: NDArray[np.float64],
    band_total: NDArray[np.float64],
    neighbours: NDArray[np.float64],
    *,
    gain: float,
) -> NDArray[np.float64]:
    """Return what masks a plane, before the noise is taken into account; all of the same shape.

    Parameters
    ----------
    own
        `mutual_activity` of the plane.
    band_total
        Sum of `mutual_activity` over all orientations of the band.
    neighbours
        From `neighbour_activity`.
    gain
        n_b: gain of the pyramid at this band.
    """
    total = own / gain
    np.power(total, _MASKING_EXPONENT, out=total)
    total *= _SELF_MASKING
    term = band_total - own
    np.maximum(term, 0.0, out=term)
    term /= gain
    np.power(term, _MASKING_EXPONENT, out=term)
    term *= _ORIENTATION_MASKING
    total += term
    np.power(neighbours, _MASKING_EXPONENT, out=term)
    term *= _BAND_MASKING
    total += term
    return total


@dataclass(frozen=True)
class BandSensitivity:
    """Powers of the contrast sensitivity (the inverse of the noise N) of a band, ``(rows, columns)``."""

    transducer: NDArray[np.float64]
    """To the power p."""
    masking: NDArray[np.float64]
    """n_b times the power p + q."""


def band_sensitivity(sensitivity: NDArray[np.float64], *, gain: float) -> BandSensitivity:
    """Return the powers of a contrast sensitivity that a band of gain n_b needs."""
    transducer = np.power(sensitivity, _TRANSDUCER_EXPONENT)
    masking = np.power(sensitivity, _MASKING_EXPONENT)
    masking *= transducer
    masking *= gain
    return BandSensitivity(transducer, masking)


def masked_difference(
    test: NDArray[np.float64],
    reference: NDArray[np.float64],
    transducer: NDArray[np.float64],
    mask: NDArray[np.float64] | None,
    *,
    gain: float,
) -> NDArray[np.float64]:
    """Return D of a plane; 1 is the threshold of detection. All of the same shape.

    Parameters
    ----------
    test, reference
        The plane of both images.
    transducer
        Of `BandSensitivity`.
    mask
        `masking_signal` times the `masking` of `BandSensitivity`; None for no masking. Overwritten.
    gain
        n_b: gain of the pyramid at this band.

    Notes
    -----
    ``D = ex / sqrt(N^2p + N_mask^2)`` is written as ``ex N^-p / sqrt(1 + (N_mask N^-p)^2)``, so that the powers
    of the noise are needed once per band only.
    """
    difference = test - reference
    difference /= gain
    difference = signed_power(difference, _TRANSDUCER_EXPONENT)
    difference *= gain
    difference *= transducer
    if mask is not None:
        mask *= mask
        mask += 1.0
        difference /= np.sqrt(mask, out=mask)
    return difference


def detection_signal(difference: NDArray[np.float64], *, gain: float) -> NDArray[np.float64]:
    """Return D on the slope of the psychometric function, ready to be collapsed; same shape."""
    signal = signed_power(difference / gain, _PSYCHOMETRIC_EXPONENT)
    signal *= gain
    return signal
