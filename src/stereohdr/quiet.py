"""Keeping what libraries print about damaged files away from our own messages, which say it in one sentence."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_own_process = False


def silence_libraries() -> None:
    """Let `quiet_stderr` act. For programs of our own: whoever imports us keeps the streams of his process."""
    global _own_process
    _own_process = True


@contextmanager
def quiet_stderr() -> Iterator[None]:
    """Send to nowhere what compiled libraries write to standard error meanwhile, see `silence_libraries`."""
    if not _own_process:
        yield
        return
    with suppress(OSError, AttributeError, ValueError):
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # closed: nobody would see it anyway
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
