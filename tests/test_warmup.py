import subprocess
import sys
from pathlib import Path

import numba
import pytest

from stereohdr import StereoPair
from stereohdr.errors import StereoHdrError
from stereohdr.stage_log import StageLog
from stereohdr.warmup import (
    COMPILED_ALWAYS,
    COMPILED_ONCE,
    LONG_SHORT,
    SHORT_LONG,
    cold_start,
    small_pair,
    warm_up,
)

from command_line import run
from conftest import make_pair

TESTS = Path(__file__).parent

COMPILED_TOO_LATE = """
import sys
import warnings
from numba.core.dispatcher import Dispatcher
from conftest import make_pair
from stereohdr import StereoHdrWarning, fuse
from stereohdr.warmup import LAST_STAGE, compile_part

warnings.simplefilter("ignore", StereoHdrWarning)

def signatures():
    modules = [module for name, module in sys.modules.items() if name.startswith("stereohdr.")]
    kernels = [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
    return {(kernel.__qualname__, str(signature)) for kernel in kernels for signature in kernel.signatures}

def pairs():
    return [make_pair(90, 150, times=times) for times in ((0.64, 0.04), (0.02, 0.32))]

for part in ("highlights", "shadows"):
    compile_part(part)
for pair in pairs():
    compiled = {}
    fuse(pair, "robust", progress=lambda stage: compiled.update({stage: signatures()}))
    for name, signature in sorted(signatures() - compiled[LAST_STAGE]):
        print("last stage:", name, signature)
for part in ("robust", "paper"):
    compile_part(part)
before = signatures()
assert len(before) > 20, len(before)
for pair in pairs():
    for method in ("robust", "paper"):
        fuse(pair, method)
for name, signature in sorted(signatures() - before):
    print("some stage:", name, signature)
"""


def test_the_parts_compile_all_that_the_methods_need():
    command = [sys.executable, "-c", COMPILED_TOO_LATE]
    done = subprocess.run(command, capture_output=True, text=True, cwd=TESTS)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("exposures", [LONG_SHORT, SHORT_LONG])
def test_the_small_pair_is_clipped_in_one_view_only_and_not_throughout(exposures):
    pair = small_pair(exposures)
    white = [(photo.codes == photo.white).any(axis=2).mean() for photo in (pair.left, pair.right)]
    longer, shorter = white if exposures == LONG_SHORT else white[::-1]
    assert 0.1 < longer < 0.8
    assert shorter < longer / 2


class FakeProcess:
    """Stands in for the second process; notes what happens to it."""

    def __init__(self, *parts):
        self.happened = [("start", *parts)]

    def communicate(self):
        self.happened.append("wait")
        return "3\n", None

    def kill(self):
        self.happened.append("kill")


@pytest.fixture
def processes(monkeypatch):
    """Collect second processes instead of starting them."""
    started = []

    def start(*parts):
        started.append(FakeProcess(*parts))
        return started[-1]

    monkeypatch.setattr("stereohdr.warmup.start_process", start)
    monkeypatch.setattr("stereohdr.warmup.kernel_folders", lambda: (Path("somewhere"),))
    return started


def compile_something():
    """Have Numba compile a function that is new."""

    @numba.njit
    def successor(x):
        return x + 1

    assert successor(1) == 2


def stages(*names, pair: StereoPair, method="robust", cold_at=None):
    """Pass through stages; `cold_at` needs two new kernels. Return what was said, and the stages."""
    said, seen = [], []
    with cold_start(pair, method, seen.append, say=said.append) as progress:
        log = StageLog(progress=progress)
        for name in names:
            with log.stage(name):
                if name == cold_at:
                    compile_something()
                    compile_something()
    return said, seen


@pytest.mark.parametrize(("times", "part"), [((0.64, 0.04), "highlights"), ((0.04, 0.64), "shadows")])
def test_a_cold_start_is_announced_once_and_shared_with_a_second_process(processes, times, part):
    said, seen = stages("checks", "survey", "fusion", "end", pair=make_pair(times=times), cold_at="checks")
    assert said == [COMPILED_ONCE]
    assert seen == ["checks", "survey", "fusion", "end"]
    assert [process.happened for process in processes] == [[("start", part), "wait"]]


def test_a_warm_start_is_silent(processes, pair):
    assert stages("checks", "fusion", pair=pair) == ([], ["checks", "fusion"])
    assert not processes


def test_when_only_the_last_stage_is_cold_no_process_is_started(processes, pair):
    said, _ = stages("checks", "fusion", pair=pair, cold_at="fusion")
    assert said == [COMPILED_ONCE]
    assert not processes


def test_other_methods_have_no_second_process(processes, pair):
    said, _ = stages("checks", "fusion", pair=pair, method="paper", cold_at="checks")
    assert said == [COMPILED_ONCE]
    assert not processes


def test_the_second_process_ends_when_the_pair_is_refused(processes, pair):
    def refuse():
        compile_something()
        raise KeyError

    with pytest.raises(KeyError), cold_start(pair, "robust", lambda stage: None):
        refuse()
    assert [process.happened for process in processes] == [[("start", "shadows"), "kill", "wait"]]


def test_without_a_folder_nothing_is_kept_and_no_process_is_started(processes, pair, monkeypatch):
    monkeypatch.setattr("stereohdr.warmup.kernel_folders", tuple)
    said, _ = stages("checks", "fusion", pair=pair, cold_at="checks")
    assert said == [COMPILED_ALWAYS]
    assert not processes
    with pytest.raises(StereoHdrError, match="NUMBA_CACHE_DIR"):
        warm_up()
    assert not processes


@pytest.mark.parametrize("quiet", [False, True])
def test_fuse_says_on_standard_error_that_it_compiles(tmp_path, monkeypatch, capsys, processes, quiet):
    import stereohdr.pipeline
    from stereohdr.io.images import write_png

    warm_fuse = stereohdr.pipeline.fuse

    def cold_fuse(*arguments, **options):
        compile_something()
        return warm_fuse(*arguments, **options)

    monkeypatch.setattr("stereohdr.pipeline.fuse", cold_fuse)
    pair = make_pair()
    write_png(tmp_path / "l.png", pair.left.codes)
    write_png(tmp_path / "r.png", pair.right.codes)
    more = ("-q",) if quiet else ()
    out = tmp_path / "o.npy"
    assert run("fuse", tmp_path / "l.png", tmp_path / "r.png", "-o", out, "--exposures", 0.04, 0.16, *more) == 0
    assert capsys.readouterr().err.splitlines().count(COMPILED_ONCE) == (0 if quiet else 1)
    assert len(processes) == 1


def test_warmup_leaves_nothing_to_compile(capsys):
    assert run("warmup", "-q") == 0
    assert capsys.readouterr().out == ""
    assert run("warmup") == 0
    assert capsys.readouterr().out.startswith("everything is compiled already (")
