"""Timing the stages of a method, reporting progress, and keeping intermediate arrays on request."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numpy.typing import NDArray

Progress = Callable[[str], None]


class StageLog:
    """Collects seconds per stage, and intermediate arrays when asked to.

    Parameters
    ----------
    progress
        Called with the name of each stage as it starts.
    keep_arrays
        Whether `keep` stores what it is given; otherwise intermediates can be freed early.
    """

    def __init__(self, *, progress: Progress | None = None, keep_arrays: bool = False) -> None:
        self.seconds: dict[str, float] = {}
        self.arrays: dict[str, NDArray[Any]] = {}
        self.warnings: list[str] = []
        self._progress = progress
        self._keep_arrays = keep_arrays

    @property
    def keeps_arrays(self) -> bool:
        """Whether `keep` stores what it is given."""
        return self._keep_arrays

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body of a ``with`` statement under `name`."""
        if self._progress is not None:
            self._progress(name)
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def keep(self, **arrays: NDArray[Any]) -> None:
        """Store intermediate arrays under their names, if intermediates were asked for."""
        if self._keep_arrays:
            self.arrays.update(arrays)

    def warn(self, sentence: str) -> None:
        """Note something that the user should know about the result."""
        self.warnings.append(sentence)
