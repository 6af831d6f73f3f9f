"""Running many rows: each in a process of its own, finished ones kept and skipped the next time."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

from stereohdr import __version__
from stereohdr.bench.contenders import contender_config
from stereohdr.bench.rows import Row, as_json, score
from stereohdr.datasets.registry import load_scene
from stereohdr.errors import FileFormatError, StereoHdrError
from stereohdr.metrics.protocol import Protocol
from stereohdr.report import write_text
from stereohdr.strips import available_threads


class Results:
    """Finished rows in a file of JSON lines: one dictionary per row, appended as it is finished.

    Parameters
    ----------
    path
        The file; created when the first row is added.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows: dict[str, Row] = {}
        if path.exists():
            text = path.read_text(encoding="utf-8")
            whole = text[: text.rfind("\n") + 1]
            if whole != text:  # a run was killed in the middle of a line: that row is not finished
                write_text(path, whole)
            for number, line in enumerate(whole.splitlines(), start=1):
                try:
                    content = json.loads(line)
                    self._rows[content["key"]] = Row.from_json(content)
                except (ValueError, KeyError, TypeError) as error:
                    raise FileFormatError(
                        f"{path}: line {number} is not a finished row; give another --results file"
                    ) from error

    def get(self, key: str) -> Row | None:
        """Return the finished row of this key, None if there is none."""
        return self._rows.get(key)

    def add(self, key: str, row: Row) -> None:
        """Keep a finished row."""
        self._rows[key] = row
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, **as_json(row)}) + "\n")
            file.flush()
            os.fsync(file.fileno())


def row_key(scene: str, label: str, protocol: Protocol) -> str:
    """Return what identifies a row: scene, contender, version, and a digest of all settings."""
    settings = json.dumps([asdict(contender_config(label)), asdict(protocol)], sort_keys=True)
    digest = hashlib.sha256(settings.encode()).hexdigest()[:12]
    return f"{scene} {label} {__version__} {digest}"


def compute_row(
    data: Path | None, scene: str, label: str, protocol: Protocol, threads: int, pictures: Path | None
) -> Row:
    """Load a scene and score one contender on it; a row with an error where that is not possible."""
    try:
        return score(load_scene(scene, data), label, protocol=protocol, threads=threads, pictures=pictures)
    except StereoHdrError as error:
        message = str(error)
        if data is not None:  # a page of results does not tell where the data are
            message = message.replace(os.path.join(data, ""), "")
        return Row(scene, label, error=message)


def run_rows(
    data: Path | None,
    scenes: Sequence[str],
    labels: Sequence[str],
    *,
    results: Results,
    protocol: Protocol | None = None,
    jobs: int = 1,
    fresh: bool = False,
    pictures: Path | None = None,
    progress: Callable[[int, int, Row], None] | None = None,
) -> list[Row]:
    """Compute all rows of a table that are not finished yet.

    Parameters
    ----------
    data
        Folder of data sets; None for procedural scenes only.
    scenes, labels
        Names of scenes and contenders; every pair of them is a row.
    results
        Where finished rows are kept.
    protocol
        Conditions of the comparison.
    jobs
        Processes at a time. Each row has a process of its own, which makes its peak memory its own.
    fresh
        Compute finished rows anew.
    pictures
        Existing folder for one picture per row; none by default.
    progress
        Called after each row with the number done, the number in all, and the row.

    Returns
    -------
    Rows in the order of scenes, then contenders. Rows that failed hold the reason, and are tried again next
    time.
    """
    protocol = protocol or Protocol()
    wanted = [(scene, label) for scene in scenes for label in labels]
    keys = {pair: row_key(*pair, protocol) for pair in wanted}
    rows: dict[tuple[str, str], Row] = {}
    for pair in wanted:
        kept = None if fresh else results.get(keys[pair])
        if kept is not None:
            rows[pair] = kept
    missing = [pair for pair in wanted if pair not in rows]
    threads = max(1, available_threads() // jobs)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        pending: dict[Future[Row], tuple[str, str]] = {
            pool.submit(compute_row, data, scene, label, protocol, threads, pictures): (scene, label)
            for scene, label in missing
        }
        for future in as_completed(pending):
            pair = pending[future]
            rows[pair] = future.result()
            if not rows[pair].error:
                results.add(keys[pair], rows[pair])
            if progress is not None:
                progress(len(rows), len(wanted), rows[pair])
    return [rows[pair] for pair in wanted]


def markdown_table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with aligned columns; the first is left-aligned, the others right."""
    body = [list(line) for line in lines]
    widths = [max(len(row[i]) for row in [list(header), *body]) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        padded = [c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(cells, widths, strict=True))]
        return f"| {' | '.join(padded)} |"

    rule = ["-" * w if i == 0 else "-" * (w - 1) + ":" for i, w in enumerate(widths)]
    return "\n".join([line(header), line(rule), *(line(row) for row in body)])
