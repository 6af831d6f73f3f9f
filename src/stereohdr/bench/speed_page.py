"""The tables and the page of `stereohdr.bench.speed`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from stereohdr.bench.runner import markdown_table

Document = Mapping[str, Any]


@dataclass(frozen=True)
class Goal:
    """A number that is to be reached."""

    name: str
    """What is measured."""
    value: Callable[[Document], float | None]
    """Takes it from the document; None if it is not there."""
    unit: str
    must: float
    aim: float | None = None
    key: str = ""
    """Contender and case whose seconds are shown, too."""
    one_thread: bool = False
    """Whether these are processor seconds."""


def _ratio(key: str) -> Callable[[Document], float | None]:
    return lambda document: document["ratio_to_hh"].get(key)


def _seconds(key: str) -> Callable[[Document], float | None]:
    return lambda document: document["seconds"].get(key, {}).get("median")


def _memory(key: str, which: str) -> Callable[[Document], float | None]:
    return lambda document: document["peak_mib"].get(key, {}).get(which)


def growth(document: Document) -> float | None:
    """Return the largest time per pixel and disparity against that of the smallest image; None with one size."""
    costs = list(document["growth"].values())
    return max(costs) / costs[0] if len(costs) > 1 else None


_SMALL, _HD, _LARGE = "695x555x120", "1920x1080x256", "6000x4000x512"

GOALS = (
    Goal("`robust`, highlights, 695x555, 120", _ratio(f"robust-{_SMALL}"), "HH", 2.0, 1.0, f"robust-{_SMALL}"),
    Goal(
        "`robust`, shadows, 695x555, 120",
        _ratio(f"robust-shadows-{_SMALL}"),
        *("HH", 2.0, 1.0, f"robust-shadows-{_SMALL}"),
    ),
    Goal("`robust`, highlights, 1920x1080, 256", _ratio(f"robust-{_HD}"), "HH", 0.8, 0.4, f"robust-{_HD}"),
    Goal(
        "`robust`, shadows, 1920x1080, 256",
        _ratio(f"robust-shadows-{_HD}"),
        *("HH", 0.8, 0.4, f"robust-shadows-{_HD}"),
    ),
    Goal("`paper`, 695x555, 120", _ratio(f"paper-{_SMALL}"), "HH", 4.0, 2.0, f"paper-{_SMALL}"),
    Goal(
        "census and SGM, maps of both views, one thread's processor time, 695x555, 120",
        _ratio(f"sgm-{_SMALL}"),
        *("HH", 0.6, 0.3, f"sgm-{_SMALL}", True),
    ),
    Goal("HDR-VDP-2, 695x555 RGB", _seconds(f"hdrvdp2-{_SMALL}"), "s", 0.8, 0.4, f"hdrvdp2-{_SMALL}"),
    Goal("growth of the time per pixel and disparity, `robust`", growth, "x", 1.5, 1.0),
    Goal("`robust`, 6000x4000, 512", _seconds(f"robust-{_LARGE}"), "s", 120, 60, f"robust-{_LARGE}"),
    Goal("its peak memory", _memory(f"robust-{_LARGE}", "in_all"), "MiB", 4096),
    Goal("peak memory above the imports, 695x555, 120", _memory(f"robust-{_SMALL}", "above_imports"), "MiB", 350),
)
"""What the project asks of itself."""


def _digits(value: float) -> str:
    """Return three digits, or all of them before the point."""
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"


def goals_table(document: Document) -> str:
    """Return what was measured beside what must be and what would be good, as Markdown."""
    lines = []
    for goal in GOALS:
        value = goal.value(document)
        seconds = document["seconds"].get(goal.key)
        lines.append(
            [
                goal.name,
                "-" if seconds is None else f"{seconds['processor' if goal.one_thread else 'median']:.3g} s",
                "-" if seconds is None or goal.one_thread else f"{seconds['least']:.3g} to {seconds['most']:.3g}",
                "-" if seconds is None else str(seconds["turns"]),
                "-" if value is None else f"{_digits(value)} {goal.unit}",
                f"{goal.must:g} {goal.unit}",
                "" if goal.aim is None else f"{goal.aim:g} {goal.unit}",
                "-" if value is None else "missed" if value > goal.must else "yes",
            ]
        )
    return markdown_table(
        ["case", "median", "least to most", "turns", "measured", "must", "aim", "reached"], lines
    )


def peers_table(document: Document) -> str:
    """Return the times of the others' matching as Markdown."""
    lines = [
        [key, f"{1e3 * seconds['median']:.0f}", f"{1e3 * seconds['processor']:.0f}", str(seconds["turns"])]
        for key, seconds in document["seconds"].items()
        if key.startswith(("hh-", "pandora-"))
    ]
    return markdown_table(["others", "ms", "processor ms", "turns"], lines)


def stages_table(document: Document, key: str) -> str:
    """Return the stages of one method at one size as Markdown."""
    stages = document["stages"][key]
    total = {name: sum(stage[name] for stage in stages.values()) for name in next(iter(stages.values()))}
    lines = [
        [
            name,
            f"{stage['ms']:.1f}",
            f"{stage['ms_per_mpx']:.0f}",
            f"{100 * stage['ms'] / total['ms']:.0f}",
            f"{stage['copied_bytes_per_pixel']:.0f}",
        ]
        for name, stage in [*stages.items(), ("all", total)]
    ]
    return markdown_table([key, "ms", "ms per Mpx", "%", "bytes per pixel that copying moves meanwhile"], lines)


def blocks_table(document: Document) -> str:
    """Return the single stages as Markdown."""
    lines = [
        [
            name,
            f"{block['ms']:.1f}",
            f"{block['processor_ms']:.1f}",
            f"{block['ms_per_mpx']:.1f}",
            f"{block['gb_per_s']:.2f}",
            f"{block['times_copying']:.0f}",
            f"{block['operations_per_ns']:.1f}" if block["operations_per_ns"] else "-",
        ]
        for name, block in document["building_blocks"].items()
    ]
    header = ["single stages, 695x555, 120", "ms", "processor ms", "ms per Mpx", "GB/s in and out", "x copying"]
    return markdown_table([*header, "steps per ns"], lines)


def growth_table(document: Document) -> str:
    """Return the time per pixel and disparity by size as Markdown."""
    costs = document["growth"]
    first = next(iter(costs.values()))
    lines = [[label, f"{cost:.2f}", f"{cost / first:.2f}"] for label, cost in costs.items()]
    return markdown_table(["`robust`, highlights", "ns per pixel and disparity", "against the smallest"], lines)


def machine_text(document: Document) -> str:
    """Return a sentence about the machine."""
    machine = document["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    load = "" if machine["load_before"] is None else f" Load average before the run: {machine['load_before']:.2f}."
    return (
        f"{machine['processor']}, {machine['cores']} cores, {machine['memory_gib']:g} GiB, {machine['system']}; "
        f"{versions}. Two threads copy memory at {document['copy_gb_per_s']:.1f} GB/s (read and written bytes "
        f"together).{load}"
    )


def tables(document: Document) -> list[str]:
    """Return all tables that were measured."""
    found = [goals_table(document), peers_table(document)]
    found += [stages_table(document, key) for key in document["stages"]]
    found += [blocks_table(document)] if document["building_blocks"] else []
    found += [growth_table(document)] if document["growth"] else []
    found += ["\n".join(f"{key}: not timed: {why}" for key, why in document["failed"].items())]
    return [table for table in found if table]


METHOD_TEXT = """\
HH is one call of OpenCV's `StereoSGBM` in MODE_HH (all eight paths, the map of one view) on the grey photos of
the same pair, with the same range of disparities, in the same run. Everything is called by turns, warm and
without reading or writing files; times are medians, ratios the median of the ratios within a turn. All run with
{threads} threads, of which HH uses one; a row that says so is the processor time of one thread. The pair is the
furnished room of `stereohdr.simulation`, photographed at exposures 16:1: for highlights the main view has the
longer exposure, for shadows the shorter one.

The 24 megapixels are fused once, by a process of its own that may take 4 GiB (`fuse(..., memory="4GiB")`), so they
are matched in strips, coarse to fine. Its peak memory is that of the whole process, with the interpreter and the
photos; only reading and writing files is left out, as everywhere here. The growth is that of the time per pixel
and searched disparity from 0.4 to 24 megapixels, above 1 if larger images take more than their share."""

STAGES_TEXT = """\
To compare with what the memory allows: how many bytes per pixel the machine copies in the time of a stage. (A
pair of 8-bit RGB photos has 6 bytes per pixel, its radiance 24.) For single stages: the bytes of the arrays that
go in and come out, per second, and how many times longer than copying these they take; steps are comparisons of
the census, and steps of a path to one disparity of the next pixel."""


def speed_page(document: Document) -> str:
    """Return the page about speed as Markdown."""
    goals, peers, *rest = tables(document)
    version = document["machine"]["versions"].get("stereohdr", "")
    sections = [
        "# Performance",
        f"Made by `{document['command']}` (stereohdr {version}); not edited by hand.",
        machine_text(document),
        METHOD_TEXT.format(threads=document["threads"]),
        "## Goals",
        goals,
        peers,
        "## Stage by stage",
        STAGES_TEXT,
        *rest,
    ]
    return "\n\n".join(sections) + "\n"
