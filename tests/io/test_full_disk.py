"""Disks that are full and folders that cannot be written to: one sentence, exit status 1, no half file."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stereohdr import write_hdr
from stereohdr.errors import FileFormatError, OutputError
from stereohdr.io.files import check_output, make_folder
from stereohdr.io.hdr import HDR_SUFFIXES

from command_line import run

LIMITED = """
import resource, sys
from stereohdr.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))
main(sys.argv[1:])
"""


@pytest.fixture
def source(tmp_path):
    """An image whose files are larger than 4000 bytes in every format."""
    path = tmp_path / "source.npy"
    np.save(path, np.random.default_rng(0).lognormal(0, 1, (60, 80, 3)).astype(np.float32))
    return path


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
@pytest.mark.parametrize("suffix", [*HDR_SUFFIXES, ".png"])
def test_no_room_for_the_file(tmp_path, source, suffix):
    target = tmp_path / "out" / f"a{suffix}"
    target.parent.mkdir()
    target.write_bytes(b"old")
    command = "tonemap" if suffix == ".png" else "convert"
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, command, str(source), str(target)], capture_output=True, text=True
    )
    assert done.returncode == 1
    message = done.stderr.strip().splitlines()[-1]
    assert message.startswith(f"error: {target}: cannot be written (")
    assert message.endswith("; make room, or choose another name or folder")
    assert "Traceback" not in done.stderr
    assert [path.name for path in target.parent.iterdir()] == [target.name]
    assert target.read_bytes() == b"old"


def test_a_full_disk_in_the_middle_of_fuse_is_status_1(tmp_path, source, capsys, monkeypatch):
    def full(self, data):
        with self.open("wb") as file:
            file.write(data[:10])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    assert run("convert", source, tmp_path / "a.pfm") == 1
    assert capsys.readouterr().err == (
        f"error: {tmp_path / 'a.pfm'}: cannot be written (No space left on device); make room, or choose another "
        f"name or folder\n"
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["source.npy"]


def test_folders_without_permission(tmp_path, source, capsys, monkeypatch):
    real = os.access
    locked = tmp_path / "locked"
    locked.mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != locked and real(path, mode))
    for write in (lambda: check_output(locked / "a.exr"), lambda: make_folder(locked)):
        with pytest.raises(OutputError, match="cannot be written to; choose another"):
            write()
    assert run("convert", source, locked / "a.exr") == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_names_are_the_users_and_permissions_the_environments(tmp_path, source, capsys, monkeypatch):
    for name in ("no/a.exr", "x" * 300 + ".exr", "a\0b.exr"):
        with pytest.raises(FileFormatError):
            check_output(tmp_path / name)
    assert run("convert", source, tmp_path / "no" / "a.exr") == 2

    def denied(self, **options):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "stat", denied)
    with pytest.raises(OutputError, match=r"cannot be written \(Permission denied\)"):
        check_output("a.exr")


def test_a_file_that_cannot_be_replaced(tmp_path, monkeypatch):
    def read_only(self, target):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(Path, "replace", read_only)
    with pytest.raises(OutputError, match=r"a\.pfm: cannot be written \(Read-only file system\)"):
        write_hdr(tmp_path / "a.pfm", np.ones((2, 2), np.float32))
    assert list(tmp_path.iterdir()) == []
