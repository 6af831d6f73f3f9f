"""Running a kernel on row strips in a few threads, with the same result for any number of threads."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

ResultT = TypeVar("ResultT")


def available_threads() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_strips(
    task: Callable[[int, int], None], rows: int, *, strip_rows: int, threads: int | None = None
) -> None:
    """Call ``task(start, stop)`` for consecutive strips that cover ``range(rows)``.

    Parameters
    ----------
    task
        Writes its rows of a preallocated output; must not touch other rows. Kernels that release the GIL
        run in parallel.
    rows
        Number of rows in all.
    strip_rows
        Rows per strip; fixed, so that results cannot depend on `threads`.
    threads
        Threads to use; None takes `available_threads`.
    """
    strips = [(start, min(start + strip_rows, rows)) for start in range(0, rows, strip_rows)]
    threads = min(threads or available_threads(), len(strips))
    if threads <= 1:
        for start, stop in strips:
            task(start, stop)
        return
    with ThreadPoolExecutor(threads) as pool:
        for future in [pool.submit(task, start, stop) for start, stop in strips]:
            future.result()


def run_together(*tasks: Callable[[], ResultT], threads: int | None = None) -> list[ResultT]:
    """Call functions that do not touch each other's data at the same time.

    Parameters
    ----------
    tasks
        What to call. Kernels and NumPy's loops over large arrays release the GIL and run in parallel.
    threads
        Threads to use; None takes `available_threads`.

    Returns
    -------
    What they return, in the same order.
    """
    threads = min(threads or available_threads(), len(tasks))
    if threads <= 1:
        return [task() for task in tasks]
    with ThreadPoolExecutor(threads) as pool:
        return [future.result() for future in [pool.submit(task) for task in tasks]]
