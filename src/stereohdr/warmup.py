"""Compiling kernels before they are needed, in a second process: compiling takes one processor only.

``python -m stereohdr.warmup PART...`` compiles what the parts of a method need by running them on small images,
and prints how many kernels it compiled; the cache on disk hands them to the processes that come after.
"""

from __future__ import annotations

import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba.core.event import Event, Listener, install_listener

from stereohdr.errors import StereoHdrError
from stereohdr.kernels import kernel_folders
from stereohdr.model import Photo, ResponseCurve, StereoPair
from stereohdr.pipeline import fuse
from stereohdr.stage_log import Progress

SIZE = (72, 120)
"""Rows and columns of the images that parts are run on."""

SHIFT = 6
"""Their disparity in pixels."""

LONG_SHORT, SHORT_LONG = (1.0, 0.125), (0.125, 1.0)
"""Exposure times (main, auxiliary) in seconds for the two directions of method robust."""

LAST_STAGE = "fusion"
"""The stage of method robust before which the kernels of its last part must be there."""

COMPILED_ONCE = "compiling kernels, once: later runs start at once (stereohdr warmup does it ahead)"
COMPILED_ALWAYS = "compiling kernels, as in every run: no folder can be written to keep them (see NUMBA_CACHE_DIR)"


@dataclass(frozen=True)
class WarmUp:
    """What `warm_up` did."""

    compiled: int
    """Kernels that were compiled, in all processes."""
    seconds: float
    """How long it took."""
    folders: tuple[Path, ...]
    """Where the compiled kernels are kept."""


def warm_up(*, progress: Progress | None = None) -> WarmUp:
    """Compile the kernels of method ``robust``, then of ``paper``, in two processes; skip those that are there.

    Parameters
    ----------
    progress
        Called with a few words when a step begins.

    Raises
    ------
    StereoHdrError
        There is no folder to keep compiled kernels in.
    """
    import stereohdr.disparity  # noqa: F401 - any module with kernels tells whether they can be kept

    if not kernel_folders():
        raise StereoHdrError(
            "no folder can be written to keep compiled kernels in; set NUMBA_CACHE_DIR to one that can"
        )
    start = time.perf_counter()
    say = progress or (lambda words: None)
    say("compiling, in two processes")
    counter = _Counter()
    with start_process("highlights", "paper") as second, install_listener("numba:compile", counter):
        try:
            compile_part("matching")
            compile_part("shadows")
        except BaseException:
            second.kill()
            raise
        compiled = second.communicate()[0]
        say("checking")
        for part in ("robust", "paper"):  # compiles what no part has covered, and what a process that failed left
            compile_part(part)
    return WarmUp(
        compiled=counter.kernels + int(compiled or 0),
        seconds=time.perf_counter() - start,
        folders=kernel_folders(),
    )


def start_process(*parts: str) -> subprocess.Popen[str]:
    """Start to compile parts in another process, which prints the number of kernels that it compiled."""
    command = [sys.executable, "-P", "-m", "stereohdr.warmup", *parts]
    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )


@contextmanager
def cold_start(
    pair: StereoPair, method: str, progress: Progress, *, say: Callable[[str], None] | None = None
) -> Iterator[Progress]:
    """Get along with kernels that are not compiled yet while a pair is fused.

    When the first one is compiled, `say` is called with a sentence, and a second process begins to compile those
    of the last stage.

    Parameters
    ----------
    pair, method
        What is fused.
    progress
        Called with the name of each stage.

    Returns
    -------
    What to give to `fuse` instead of `progress`.
    """
    part = None
    if method == "robust":
        part = "highlights" if pair.exposures[1] < pair.exposures[0] else "shadows"
    listener = _ColdStart(say, part)

    def before(stage: str) -> None:
        progress(stage)
        if stage == LAST_STAGE:
            listener.wait()

    with install_listener("numba:compile", listener):
        try:
            yield before
        finally:
            listener.stop()


class _ColdStart(Listener):
    """Acts on the first kernel that is compiled; see `cold_start`."""

    def __init__(self, say: Callable[[str], None] | None, part: str | None) -> None:
        self._say = say
        self._part = part
        self._noticed = False
        self._process: subprocess.Popen[str] | None = None

    def on_start(self, event: Event) -> None:
        if self._noticed:
            return
        self._noticed = True
        kept = bool(kernel_folders())
        if self._say is not None:
            self._say(COMPILED_ONCE if kept else COMPILED_ALWAYS)
        if kept and self._part is not None:
            self._process = start_process(self._part)

    def on_end(self, event: Event) -> None:
        pass

    def wait(self) -> None:
        """Wait for the second process, whose kernels are needed now; from now on there will be none."""
        self._part = None
        if self._process is not None:
            self._process.communicate()
            self._process = None

    def stop(self) -> None:
        """End the second process, if it still runs."""
        if self._process is not None:
            self._process.kill()
        self.wait()


class _Counter(Listener):
    """Counts the package's own kernels as they are compiled, inner ones too."""

    def __init__(self) -> None:
        self.kernels = 0

    def on_start(self, event: Event) -> None:
        assert event.data is not None
        self.kernels += event.data["dispatcher"].py_func.__module__.startswith("stereohdr.")

    def on_end(self, event: Event) -> None:
        pass


# ---------------------------------------------------------------------------------------------------------- parts


def compile_part(name: str) -> None:
    """Run one of `PARTS` on small images."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        PARTS[name]()


def small_pair(exposures: tuple[float, float]) -> StereoPair:
    """Return a textured wall in which both views are clipped here and there; exposure times in seconds."""
    generator = np.random.default_rng(1)
    height, width = SIZE
    column = np.linspace(0, 3 * np.pi, width + SHIFT)
    row = np.linspace(0, 2 * np.pi, height)[:, None]
    waves = np.stack([np.sin(column + c) * np.cos(row + 0.3 * c) for c in range(3)], axis=-1)
    radiance = np.exp(2.5 * waves - 0.7 + generator.normal(0, 0.3, waves.shape))
    left, right = (
        Photo(np.rint(255 * np.clip(view * time, 0, 1) ** (1 / 2.2)).astype(np.uint8), time)
        for view, time in zip((radiance[:, :width], radiance[:, SHIFT:]), exposures, strict=True)
    )
    return StereoPair(left, right)


def _compile_matching() -> None:
    from stereohdr.checks import check_views
    from stereohdr.survey import survey_pair

    pair = small_pair(LONG_SHORT)
    check_views(pair)
    survey_pair(pair)


def _compile_highlights() -> None:
    from stereohdr.radiance import initial_radiance
    from stereohdr.restoration.highlights import Evidence, restore_highlights

    pair = small_pair(LONG_SHORT)
    clipped = pair.main_photo.codes >= pair.main_photo.white
    main = initial_radiance(pair.main_photo, ResponseCurve.srgb(3), exposure=pair.exposures[0])
    generator = np.random.default_rng(1)
    # Some of it below the clip value, so that bounds count.
    seen = main * generator.lognormal(0.2, 0.5, main.shape).astype(np.float32)
    usable = np.broadcast_to(generator.random(SIZE)[..., None] < 0.5, clipped.shape)
    restore_highlights(main, clipped, Evidence(seen, usable), Evidence(seen, ~usable))


def _compile_shadows() -> None:
    from stereohdr.radiance import initial_radiance
    from stereohdr.restoration.shadows import clean_shadows

    pair = small_pair(SHORT_LONG)
    response = ResponseCurve.srgb(3)
    main, auxiliary = (
        initial_radiance(photo, response, exposure=time)
        for photo, time in zip((pair.main_photo, pair.auxiliary_photo), pair.exposures, strict=True)
    )
    usable = pair.auxiliary_photo.codes < pair.auxiliary_photo.white
    clean_shadows(pair.main_photo, main, auxiliary, usable, response, exposure=pair.exposures[0])


def _compile_robust() -> None:
    for exposures in (LONG_SHORT, SHORT_LONG):
        fuse(small_pair(exposures), "robust")


def _compile_paper() -> None:
    fuse(small_pair(LONG_SHORT), "paper")


PARTS: dict[str, Callable[[], None]] = {
    "matching": _compile_matching,
    "highlights": _compile_highlights,
    "shadows": _compile_shadows,
    "robust": _compile_robust,
    "paper": _compile_paper,
}
"""Parts of methods by name; ``robust`` and ``paper`` are whole methods."""


def _main() -> None:
    counter = _Counter()
    with install_listener("numba:compile", counter):
        for part in sys.argv[1:]:
            compile_part(part)
    print(counter.kernels)


if __name__ == "__main__":
    _main()
