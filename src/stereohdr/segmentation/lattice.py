"""Super-pixel lattice (Moore, Prince, Warrell, Mohammed and Jones, CVPR 2008)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.config import LatticeConfig
from stereohdr.segmentation._kernels import lattice_paths


def boundary_map(colours: NDArray[np.floating[Any]], *, sigma: float = 1.0) -> NDArray[np.float64]:
    """Return how strong an edge passes through each pixel.

    Parameters
    ----------
    colours
        ``(H, W, C)`` float, any scale.
    sigma
        Gaussian before the Sobel filter, pixels.

    Returns
    -------
    ``(H, W)`` float64: largest Sobel magnitude over the channels, divided by its 99th percentile (0 in a flat
    image).
    """
    strongest = np.zeros(colours.shape[:2], dtype=np.float32)
    for channel in np.moveaxis(colours, 2, 0):
        smooth = ndimage.gaussian_filter(channel.astype(np.float32), sigma, mode="nearest")
        across = ndimage.sobel(smooth, axis=1, mode="nearest")
        along = ndimage.sobel(smooth, axis=0, mode="nearest")
        np.maximum(strongest, np.hypot(across, along), out=strongest)
    scale = float(np.percentile(strongest, 99))
    if scale <= 0:
        scale = float(strongest.max()) or 1.0
    return strongest.astype(np.float64) / scale


def path_cost(boundary: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a lattice path pays per pixel: ``exp(-4 min(g, 1)) + 0.02``, low on edges."""
    return np.exp(-4.0 * np.minimum(boundary, 1.0)) + 0.02


def superpixel_lattice(
    colours: NDArray[np.floating[Any]], *, config: LatticeConfig | None = None
) -> tuple[NDArray[np.int32], tuple[int, int]]:
    """Cut an image into a regular grid of super-pixels whose borders follow edges.

    Parameters
    ----------
    colours
        ``(H, W, C)`` float, the view's own codes on the 0..255 scale.
    config
        Pitch and tolerance of the lattice.

    Returns
    -------
    labels
        ``(H, W)`` int32, ``row * columns + column`` of the grid cell: the number of horizontal paths above and
        of vertical paths left of the pixel.
    shape
        Rows and columns of the grid.

    Notes
    -----
    Source: paper section 2.1, Figure 5b. Vertical and horizontal paths share the boundary map but do not
    constrain each other, so their order does not matter.
    """
    config = config or LatticeConfig()
    height, width = colours.shape[:2]
    cost = path_cost(boundary_map(colours, sigma=config.smoothing_sigma))
    vertical = lattice_paths(cost, config.pitch, config.tolerance)
    horizontal = lattice_paths(np.ascontiguousarray(cost.T), config.pitch, config.tolerance)

    column = np.zeros((height, width), dtype=np.int32)
    column[np.arange(height), vertical] = 1
    np.cumsum(column, axis=1, out=column)
    row = np.zeros((height, width), dtype=np.int32)
    row[horizontal, np.arange(width)] = 1
    np.cumsum(row, axis=0, out=row)
    shape = (len(horizontal) + 1, len(vertical) + 1)
    return row * np.int32(shape[1]) + column, shape
