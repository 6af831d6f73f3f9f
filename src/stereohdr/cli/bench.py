"""``stereohdr bench``: the paper's tables and ours."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence


class Table(StrEnum):
    """What to run."""

    TABLE1 = "table1"
    TABLE2 = "table2"
    FIGURE2 = "figure2"
    QUALITY = "quality"
    ABLATION = "ablation"
    ALL = "all"
    METRIC = "metric"
    SPEED = "speed"


class Cases(StrEnum):
    """Sizes at which speed is measured."""

    SMALL = "small"
    HD = "hd"
    LARGE = "large"
    ALL = "all"


def bench_command(
    table: Annotated[
        Table,
        typer.Argument(
            metavar="TABLE",
            help="table1: methods on the paper's scenes; table2: the paper's ablations; figure2: response curves; "
            "quality: everything on every scene; ablation: what each step of method robust brings; "
            "all: all of these; metric: time and memory of HDR-VDP-2; speed: everything beside OpenCV's stereo.",
        ),
    ],
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of data sets; without it only procedural scenes are there."),
    ] = None,
    scenes: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Scenes, with commas; those of the table by default.")
    ] = None,
    methods: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Methods, with commas; those of the table by default.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Rows computed at a time.")] = 1,
    results: Annotated[
        Path, typer.Option(metavar="FILE", help="Finished rows are kept here and skipped the next time.")
    ] = Path("stereohdr-bench.jsonl"),
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute finished rows anew.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write the rows.")] = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also draw every row: result, visible errors, disparity.")
    ] = None,
    markdown: Annotated[
        Path | None, typer.Option(metavar="FILE.md", help="With all and speed: write the page of results.")
    ] = None,
    cases: Annotated[
        Cases, typer.Option(help="With speed: 695x555, 1920x1080, 6000x4000, or all of them.")
    ] = Cases.ALL,
    list_scenes: Annotated[bool, typer.Option("--list", help="Only list the scenes that are there.")] = False,
) -> None:
    """Rerun the tables of the paper, and ours, on the scenes that you have."""
    from stereohdr.bench.tables import (
        ABLATION_METHODS,
        QUALITY_METHODS,
        TABLE1_METHODS,
        TABLE2_METHODS,
        ablation_table,
        published_table,
        quality_table,
        table_scenes,
    )
    from stereohdr.cli.fuse import check_outputs
    from stereohdr.datasets.registry import benchmark_scenes
    from stereohdr.errors import InputError
    from stereohdr.io.files import make_folder
    from stereohdr.report import write_text

    if table is Table.METRIC:
        _metric(json_file)
        return
    if table is Table.SPEED:
        check_outputs([json_file, markdown], [])
        _speed(cases, json_file, markdown)
        return
    available = list(benchmark_scenes(data))
    if list_scenes:
        typer.echo("\n".join(available))
        return
    kind = table.value if table in (Table.TABLE1, Table.TABLE2, Table.ABLATION) else "quality"
    chosen = _names(scenes) or table_scenes(available, kind)
    unknown = [name for name in chosen if name not in available]
    if unknown:
        raise InputError(
            f"no scene {', '.join(unknown)} in {data or 'the procedural scenes'}; there are {', '.join(available)}"
        )
    if not chosen:
        raise InputError(
            f"the scenes of {table.value} are not there; give --data DIR with the Middlebury sets, or --scenes"
        )
    check_outputs([results, json_file, markdown], [])
    if pictures is not None:
        make_folder(pictures)
    if table is Table.FIGURE2:
        _figure2(data, chosen, json_file, pictures)
        return
    own = {Table.TABLE1: TABLE1_METHODS, Table.TABLE2: TABLE2_METHODS, Table.ABLATION: ABLATION_METHODS}
    default = own.get(table, QUALITY_METHODS)
    labels = _names(methods) or list(default)

    def run(names: Sequence[str], contenders: Sequence[str]) -> list:
        return _run(data, names, contenders, results=results, jobs=jobs, fresh=fresh, pictures=pictures)

    rows = run(chosen, labels)
    if table is Table.ALL:
        from stereohdr.bench.write_up import results_page

        ablations = run(table_scenes(chosen, "table2"), TABLE2_METHODS)
        steps = run(table_scenes(chosen, "ablation"), ABLATION_METHODS)
        curves = _figure2(data, [name for name in chosen if name.startswith("R")] or chosen, None, pictures)
        if markdown is not None:
            words = ["stereohdr bench all", "--data DIR" if data else "", f"--scenes {scenes}" if scenes else ""]
            command = " ".join([word for word in words if word] + [f"--markdown {markdown.name}"])
            write_text(markdown, results_page(rows, ablations, steps, curves, chosen, command))
    if json_file is not None:
        _write_rows(json_file, rows)
    if table in (Table.TABLE1, Table.TABLE2):
        typer.echo(published_table(rows, labels) + "\n")
    if table is Table.ABLATION:
        typer.echo(ablation_table(rows) + "\n")
    typer.echo(quality_table(rows) + "\n")
    for row in rows:
        if row.error:
            typer.echo(f"{row.scene} {row.method}: {row.error}")
    typer.echo(
        "Methods other than robust, paper and mv-only are stand-ins where the originals' details are not public.\n"
        "Protocol: 30 pixels per degree; reference p99 luminance at 100 cd/m2; test aligned by the median ratio "
        "over well-exposed pixels; rgb-bt.709, grey: luminance."
    )


def _names(text: str | None) -> list[str]:
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def _run(
    data: Path | None,
    scenes: Sequence[str],
    labels: Sequence[str],
    *,
    results: Path,
    jobs: int,
    fresh: bool,
    pictures: Path | None,
) -> list:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from stereohdr.bench.contenders import contender_config
    from stereohdr.bench.runner import Results, run_rows

    for label in labels:
        contender_config(label)  # unknown names end here, not after an hour
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("rows", total=len(scenes) * len(labels))

        def report(done: int, total: int, row) -> None:
            bar.update(task, completed=done, description=f"{row.scene} {row.method}")

        return run_rows(
            data,
            scenes,
            labels,
            results=Results(results),
            jobs=jobs,
            fresh=fresh,
            pictures=pictures,
            progress=report,
        )


def _write_rows(path: Path, rows: list) -> None:
    from dataclasses import asdict

    from stereohdr.bench.rows import as_json
    from stereohdr.metrics.protocol import Protocol
    from stereohdr.report import write_json

    write_json(path, {"protocol": asdict(Protocol()), "rows": [as_json(row) for row in rows]})


def _figure2(data: Path | None, scenes: Sequence[str], json_file: Path | None, pictures: Path | None) -> str:
    from stereohdr.bench.figure2 import curve_errors, response_curves, save_curves
    from stereohdr.bench.runner import markdown_table
    from stereohdr.cli.progress import show_progress
    from stereohdr.datasets.registry import load_scene
    from stereohdr.report import write_json

    content, lines = [], []
    with show_progress() as progress:
        for name in scenes:
            progress(name)
            scene = load_scene(name, data)
            curves, missing = response_curves(scene)
            errors = curve_errors(curves)
            if pictures is not None:
                save_curves(pictures / f"{name}_response.png", scene, curves)
            content.append(
                {
                    "scene": name,
                    "response_rmse": errors,
                    "curves": {key: curve.log_exposure.tolist() for key, curve in curves.items()},
                    "errors": missing,
                }
            )
            lines.append([name, *(f"{errors[key]:.3f}" if key in errors else "-" for key in ("cdf", "sift"))])
    if json_file is not None:
        write_json(json_file, {"rows": content})
    text = markdown_table(["RMS error of ln X, codes 5 to 250", "CDF (paper)", "SIFT (conventional)"], lines)
    typer.echo(text)
    return text


def _metric(json_file: Path | None) -> None:
    from stereohdr.bench.metric_speed import measure_hdrvdp2
    from stereohdr.report import write_json

    measured = measure_hdrvdp2()
    typer.echo(
        f"HDR-VDP-2 at 695x555 RGB, warm: median {measured['seconds_median']:.2f} s of {measured['runs']} runs "
        f"({measured['seconds_min']:.2f} to {measured['seconds_max']:.2f}), {measured['threads']} threads; "
        f"peak memory {measured['peak_images']:.1f} float64 images ({measured['peak_mib']:.0f} MiB)"
    )
    if json_file is not None:
        write_json(json_file, measured)


def _speed(cases: Cases, json_file: Path | None, markdown: Path | None) -> None:
    from stereohdr.bench.speed import CASES, measure_speed
    from stereohdr.bench.speed_page import machine_text, speed_page, tables
    from stereohdr.cli.progress import show_progress
    from stereohdr.report import write_json, write_text

    with show_progress() as progress:
        document = measure_speed(list(CASES) if cases is Cases.ALL else [cases.value], progress=progress)
    files = [f"--{name} {path.name}" for name, path in (("json", json_file), ("markdown", markdown)) if path]
    document["command"] = " ".join([f"stereohdr bench speed --cases {cases.value}", *files])
    typer.echo("\n\n".join([machine_text(document), *tables(document)]))
    if json_file is not None:
        write_json(json_file, document)
    if markdown is not None:
        write_text(markdown, speed_page(document))
