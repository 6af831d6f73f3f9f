"""``stereohdr warmup``: compile all kernels before the first picture comes."""

from __future__ import annotations

import os
from typing import Annotated

import typer


def warmup_command(
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing.")] = False,
) -> None:
    """Compile the kernels of methods robust and paper ahead, in two processes; fuse does it when it must."""
    from stereohdr.cli.progress import show_progress

    with show_progress(quiet=quiet) as progress:
        progress("loading")
        from stereohdr.warmup import warm_up

        done = warm_up(progress=progress)
    if not quiet:
        folder = os.path.commonpath(done.folders)
        what = f"compiled {done.compiled} kernels" if done.compiled else "everything is compiled already"
        typer.echo(f"{what} ({done.seconds:.1f} s), kept in {folder}")
