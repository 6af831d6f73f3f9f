"""Limits of memory: how users write them, and what the machine has."""

from __future__ import annotations

import math
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from stereohdr.errors import ConfigError, MemoryLimitError

DEFAULT_SHARE = 0.5
"""Share of the machine's memory that is used when no limit is given."""

SMALLEST_DEFAULT = 512 * 2**20
"""Of a machine with little memory more than that share is used, up to this."""

UNITS = {
    "": 1,
    "B": 1,
    "K": 10**3,
    "M": 10**6,
    "G": 10**9,
    "T": 10**12,
    "KB": 10**3,
    "MB": 10**6,
    "GB": 10**9,
    "TB": 10**12,
    "KIB": 2**10,
    "MIB": 2**20,
    "GIB": 2**30,
    "TIB": 2**40,
}
"""Bytes in a unit, by its name in upper case."""

SMALLEST_LIMIT = 2**20
"""A limit below it is a slip of the pen."""

CONTROL_GROUPS = Path("/sys/fs/cgroup")
"""Where Linux tells the limits of containers and services."""

OWN_GROUPS = Path("/proc/self/cgroup")
"""Which of them hold for this process."""


PROCESS_BYTES = 256 * 2**20
"""What the process takes beside what grows with the photos: the interpreter, the packages, compiled kernels."""


@dataclass(frozen=True)
class Budget:
    """How much memory may be taken.

    Parameters
    ----------
    limit
        Bytes that the process may take in all.
    held
        Bytes of these that are taken already and will stay so: when given to `fuse`, beside the process itself and
        the pair; when given to a method, all of them.
    """

    limit: int
    held: int


@dataclass(frozen=True)
class MemoryPlan:
    """How a pair is fused within a limit of memory.

    Parameters
    ----------
    limit
        Bytes that the process may take.
    estimate
        Bytes that it will take at most, the interpreter and the photos included.
    stage
        What needs so much.
    strips
        Strips in which the pair is matched; 1 for one piece.
    coarse_to_fine
        Whether a first match of some rows decides which disparities are tried.
    """

    limit: int
    estimate: int
    stage: str
    strips: int = 1
    coarse_to_fine: bool = False

    def statistics(self) -> dict[str, float]:
        """Return what reports say about it: numbers by name."""
        return {
            "memory_estimate": float(self.estimate),
            "matching_strips": float(self.strips),
            "coarse_to_fine": float(self.coarse_to_fine),
        }


def parse_size(size: str | float) -> int:
    """Return a size in bytes, given as a number of them or as text with a unit: ``4GiB``, ``500MB``, ``1.5 GB``.

    Raises
    ------
    ConfigError
        Not a number, an unknown unit, or less than 1 MiB.
    """
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*([A-Za-z]*)\s*", str(size))
    unit = UNITS.get(match[2].upper()) if match else None
    number = float(match[1]) * unit if match and unit else 0
    if not SMALLEST_LIMIT <= number < math.inf:
        raise ConfigError(
            f"the memory limit must be a size such as 4GiB, 500MB or a number of bytes, from 1MiB on, got {size!r}"
        )
    return int(number)


def size_text(size: int) -> str:
    """Return a number of bytes as people read it, rounded up: ``2.9GiB``, ``350MiB``; `parse_size` reads it."""
    if size >= 10 * 2**30:
        return f"{math.ceil(size / 2**30)}GiB"
    if size >= 2**30:
        return f"{math.ceil(size / 2**30 * 10) / 10:g}GiB"
    return f"{max(math.ceil(size / 2**20), 1)}MiB"


def memory_limit(limit: str | float | None = None) -> int:
    """Return the limit in bytes: the given one, or half of what the machine or the container has.

    Of less than 1 GiB, up to 512 MiB.

    Raises
    ------
    ConfigError
        See `parse_size`.
    """
    if limit is not None:
        return parse_size(limit)
    memory = machine_memory()
    return max(int(DEFAULT_SHARE * memory), min(memory, SMALLEST_DEFAULT))


def machine_memory() -> int:
    """Return the memory in bytes that this process can have: the machine's, or less in a container."""
    return min([_physical_memory(), *_group_limits()])


def check_plan(plan: MemoryPlan, what: str) -> None:
    """Check that a plan keeps its limit.

    Parameters
    ----------
    plan
        Of a method.
    what
        What the memory is for, as the subject of a sentence in the plural.

    Raises
    ------
    MemoryLimitError
        It does not; the message says how much is needed.
    """
    if plan.estimate > plan.limit:
        needed = size_text(plan.estimate)
        raise MemoryLimitError(
            f"{what} need about {needed} of memory (most of it for {plan.stage}), and the limit is "
            f"{size_text(plan.limit)}; raise it (command line: --memory {needed}) or reduce the photos"
        )


def _physical_memory() -> int:
    if sys.platform != "win32":
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    import ctypes

    class Status(ctypes.Structure):
        """MEMORYSTATUSEX of the Windows API."""

        _fields_ = (
            ("length", ctypes.c_ulong),
            ("load", ctypes.c_ulong),
            ("physical", ctypes.c_ulonglong),
            ("others", ctypes.c_ulonglong * 6),
        )

    status = Status(length=ctypes.sizeof(Status))
    ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    return status.physical


def _group_limits() -> list[int]:
    """Return the limits of the control groups that the process is in, of either version; none elsewhere."""
    try:
        lines = OWN_GROUPS.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return []
    limits = []
    for line in lines:
        _, controllers, name = line.split(":", 2)
        if controllers == "":
            folder, file = CONTROL_GROUPS, "memory.max"
        elif "memory" in controllers.split(","):
            folder, file = CONTROL_GROUPS / "memory", "memory.limit_in_bytes"
        else:
            continue
        group = folder / name.lstrip("/")
        # Inside a container the name may be that outside of it; its own limit is then at the top.
        for place in (group, *group.parents):
            limits += _number_in(place / file)
            if place == folder:
                break
    return limits


def _number_in(path: Path) -> list[int]:
    """Return the number that a file holds; none if it is absent or holds a word (``max``)."""
    try:
        return [int(path.read_text(encoding="utf-8"))]
    except (OSError, ValueError):
        return []
