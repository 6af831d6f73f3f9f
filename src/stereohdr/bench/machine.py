"""On what a measurement was made."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from stereohdr.memory import machine_memory
from stereohdr.strips import available_threads

PACKAGES = ("stereohdr", "numpy", "scipy", "numba", "opencv-python-headless", "opencv-python", "pandora")


def describe_machine() -> dict[str, Any]:
    """Return processor, cores, memory, system, versions, and how busy the machine is, ready for JSON."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(),
        "cores": available_threads(),
        "memory_gib": round(machine_memory() / 2**30, 1),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": versions,
        "load_before": load,
    }


def _processor() -> str:
    """Return the name of the processor as the system tells it."""
    if sys.platform == "darwin":
        command = ["sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    vectors = " with AVX-512" if "avx512bw" in features else " with AVX2" if "avx2" in features else ""
    return (names[0] if names else platform.processor() or platform.machine()) + vectors


def limit_memory(share: float) -> None:
    """Have this process run out of memory at a share of what the machine has; does nothing where it cannot."""
    try:
        import resource
    except ImportError:  # Windows
        return
    if hasattr(resource, "RLIMIT_AS"):
        resource.setrlimit(resource.RLIMIT_AS, (int(share * machine_memory()), resource.RLIM_INFINITY))
