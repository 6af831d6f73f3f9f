"""Recursive domain transform filter (Gastal and Oliveira, SIGGRAPH 2011)."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import DomainTransformConfig
from stereohdr.restoration._kernels import pass_across, pass_down
from stereohdr.strips import run_strips

STRIP_SIZE = 64
"""Rows, or columns, that are filtered at a time."""


def edge_preserving_filter(
    image: NDArray[np.float32],
    guide: NDArray[np.float32],
    *,
    config: DomainTransformConfig | None = None,
    threads: int | None = None,
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
    threads
        Threads to use; does not change the result.

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
    result = np.array(image, dtype=np.float32, order="C")
    height, width = result.shape[:2]
    for iteration in range(1, config.iterations + 1):
        sigma = (
            config.spatial_sigma
            * math.sqrt(3.0)
            * 2.0 ** (config.iterations - iteration)
            / math.sqrt(4.0**config.iterations - 1.0)
        )
        decay = -math.sqrt(2.0) / sigma

        def filter_rows(start: int, stop: int, decay: float = decay) -> None:
            pass_across(result, _feedback(guide[start:stop], 1, ratio, decay), start)

        def filter_columns(start: int, stop: int, decay: float = decay) -> None:
            pass_down(result, _feedback(guide[:, start:stop], 0, ratio, decay), start)

        run_strips(filter_rows, height, strip_rows=STRIP_SIZE, threads=threads)
        run_strips(filter_columns, width, strip_rows=STRIP_SIZE, threads=threads)
    return result


def _feedback(guide: NDArray[np.float32], axis: int, ratio: float, decay: float) -> NDArray[np.float32]:
    """Return how much of the pixel before, along an axis, remains: ``exp(decay * distance)``, ``(H, W)``."""
    channels = [guide[..., c].astype(np.float64) for c in range(guide.shape[2])]
    step = reduce(np.add, [np.abs(np.diff(channel, axis=axis)) for channel in channels])
    feedback = np.empty(guide.shape[:2], dtype=np.float32)
    after_first = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
    feedback[after_first] = np.exp((1.0 + ratio * step) * decay)
    return feedback
