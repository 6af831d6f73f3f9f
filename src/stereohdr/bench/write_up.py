"""The written results: every table, and what holds of the paper's claims, computed from the rows."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from stereohdr import __version__
from stereohdr.bench.contenders import CEILINGS
from stereohdr.bench.rows import Row
from stereohdr.bench.tables import (
    TABLE1_METHODS,
    TABLE2_METHODS,
    ablation_table,
    published_table,
    quality_table,
    table_scenes,
)

CLEAR_Q = 0.5
"""Points of Q below which two scores count as equal."""


def _by_scene(rows: Sequence[Row]) -> dict[str, dict[str, Row]]:
    scenes: dict[str, dict[str, Row]] = {}
    for row in rows:
        if not row.error:
            scenes.setdefault(row.scene, {})[row.method] = row
    return scenes


def compare(rows: Sequence[Row], better: str, worse: str, field: str = "q", clear: float = CLEAR_Q) -> str:
    """Return a sentence on how often one method beats another.

    Parameters
    ----------
    rows
        Finished rows.
    better, worse
        Methods; the claim is that the first is better.
    field
        Score to compare, higher is better.
    clear
        Differences up to this count as equal.
    """
    gains = []
    for methods in _by_scene(rows).values():
        if better in methods and worse in methods:
            a, b = getattr(methods[better], field), getattr(methods[worse], field)
            if a is not None and b is not None:
                gains.append(a - b)
    name = {"q": "Q", "pu21_psnr": "PU21-PSNR"}[field]
    if not gains:
        return f"`{better}` against `{worse}`, {name}: no scene has both."
    wins, losses = sum(g > clear for g in gains), sum(g < -clear for g in gains)
    return (
        f"`{better}` against `{worse}`, {name}: better on {wins}, equal on {len(gains) - wins - losses}, worse on "
        f"{losses} of {len(gains)} scenes; {fmean(gains):+.2f} on average."
    )


def results_page(
    rows: Sequence[Row],
    ablations: Sequence[Row],
    steps: Sequence[Row],
    response_table: str,
    available: Sequence[str],
    command: str,
) -> str:
    """Return the page of results as Markdown.

    Parameters
    ----------
    rows
        Rows of the quality benchmark.
    ablations
        Rows of Table 2.
    steps
        Rows of the ablation of method ``robust``.
    response_table
        Markdown of Figure 2.
    available
        All scenes.
    command
        What made the page.
    """
    paper_scenes = table_scenes(available, "table1")
    table1 = [row for row in rows if row.scene in paper_scenes and row.method in TABLE1_METHODS]
    methods = [m for m in dict.fromkeys(row.method for row in rows) if m not in CEILINGS]
    rivals = [m for m in methods if m not in ("paper", "robust", "oracle")]
    ours = [compare(rows, "robust", m, field) for m in ("paper", *rivals) for field in ("q", "pu21_psnr")]
    claims = [compare(rows, "paper", rival, field) for rival in rivals for field in ("q", "pu21_psnr")]
    claims += [compare(ablations, "paper", variant) for variant in TABLE2_METHODS if variant != "paper"]
    finished = (*rows, *ablations, *steps)
    failed = [f"- {row.scene}, {row.method}: {row.error}" for row in finished if row.error]
    report = next((row.protocol.split("; reference")[0] for row in rows if row.protocol), "")
    sections = [
        "# Results",
        f"Made by `{command}` (stereohdr {__version__}); not edited by hand.",
        "Methods other than `robust`, `paper`, `mv-only` and `oracle` are stand-ins: the originals' details are "
        "not public. `C3` and `C2` are ceilings made from the reference: perfect stereo where the auxiliary view "
        "sees the pixel, and everywhere. `MV Q` and `MV dB` are the main view alone with the same response. "
        "Scenes `R...` are real pairs at two exposures, `<Scene>-<setting>` are made by the simulated camera.",
        f"Protocol: {report}; reference scaled so that its 99th luminance percentile is 100 cd/m2; test aligned "
        "by the median ratio over well-exposed pixels; grey as luminance. The paper states no protocol, so its "
        "values cannot be compared with ours, rankings can.",
        "## Method `robust` against the others",
        "\n".join(f"- {claim}" for claim in ours),
        "## What each step of method `robust` brings",
        "The row `robust` is the full method, mean over the scenes; the others are changes against it when one "
        "step is left out or weakened (`mv-only`: all of them). More Q and dB is better, less of the rest. "
        "`survey-response`: the response of the reduced pair only; `no-toe`: the lowest codes as fitted; "
        "`one-run`: matched along the main view's edges only; `weak-penalties`: P1 5, P2 25; `no-agreement`: "
        "every confirmed match counts; `no-borrowing`, `no-prior`, `no-colour`: clipped pixels without a match "
        "take nothing from the background, from their class, from the other channels; `matched-only`: noisy "
        "pixels without a match stay.",
        ablation_table(steps),
        "## What holds of the paper's claims",
        f"Differences up to {CLEAR_Q:g} (points of Q, dB) count as equal. Q reacts most to the worst artefact; "
        "read it together with PU21-PSNR and the errors in stops.",
        "\n".join(f"- {claim}" for claim in claims),
        "## Table 1",
        published_table(table1, TABLE1_METHODS),
        "The paper's scenes at these settings, made by the simulated camera unless a full Middlebury set is "
        "there, have few pixels in S: they hardly rank stereo methods.",
        "## Table 2: ablations",
        published_table(ablations, TABLE2_METHODS),
        quality_table(ablations),
        "## Figure 2: response curves",
        response_table,
        "## All methods on all scenes",
        quality_table(rows),
    ]
    if failed:
        sections += ["## Not computed", "\n".join(failed)]
    return "\n\n".join(sections) + "\n"
