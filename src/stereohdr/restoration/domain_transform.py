"""Recursive domain transform filter (Gastal and Oliveira, SIGGRAPH 2011)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import DomainTransformConfig
from stereohdr.restoration._kernels import recursive_pass


def edge_preserving_filter(
    image: NDArray[np.float32], guide: NDArray[np.float32], *, config: DomainTransformConfig | None = None
) -> NDArray[np.float32]:
    """Smooth `image` except across edges of `guide`.

    Parameters
    ----------
    image
        ``(H, W, C)`` float32, what is filtered.
    guide
        ``(H, W, K)`` float32. `range_sigma` is in its units: the default is meant for exposure (1 at the mid
        code) per **millisecond**; on any other scale the filter is the identity or a plain blur.
    config
        sigma_s, sigma_r, iterations.

    Returns
    -------
    ``(H, W, C)`` float32.

    Notes
    -----
    Source: Gastal and Oliveira 2011, equations 11 (distance, L1 over guide channels), 14 (sigma of each
    iteration) and 21 (recursive filter).
    """
    config = config or DomainTransformConfig()
    ratio = config.spatial_sigma / config.range_sigma
    distance = []
    for axis in (1, 0):
        step = np.abs(np.diff(guide.astype(np.float64), axis=axis)).sum(axis=2)
        before_first = [(0, 0), (0, 0)]
        before_first[axis] = (1, 0)
        distance.append(np.pad(1.0 + ratio * step, before_first))
    result = np.array(image, dtype=np.float32, order="C")
    for iteration in range(1, config.iterations + 1):
        sigma = (
            config.spatial_sigma
            * math.sqrt(3.0)
            * 2.0 ** (config.iterations - iteration)
            / math.sqrt(4.0**config.iterations - 1.0)
        )
        across, down = (np.exp(d * (-math.sqrt(2.0) / sigma)).astype(np.float32) for d in distance)
        recursive_pass(result, across, down)
    return result
