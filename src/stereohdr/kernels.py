"""How kernels are compiled: without the GIL, and cached on disk wherever there is a place for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function of arrays and numbers with Numba, lazily.

    The compiled code is cached beside the module, or in the user's cache folder where that is read-only; where
    neither can be written (a service without a home), it is compiled anew in each process.
    """
    try:
        return numba.njit(nogil=True, cache=True)(function)
    except RuntimeError:  # "no locator available"
        return numba.njit(nogil=True)(function)
