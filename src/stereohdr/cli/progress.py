"""Progress by stage: a spinner and ticks on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from stereohdr.stage_log import Progress


@contextmanager
def show_progress(*, quiet: bool = False) -> Iterator[Progress]:
    """Give a function that is called with the name of each stage as it starts; writes to standard error."""
    if quiet:
        yield lambda stage: None
        return
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        yield lambda stage: console.print(stage, soft_wrap=True)
        return
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
