"""Progress by stage: a spinner and ticks on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from stereohdr.stage_log import Progress


@contextmanager
def show_progress(*, quiet: bool = False) -> Iterator[Progress]:
    """Give a function that is called with the name of each stage as it starts; writes to standard error."""
    if quiet:
        yield lambda stage: None
    elif sys.stderr is not None and sys.stderr.isatty():
        with _spinner() as report:
            yield report
    else:
        yield print_line


def print_line(words: str) -> None:
    """Print a line to standard error; a spinner stays below it."""
    with suppress(OSError, AttributeError):  # nobody reads it any more: no reason to lose the result
        print(words, file=sys.stderr, flush=True)


@contextmanager
def _spinner() -> Iterator[Progress]:
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    with console.status("starting") as status:
        current: list[tuple[str, float]] = []

        def finish() -> None:
            for stage, start in current:
                console.print(f"[green]✓[/green] {stage} [dim]{time.perf_counter() - start:.2f} s[/dim]")
            current.clear()

        def report(stage: str) -> None:
            finish()
            current.append((stage, time.perf_counter()))
            status.update(stage)

        yield report
        finish()
