"""What compiled libraries print about damaged files does not reach the user of the command line."""

import subprocess
import sys

import numpy as np
import pytest
import tifffile
from camera_files import bayer_mosaic, write_dng

from stereohdr import read_photo, write_hdr

COMMAND = "from stereohdr.cli import main; main()"
NOISY = """
import os, sys
from stereohdr.quiet import quiet_stderr, quiet_stdout, silence_libraries
if len(sys.argv) > 1:
    silence_libraries()
before = sys.stdout
with quiet_stderr(), quiet_stdout():
    assert (sys.stdout is before) == (len(sys.argv) == 1)
    os.write(2, b"library ")
    print("library ", end="")
assert sys.stdout is before
print("we", file=sys.stderr)
"""


def python(code, *arguments):
    done = subprocess.run([sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def test_only_programs_of_our_own_are_silenced():
    assert python(NOISY) == (0, "library ", "library we\n")
    assert python(NOISY, "own") == (0, "", "we\n")


def test_a_truncated_exr_is_one_line(tmp_path):
    path = tmp_path / "a.exr"
    write_hdr(path, np.random.default_rng(0).uniform(1, 2, (64, 64, 3)).astype(np.float32))
    path.write_bytes(path.read_bytes()[:20_000])
    message = f"error: {path}: damaged OpenEXR file (its pixels cannot be decoded); get it again\n"
    assert python(COMMAND, "convert", path, tmp_path / "a.pfm") == (2, "", message)


def test_a_truncated_raw_file_is_one_line(tmp_path):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    light = np.random.default_rng(0).integers(100, 3000, (64, 64, 3)).astype(np.uint16)
    path = write_dng(tmp_path / "a.dng", bayer_mosaic(light, "RGGB"))
    path.write_bytes(path.read_bytes()[:3000])
    status, out, err = python(COMMAND, "info", path)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"error: {path}: damaged or unsupported camera raw file (")


def test_odd_tiff_tags_are_one_line_or_none(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.full((8, 8), 7, np.uint8), photometric="minisblack", metadata=None)
    data = bytearray(path.read_bytes())
    unit = data.index((296).to_bytes(2, "little") + (3).to_bytes(2, "little"))
    data[unit + 8] = 99  # no unit of resolution: tifffile logs that
    path.write_bytes(data)
    assert (read_photo(path).codes == 7).all()
    status, out, err = python(COMMAND, "info", path)
    assert (status, err) == (0, "")
    assert "8x8 grey" in out
