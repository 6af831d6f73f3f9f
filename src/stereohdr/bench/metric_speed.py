"""How long HDR-VDP-2 takes, and how much memory it needs."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

from stereohdr.metrics.hdrvdp2 import hdrvdp2
from stereohdr.strips import available_threads

SIZE = (555, 695, 3)
"""Rows, columns and channels of the paper's half-size images."""


def hdrvdp2_call(size: tuple[int, int, int], *, threads: int | None = None) -> Callable[[], Any]:
    """Return a call of HDR-VDP-2 on two synthetic RGB images of `size` (H, W, 3)."""
    generator = np.random.default_rng(0)
    ramp = np.logspace(-1, 3, size[1])[None, :, None] * np.ones(size)
    reference = ramp * generator.lognormal(0, 0.2, size)
    test = reference * generator.lognormal(0, 0.05, size)
    return lambda: hdrvdp2(test, reference, encoding="rgb-bt.709", pixels_per_degree=30, threads=threads)


def measure_hdrvdp2(runs: int = 7) -> dict[str, Any]:
    """Measure HDR-VDP-2 on a pair of synthetic images of the paper's size.

    Parameters
    ----------
    runs
        Timed runs, after one that is not.

    Returns
    -------
    Seconds (median, min, max), and the peak of the memory allocated during a call, in MiB and in float64 images.
    """
    call = hdrvdp2_call(SIZE)
    call()
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "runs": runs,
        "threads": available_threads(),
        "seconds_median": median(seconds),
        "seconds_min": min(seconds),
        "seconds_max": max(seconds),
        "peak_mib": peak / 2**20,
        "peak_images": peak / (8 * np.prod(SIZE)),
    }
