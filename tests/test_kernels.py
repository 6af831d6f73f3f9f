"""Where compiled kernels are kept: beside the package, else in the user's cache folder, else nowhere."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import stereohdr

USE_A_KERNEL = """
import numpy as np
from stereohdr.disparity._kernels import similarity_rows
from stereohdr.kernels import kernel_folders

planes = np.zeros((2, 3, 4), np.uint64)
volume = np.empty((3, 4, 2), np.uint8)
similarity_rows(planes, planes, np.uint64(48), 0, 3, volume)
assert (volume[:, 0] == 48).all()
print(len(kernel_folders()), *kernel_folders()[:1])
"""

RESPECT_PERMISSIONS = """
import ctypes, os, sys
CAP_DAC_OVERRIDE, PR_CAPBSET_DROP = 1, 24
if os.geteuid() == 0:  # or root would write where nobody may
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)
os.execv(sys.executable, [sys.executable, "-c", sys.argv[1]])
"""


@pytest.fixture
def read_only_package(tmp_path):
    """A copy of the package in a folder where nothing can be written."""
    if sys.platform != "linux":
        pytest.skip("needs permissions that hold for root, too")
    site = tmp_path / "site"
    shutil.copytree(
        Path(stereohdr.__file__).parent, site / "stereohdr", ignore=shutil.ignore_patterns("__pycache__")
    )
    folders = [site, *(path for path in site.rglob("*") if path.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    yield site
    for folder in folders:
        folder.chmod(0o755)


def folders_used(site, home):
    """Return the number of cache folders, and the first of them, of a process that uses a kernel."""
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith("NUMBA_") and key not in ("XDG_CACHE_HOME", "PYTHONPATH")
    }
    done = subprocess.run(
        [sys.executable, "-c", RESPECT_PERMISSIONS, USE_A_KERNEL],
        capture_output=True,
        text=True,
        cwd=site,
        env={**environment, "HOME": str(home), "PYTHONPATH": str(site)},
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    number, *first = done.stdout.split()
    return int(number), Path(*first)


def test_a_read_only_package_is_cached_for_the_user(tmp_path, read_only_package):
    home = tmp_path / "home"
    home.mkdir()
    number, folder = folders_used(read_only_package, home)
    assert number > 0
    assert folder.is_relative_to(home)
    assert list(folder.glob("*similarity_rows*.nbi"))
    assert not list(read_only_package.rglob("*.nbi"))


def test_without_any_folder_kernels_work_all_the_same(tmp_path, read_only_package):
    home = tmp_path / "home"
    home.mkdir(mode=0o555)
    assert folders_used(read_only_package, home) == (0, Path())
    assert not list(home.iterdir())


def test_kernels_do_not_start_threads_of_their_own():
    for path in Path(stereohdr.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert "parallel=True" not in text, path
        assert "prange" not in text, path
