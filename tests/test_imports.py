import subprocess
import sys

import pytest

import stereohdr

HEAVY = ("numba", "scipy", "OpenEXR", "skimage", "PIL", "tifffile", "cv2", "matplotlib", "rich")


@pytest.mark.parametrize(
    "code",
    [
        "import stereohdr",
        "import stereohdr.cli; stereohdr.cli.main(['--help'])",
        "import stereohdr.cli; stereohdr.cli.main(['fuse', '--help'])",
        "import stereohdr; stereohdr.Photo, stereohdr.read_photo, stereohdr.fuse",
    ],
)
def test_nothing_heavy_is_loaded(code):
    script = f"""
import sys
try:
    {code}
except SystemExit as stop:
    assert not stop.code, stop.code
loaded = [name for name in {HEAVY!r} if name in sys.modules]
print("loaded:", *loaded, file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1].split() == ["loaded:"]


def test_every_public_name_is_there():
    for name in stereohdr.__all__:
        assert getattr(stereohdr, name) is not None
    assert dir(stereohdr) == stereohdr.__all__
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        stereohdr.nothing  # noqa: B018


def test_fuse_stays_a_function_after_its_module_was_imported():
    import stereohdr.pipeline

    assert callable(stereohdr.fuse)
    assert stereohdr.fuse is stereohdr.pipeline.fuse
