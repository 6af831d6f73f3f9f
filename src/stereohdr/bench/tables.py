"""Which scenes and contenders make which table, and how it is printed."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from stereohdr.bench.contenders import ROBUST_VARIANTS, VARIANTS
from stereohdr.bench.published import published_score
from stereohdr.bench.rows import Row
from stereohdr.bench.runner import markdown_table

TABLE1_METHODS = ("mv-only", "lin2009", "baetz2014", "paper")
"""The columns of the paper's Table 1, and the main view alone."""

TABLE2_METHODS = tuple(VARIANTS)
"""The rows of the paper's Table 2."""

ABLATION_METHODS = ("mv-only", "robust", *ROBUST_VARIANTS)
"""Method ``robust``, and what each of its steps brings."""

ABLATION_SCENES = (
    "R1-half",
    "R2-half",
    "R3-half",
    "R4",
    *(f"{scene}-{setting}" for scene in ("Art", "Aloe", "Moebius") for setting in ("long-short", "short-dark")),
    "room",
    "street-night",
)
"""Scenes of that table."""

PAPER_SCENES = ("Art", "Aloe", "Moebius", "Jumble")
"""Scenes of the paper's tables."""

QUALITY_METHODS = (
    "mv-only",
    "opencv",
    "lin2009",
    "baetz2014",
    "sun2010",
    "paper",
    "robust",
    "oracle",
    "C3",
    "C2",
)
"""Everything that is compared on every scene."""


def table_scenes(available: Sequence[str], table: str) -> list[str]:
    """Return the scenes of a table that the data offer, in their order.

    ``table1``: the paper's scenes at normal-long and short-long; ``table2``: at short-long; ``quality``: all. Of
    the paper's scenes its own inputs (full Middlebury sets) where they are, else pairs made by the simulator.
    ``ablation``: `ABLATION_SCENES`.
    """
    if table == "quality":
        return list(available)
    if table == "ablation":
        return [name for name in ABLATION_SCENES if name in available]
    settings = ("normal-long", "short-long") if table == "table1" else ("short-long",)
    own = [f"{scene}-paper-{setting}" for setting in settings for scene in PAPER_SCENES]
    stand_ins = [f"{scene}-{setting}" for setting in settings for scene in PAPER_SCENES]
    return [name for name in own if name in available] or [name for name in stand_ins if name in available]


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def quality_table(rows: Sequence[Row]) -> str:
    """Return all rows with their main scores as Markdown."""
    header = ["scene, method", "Q", "Qv", "Q_MOS", "PU21 dB", "SSIM", "stops", "in S", "Sx vis.", "bad2 %"]
    header += ["resp.", "gap Q", "gap PU", "MV Q", "MV dB", "s", "MiB"]
    lines = []
    for row in rows:
        if row.error:
            continue
        bad2 = None if row.bad2 is None else 100 * row.bad2
        lines.append(
            [
                f"{row.scene} {row.method}",
                _number(row.q),
                _number(row.qv),
                _number(row.q_mos),
                _number(row.pu21_psnr),
                _number(row.pu21_ssim, 4),
                _number(row.log2_rmse, 3),
                _number(row.log2_rmse_s, 3),
                _number(row.log2_rmse_sx_visible, 3),
                _number(bad2, 1),
                _number(row.response_rmse, 3),
                _number(row.gap_closed_q),
                _number(row.gap_closed_pu),
                _number(row.mv_only_q),
                _number(row.mv_only_pu21_psnr),
                _number(row.seconds, 1),
                _number(row.peak_mib, 0),
            ]
        )
    return markdown_table(header, lines)


def ablation_table(rows: Sequence[Row], full: str = "robust") -> str:
    """Return, for each variant of a method, the mean change against it over the scenes that both have.

    Columns: points of Q, dB of PU21-PSNR, stops in Sx where visible, percent of bad disparities, RMS error of the
    response, seconds; positive is more. Methods without a disparity or response of their own have a dash.
    """
    by_pair = {(row.scene, row.method): row for row in rows if not row.error}
    scenes = list(dict.fromkeys(row.scene for row in rows))
    fields = ("q", "pu21_psnr", "log2_rmse_sx_visible", "bad2", "response_rmse", "seconds")
    digits = (2, 2, 3, 1, 4, 2)
    lines = []
    for method in dict.fromkeys(row.method for row in rows):
        pairs = [(by_pair.get((scene, full)), by_pair.get((scene, method))) for scene in scenes]
        both = [(ours, other) for ours, other in pairs if ours and other]
        cells = []
        for field, places in zip(fields, digits, strict=True):
            values = [(getattr(ours, field), getattr(other, field)) for ours, other in both]
            known = [(a, b) for a, b in values if a is not None and b is not None]
            scale = 100 if field == "bad2" else 1
            if method == full:
                cells.append(_number(scale * fmean(a for a, _ in known) if known else None, places))
            else:
                change = scale * fmean(b - a for a, b in known) if known else None
                cells.append("-" if change is None else f"{change:+.{places}f}")
        lines.append([method, *cells, str(len(both))])
    header = ["method: mean, others: change", "Q", "PU21 dB", "Sx vis. stops", "bad2 %", "resp.", "s", "scenes"]
    return markdown_table(header, lines)


def published_table(rows: Sequence[Row], methods: Sequence[str]) -> str:
    """Return Q by scene and method, each with the paper's own number beside it, and averages."""
    scenes = list(dict.fromkeys(row.scene for row in rows))
    by_pair = {(row.scene, row.method): row for row in rows if not row.error}
    header = ["HDR-VDP-2 Q: ours (paper's, on its images)", *methods]

    def cell(ours: float | None, theirs: float | None) -> str:
        return f"{_number(ours)} ({_number(theirs)})"

    lines = []
    for scene in scenes:
        found = [by_pair.get((scene, method)) for method in methods]
        scores = [row.q if row else None for row in found]
        lines.append(
            [
                scene,
                *(cell(q, published_score(scene, m)) for q, m in zip(scores, methods, strict=True)),
            ]
        )
    averages = []
    for method in methods:
        ours = [r.q for s in scenes if (r := by_pair.get((s, method))) and r.q is not None]
        theirs = [p for s in scenes if (p := published_score(s, method)) is not None]
        averages.append(cell(fmean(ours) if ours else None, fmean(theirs) if theirs else None))
    if len(scenes) > 1:
        lines.append(["average", *averages])
    return markdown_table(header, lines)
