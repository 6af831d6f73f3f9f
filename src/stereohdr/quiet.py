"""Keeping what libraries print about damaged files away from our own messages, which say it in one sentence."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, redirect_stdout, suppress
from io import StringIO

_own_process = False


def silence_libraries() -> None:
    """Let what follows act. For programs of our own: whoever imports us keeps the streams of his process."""
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
    with ExitStack() as stack:
        with suppress(OSError):  # it is closed, or there is no such thing as nowhere: then nothing is kept away
            kept = os.dup(2)
            stack.callback(os.close, kept)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 2)
            os.close(nowhere)
            stack.callback(os.dup2, kept, 2)
        yield


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Send to nowhere what libraries print meanwhile through Python's standard output, see `silence_libraries`."""
    with redirect_stdout(StringIO()) if _own_process else nullcontext():
        yield
