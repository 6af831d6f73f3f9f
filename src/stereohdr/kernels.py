"""How kernels are compiled: without the GIL, and cached on disk wherever there is a place for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

_folders: set[Path] = set()


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function of arrays and numbers with Numba, lazily.

    The compiled code is cached beside the module, or in the user's cache folder where that is read-only; where
    neither can be written (a service without a home), it is compiled anew in each process.
    """
    try:
        dispatcher = numba.njit(nogil=True, cache=True)(function)
    except RuntimeError:  # "no locator available"
        return numba.njit(nogil=True)(function)
    _folders.add(Path(str(dispatcher.stats.cache_path)))
    return dispatcher


def kernel_folders() -> tuple[Path, ...]:
    """Return the folders in which the kernels that were imported so far are cached; none if they are not."""
    return tuple(sorted(_folders))
