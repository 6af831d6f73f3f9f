"""Bicubic resizing as MATLAB's imresize does it by default: antialiased when shrinking."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse


def resized(image: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the image at another size.

    Parameters
    ----------
    image
        ``(H, W)``.
    shape
        Rows and columns of the result.

    Returns
    -------
    ``shape`` float64; may overshoot the range of the image. The image itself where the size is the same.

    Notes
    -----
    Keys (1981, doi:10.1109/TASSP.1981.1163711), A = -0.5, stretched by the reduction, weights normalised, image
    mirrored with its border pixels repeated.
    """
    if image.shape[0] != shape[0]:
        image = _weights(image.shape[0], shape[0]) @ image
    if image.shape[1] != shape[1]:
        image = (_weights(image.shape[1], shape[1]) @ image.T).T
    return image


def _cubic(x: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.abs(x)
    near = (1.5 * x - 2.5) * x**2 + 1.0
    far = ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    return np.where(x <= 1.0, near, np.where(x <= 2.0, far, 0.0))


@lru_cache(maxsize=64)
def _weights(size: int, new_size: int) -> sparse.csr_matrix:
    """Return the ``(new_size, size)`` matrix that resizes one axis."""
    scale = new_size / size
    sharpness = min(scale, 1.0)
    centre = np.arange(1, new_size + 1) / scale + 0.5 * (1.0 - 1.0 / scale)
    taps = np.floor(centre - 2.0 / sharpness)[:, None] + np.arange(math.ceil(4.0 / sharpness) + 2)
    weight = _cubic(sharpness * (centre[:, None] - taps))
    weight /= weight.sum(axis=1, keepdims=True)
    # Positions count from 1; 1..2n is one period of the image and its mirror image.
    position = (taps.astype(np.int64) - 1) % (2 * size)
    column = np.where(position < size, position, 2 * size - 1 - position)
    row = np.broadcast_to(np.arange(new_size)[:, None], column.shape)
    used = weight != 0.0
    return sparse.csr_matrix((weight[used], (row[used], column[used])), shape=(new_size, size))
