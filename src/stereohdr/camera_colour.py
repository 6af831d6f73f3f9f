"""From the colours of a camera's sensor to those of displays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stereohdr.model import Photo

SMALLEST_SHARE = 1e-3
"""Colours outside of BT.709 would have a channel below zero; it gets this share of the camera's largest one."""

_ROWS = 256
"""Rows that are converted at a time, to keep the temporary arrays of large images small."""


def white_balanced(photos: Sequence[Photo], *, as_in: Photo) -> tuple[Photo, ...]:
    """Return linear photos balanced by the white balance of one of them, clipped at one level in all channels.

    Parameters
    ----------
    photos
        ``(H, W, C)``, linear codes of one camera model.
    as_in
        The photo whose white balance counts for all; where it has none, the photos are returned as they are.

    Notes
    -----
    The factors are scaled so that the smallest is 1: no clipped code falls below the white level, and codes keep
    their resolution. The other channels then reach the white level before the sensor clips. That is wanted: where
    the channel of the smallest factor is clipped, what the others still measure has no hue, and would show as a
    magenta rim.
    """
    if as_in.white_balance is None:
        return tuple(photos)
    factors = np.array(as_in.white_balance, dtype=np.float32)
    factors /= factors.min()
    balanced = []
    for photo in photos:
        codes = np.empty_like(photo.codes)
        for start in range(0, photo.height, _ROWS):
            rows = slice(start, start + _ROWS)
            codes[rows] = np.minimum(np.rint(photo.codes[rows] * factors), photo.white)
        balanced.append(replace(photo, codes=codes, white_balance=None))
    return tuple(balanced)


def to_bt709(radiance: NDArray[np.float32], matrix: NDArray[np.float64] | None) -> NDArray[np.float32]:
    """Return radiance in BT.709 colours instead of the camera's.

    Parameters
    ----------
    radiance
        ``(H, W, 3)`` float32, positive, white-balanced.
    matrix
        `Photo.colour_matrix`; without one, and for grey images, the radiance is returned as it is.

    Returns
    -------
    ``(H, W, 3)`` float32, positive.
    """
    if matrix is None or radiance.shape[2] != 3:
        return radiance
    converted = np.empty_like(radiance)
    for start in range(0, len(radiance), _ROWS):
        rows = slice(start, start + _ROWS)
        camera = radiance[rows].astype(np.float64)
        mixed = np.einsum("ij,hwj->hwi", matrix, camera)
        converted[rows] = np.maximum(mixed, SMALLEST_SHARE * camera.max(axis=-1, keepdims=True))
    return converted
