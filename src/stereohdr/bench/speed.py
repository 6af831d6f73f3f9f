"""How long the methods and their stages take, in units of one call of OpenCV's StereoSGBM (MODE_HH, called HH).

What is compared is called by turns, so that a machine that is busy for a while is so for all; a ratio is the
median of the ratios within one turn.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.bench.machine import describe_machine, limit_memory
from stereohdr.bench.metric_speed import hdrvdp2_call
from stereohdr.bench.peers import opencv_matcher, pandora_matcher
from stereohdr.bench.rows import peak_mib
from stereohdr.bench.stage_speed import array_bytes, matching_calls, paper_calls
from stereohdr.errors import StereoHdrError, StereoHdrWarning
from stereohdr.methods import get_method
from stereohdr.model import HdrResult, StereoPair
from stereohdr.pipeline import fuse
from stereohdr.radiance import code_luma, luminance
from stereohdr.simulation import Camera, expose_pair, room
from stereohdr.simulation.scenes import DEFAULT_BASELINE
from stereohdr.stage_log import Progress
from stereohdr.strips import run_strips

THREADS = 2
"""Of everything that is timed, unless it says otherwise."""

LARGEST_RENDERED = 1500
"""Columns of the scene at most; larger images are enlarged from that."""

DISPARITY_PER_COLUMN = 0.15
"""Largest disparity of the scene per column, at the default baseline."""

EXPOSURES = {"highlights": (2.0, 1 / 8), "shadows": (1 / 8, 2.0)}
"""Exposure times (main, auxiliary) in seconds, by what the auxiliary view adds."""

COPIED_BYTES = 128 * 2**20
"""Size of the array whose copying measures the memory."""

PANDORA_TURNS = 3
"""It takes many seconds."""

MEMORY_SHARE = 0.75
"""Share of the machine's memory that a process of its own may take, so that nothing else is driven out."""

METHODS = {
    "robust": ("robust", "highlights"),
    "robust-shadows": ("robust", "shadows"),
    "paper": ("paper", "highlights"),
}
"""Method and pair of the contenders that fuse."""


@dataclass(frozen=True)
class Case:
    """A size of the images, and what is timed at it."""

    width: int
    height: int
    disparities: int
    """Searched from 0 on."""
    rounds: int
    """Timed turns."""
    contenders: tuple[str, ...]
    """Names: hh, pandora, sgm, hdrvdp2, those of `METHODS`; ``stages`` are single stages; ``alone`` is method
    robust in a process of its own, with its peak memory."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of `fuse`."""

    @property
    def label(self) -> str:
        """Return width x height x disparities."""
        return f"{self.width}x{self.height}x{self.disparities}"

    @property
    def pixels(self) -> int:
        """Return the number of pixels of one view."""
        return self.width * self.height


CASES: dict[str, Case] = {
    "small": Case(
        *(695, 555, 120),
        rounds=7,
        contenders=("hh", "robust", "sgm", "robust-shadows", "paper", "hdrvdp2", "stages", "pandora", "alone"),
    ),
    "hd": Case(1920, 1080, 256, rounds=5, contenders=("hh", "robust", "robust-shadows")),
    "large": Case(6000, 4000, 512, rounds=1, contenders=("alone",), options={"memory": "4GiB"}),
}
"""By the name that the command line knows."""


@dataclass
class Work:
    """Something to be timed, and the times."""

    name: str
    call: Callable[[], Any]
    most: int | None = None
    """Turns at most; None for all."""
    traffic: int = 0
    """Bytes of the arrays that go in and come out."""
    operations: int = 0
    """Elementary steps, where they say more than the bytes."""
    wall: list[float] = field(default_factory=list)
    """Seconds of each turn."""
    cpu: list[float] = field(default_factory=list)
    """Processor seconds of all threads, of each turn."""
    stages: list[dict[str, float]] = field(default_factory=list)
    """Seconds per stage of each turn, of a method."""

    def take_turn(self) -> None:
        """Call once and note the times."""
        if self.most is not None and len(self.wall) >= self.most:
            return
        start = time.perf_counter(), time.process_time()
        result = self.call()
        self.wall.append(time.perf_counter() - start[0])
        self.cpu.append(time.process_time() - start[1])
        if isinstance(result, HdrResult):
            self.stages.append(dict(result.seconds))


def measure_speed(names: Sequence[str], *, progress: Progress | None = None) -> dict[str, Any]:
    """Time some of `CASES`.

    Parameters
    ----------
    names
        Which.
    progress
        Called with a few words as each step begins.

    Returns
    -------
    A document for JSON:

    ``seconds``
        Median, least and most wall seconds, median processor seconds and the number of turns, by contender and
        case (``robust-695x555x120``).
    ``ratio_to_hh``
        For what is measured in HH.
    ``stages``
        Of the methods: milliseconds, the same per megapixel, and bytes per pixel that copying moves meanwhile.
    ``building_blocks``
        Of single stages: milliseconds, the bytes that go in and come out per second, and against copying.
    ``peak_mib``
        Memory of a process that runs method robust once, in all and above its imports.
    ``growth``
        Nanoseconds per pixel and disparity of method robust, by size.
    ``machine``, ``threads``, ``copy_gb_per_s``, ``failed``
        On what it was measured, how fast two threads copy memory there, and what could not be timed, with why.

    Raises
    ------
    MissingDependencyError
        OpenCV is not installed.
    """
    say = progress or (lambda words: None)
    document: dict[str, Any] = {"machine": describe_machine(), "threads": THREADS, "failed": {}}
    for part in ("seconds", "ratio_to_hh", "stages", "building_blocks", "peak_mib", "growth"):
        document[part] = {}
    copying = Work("copy", _copying(), traffic=2 * COPIED_BYTES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        for case in _cases(names):
            say(f"{case.label}: scene")
            pairs = benchmark_pairs(case, kinds=["highlights"] if case.contenders == ("alone",) else None)
            say(f"{case.label}: first calls")
            works = _works(case, pairs)
            for turn in range(case.rounds):
                say(f"{case.label}: turn {turn + 1} of {case.rounds}")
                for work in (*works, copying):
                    work.take_turn()
            rate = copying.traffic / median(copying.wall)
            document["copy_gb_per_s"] = rate / 1e9
            _enter(document, case, works, rate)
            if "alone" in case.contenders:
                say(f"{case.label}: in a process of its own")
                _enter_alone(document, case, pairs["highlights"], rate)
    return document


def _cases(names: Sequence[str]) -> list[Case]:
    """Return the cases; before the large one at least the time of a small one, to tell the growth."""
    cases = [CASES[name] for name in names]
    if "large" in names and "small" in CASES and "small" not in names:
        cases.insert(0, replace(CASES["small"], contenders=("alone",)))
    return cases


def benchmark_pairs(case: Case, kinds: Sequence[str] | None = None) -> dict[str, StereoPair]:
    """Return pairs of the furnished room at exposures 16:1, by what the auxiliary view adds (see `EXPOSURES`).

    The cameras stand so that its disparities fit into the range that is searched.
    """
    shrink = max(1.0, case.width / LARGEST_RENDERED)
    fits = 0.95 * case.disparities / (DISPARITY_PER_COLUMN * case.width)
    scene = room(
        round(case.width / shrink),
        round(case.height / shrink),
        baseline=DEFAULT_BASELINE * min(1.0, fits),
        supersampling=1,
    )
    white = 4 * np.percentile(luminance(scene.radiance_left), 75).astype(np.float32)
    left, right = (
        _resized(view / white, case.height, case.width) for view in (scene.radiance_left, scene.radiance_right)
    )
    return {kind: expose_pair(left, right, EXPOSURES[kind], Camera(), 1) for kind in kinds or EXPOSURES}


def _resized(image: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    if image.shape[:2] == (height, width):
        return image
    factors = (height / image.shape[0], width / image.shape[1], 1)
    return np.asarray(ndimage.zoom(image, factors, order=1, mode="nearest", grid_mode=True), dtype=np.float32)


def _fuse(pair: StereoPair, method: str, case: Case) -> HdrResult:
    config = get_method(method).config_type(max_disparity=case.disparities - 1)
    return fuse(pair, method, config, threads=THREADS, **case.options)


def _works(case: Case, pairs: dict[str, StereoPair]) -> list[Work]:
    """Return what is timed by turns, called once."""
    pair = pairs["highlights"]
    grey = [np.rint(code_luma(photo)).astype(np.uint8) for photo in (pair.left, pair.right)]
    works = []
    for name in case.contenders:
        if name == "hh":
            works.append(Work(name, opencv_matcher(grey[0], grey[1], case.disparities, threads=THREADS)))
        elif name == "pandora":
            call = pandora_matcher(grey[0], grey[1], case.disparities)
            works += [] if call is None else [Work(name, call, most=PANDORA_TURNS)]
        elif name in METHODS:
            method, kind = METHODS[name]
            works.append(Work(name, partial(_fuse, pairs[kind], method, case)))
        elif name == "hdrvdp2":
            works.append(Work(name, hdrvdp2_call((case.height, case.width, 3), threads=THREADS)))
        elif name == "sgm":
            calls = matching_calls(pair, case.disparities, threads=1)
            works.append(Work(name, partial(_call_all, calls)))
        elif name == "stages":
            for make in (matching_calls, paper_calls):
                for stage in make(pair, case.disparities, THREADS):
                    traffic = array_bytes(stage.arguments) + array_bytes(stage())
                    works.append(Work(stage.name, stage, traffic=traffic, operations=stage.operations))
    for work in works:
        work.call()
    return works


def _call_all(calls: Sequence[Callable[[], Any]]) -> None:
    for call in calls:
        call()


def _copying() -> Callable[[], Any]:
    """Return a call that copies an array of `COPIED_BYTES` with all threads."""
    source = np.ones(COPIED_BYTES, dtype=np.uint8)
    target = np.zeros_like(source)

    def copy(start: int, stop: int) -> None:
        target[start:stop] = source[start:stop]

    return lambda: run_strips(copy, COPIED_BYTES, strip_rows=COPIED_BYTES // THREADS, threads=THREADS)


# ------------------------------------------------------------------------------------- what goes into the document


def _enter(document: dict[str, Any], case: Case, works: Sequence[Work], rate: float) -> None:
    """Enter what was timed by turns; `rate` is how many bytes per second the machine copies."""
    hh = next((work for work in works if work.name == "hh"), None)
    for work in works:
        if work.traffic:
            document["building_blocks"][work.name] = _building_block(work, case, rate)
            continue
        key = f"{work.name}-{case.label}"
        document["seconds"][key] = _seconds(work)
        if hh is not None and work.name not in ("hh", "hdrvdp2"):
            mine, theirs = (work.cpu, hh.cpu) if work.name == "sgm" else (work.wall, hh.wall)
            document["ratio_to_hh"][key] = median(a / b for a, b in zip(mine, theirs, strict=False))
        if work.stages:
            document["stages"][key] = _stages(work, case, rate)
        if work.name == "robust":
            document["growth"][case.label] = _per_cell(median(work.wall), case)


def _seconds(work: Work) -> dict[str, float]:
    return {
        "median": median(work.wall),
        "least": min(work.wall),
        "most": max(work.wall),
        "processor": median(work.cpu),
        "turns": len(work.wall),
    }


def _per_cell(seconds: float, case: Case) -> float:
    """Return nanoseconds per pixel and disparity."""
    return 1e9 * seconds / (case.pixels * case.disparities)


def _building_block(work: Work, case: Case, rate: float) -> dict[str, float]:
    seconds = median(work.wall)
    return {
        "ms": 1e3 * seconds,
        "processor_ms": 1e3 * median(work.cpu),
        "ms_per_mpx": 1e9 * seconds / case.pixels,
        "gb_per_s": work.traffic / seconds / 1e9,
        "times_copying": seconds / (work.traffic / rate),
        "operations_per_ns": work.operations / seconds / 1e9,
    }


def _stages(work: Work, case: Case, rate: float) -> dict[str, dict[str, float]]:
    """Return the median of each stage of a method: ms, ms per megapixel, and bytes per pixel copied meanwhile."""
    found = {}
    for name in work.stages[0]:
        seconds = median(turn[name] for turn in work.stages)
        found[name] = {
            "ms": 1e3 * seconds,
            "ms_per_mpx": 1e9 * seconds / case.pixels,
            "copied_bytes_per_pixel": seconds * rate / case.pixels,
        }
    return found


# -------------------------------------------------------------------------------------- in a process of its own


def _enter_alone(document: dict[str, Any], case: Case, pair: StereoPair, rate: float) -> None:
    """Run method ``robust`` in a process of its own; enter its memory, and its time if it was not timed yet."""
    key = f"robust-{case.label}"
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        try:
            work, peak = pool.submit(_fuse_alone, pair, case).result()
        except (StereoHdrError, MemoryError, BrokenProcessPool) as error:
            document["failed"][key] = str(error) or type(error).__name__
            return
    document["peak_mib"][key] = peak
    if "robust" not in case.contenders:
        _enter(document, case, [work], rate)


def _fuse_alone(pair: StereoPair, case: Case) -> tuple[Work, dict[str, float]]:
    """Time method ``robust``; return the times, and the peak memory in MiB: in all, and above the imports.

    The peak is that of the first call, which is timed only if it is the only one.
    """
    limit_memory(MEMORY_SHARE)
    get_method("robust").load()
    before = peak_mib()
    work = Work("robust", partial(_fuse, pair, "robust", case))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        first = work.take_turn if case.rounds == 1 else work.call
        first()
        after = peak_mib()
        while len(work.wall) < case.rounds:
            work.take_turn()
    work.call = tuple  # which can be sent to the other process
    peak = {} if before is None or after is None else {"in_all": after, "above_imports": after - before}
    return work, peak
