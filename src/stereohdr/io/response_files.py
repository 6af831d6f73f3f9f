"""Response curves of other programs: photometric calibrations (``pcalib.txt``), CSV tables, and known names."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import FileFormatError, ResponseError
from stereohdr.io.files import atomic_path
from stereohdr.io.metadata import first_bytes
from stereohdr.model import MID_KNOT, RESPONSE_KNOTS, ResponseCurve

NAMED = ("linear", "srgb")
"""Responses that need no file."""

LARGEST_TABLE = 10_000_000
"""Bytes of a table that are read; what comes after them makes it no response curve either way."""

RESPONSE_SUFFIXES = (".json", ".csv")
"""Formats in which a curve is written."""


def read_response(source: str | Path, *, channels: int | None = None, white_level: int = 255) -> ResponseCurve:
    """Read an inverse camera response.

    Parameters
    ----------
    source
        ``.json`` as `ResponseCurve.save` writes it; ``.csv`` or any other text with 256 rows, see
        `read_response_table`; or a name: ``linear``, ``srgb``.
    channels
        Channels of the photos, to which a grey curve is extended; None leaves the curve as it is (named ones are
        grey then).
    white_level
        White level of the photos, which keeps ``linear`` exact for deep codes.

    Raises
    ------
    FileFormatError
        The file cannot be read, or holds no response.
    ResponseError
        The curve has another number of channels.
    """
    name = str(source)
    if name in NAMED and not Path(source).exists():
        count = channels or 1
        return (
            ResponseCurve.linear(count, white_level=white_level) if name == "linear" else ResponseCurve.srgb(count)
        )
    first_bytes(source, 1)  # a missing file or a folder gets its own sentence
    curve = ResponseCurve.load(source) if name.lower().endswith(".json") else read_response_table(source)
    try:
        return curve if channels is None else curve.with_channels(channels)
    except ResponseError as error:
        raise ResponseError(f"{source}: {error}") from error


def read_response_table(path: str | Path) -> ResponseCurve:
    """Read a text file of 256 numbers, or of 256 rows of numbers: an inverse response at evenly spaced codes.

    Accepted are 256 numbers in any arrangement (``pcalib.txt``), and tables, separated by commas, semicolons or
    white space, of 1 or 3 columns (grey or red, green, blue), with or without a first column that counts 0 to 255
    and with or without a heading. The numbers are exposures in any unit or their natural logarithms; they are
    taken as logarithms when one of them is negative, or a heading has ``ln`` or ``log`` in it. An exposure of 0 at
    code 0 is replaced by half of that of code 1: the code stands for everything that rounds to it.

    Raises
    ------
    FileFormatError
        Anything else; and curves that do not rise at every code.
    """
    table, heading = _numbers(path)
    if table.shape[1] in (2, 4) and np.array_equal(table[:, 0], np.arange(RESPONSE_KNOTS)):
        table = table[:, 1:]
    if table.shape[1] not in (1, 3):
        raise _unusable(path, f"it has {table.shape[1]} columns")
    if not np.isfinite(table).all():
        raise _unusable(path, "some of its numbers are not finite")
    values = table.T
    if not (np.diff(values, axis=1) > 0).all():
        raise _unusable(path, "the exposures do not rise at every code")
    if values.min() >= 0 and not any(word in heading.lower() for word in ("ln", "log")):
        dark = np.where(values[:, 0] > 0, values[:, 0], 0.5 * values[:, 1])
        values = np.log(np.column_stack([dark, values[:, 1:]]))
    try:
        return ResponseCurve(values - values[:, MID_KNOT : MID_KNOT + 1])
    except ResponseError as error:
        raise _unusable(path, str(error)) from error


def write_response_table(path: str | Path, curve: ResponseCurve) -> None:
    """Write a curve as CSV: code, and ln exposure of each channel, 6 decimals.

    Raises
    ------
    FileFormatError, OutputError
        `path` cannot be written.
    """
    names = ["ln_grey"] if curve.channels == 1 else ["ln_red", "ln_green", "ln_blue"]
    rows = [[code, *(f"{value:.6f}" for value in values)] for code, values in enumerate(curve.log_exposure.T)]
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([["code", *names], *rows])


def _numbers(path: str | Path) -> tuple[NDArray[np.float64], str]:
    """Return the numbers of a file as ``(256, N)``, and its heading."""
    try:
        lines = first_bytes(path, LARGEST_TABLE).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise _unusable(path, "it is not a text file") from error
    rows = [line.replace(",", " ").replace(";", " ").split() for line in lines if line.strip()]
    heading = ""
    if rows and not _is_number(rows[0][0]):
        heading, rows = " ".join(rows[0]), rows[1:]
    try:
        values = [[float(word) for word in row] for row in rows]
    except ValueError as error:
        raise _unusable(path, "it holds something else than numbers") from error
    if len(values) == RESPONSE_KNOTS and len({len(row) for row in values}) == 1:
        return np.array(values), heading
    flat = [value for row in values for value in row]
    if len(flat) != RESPONSE_KNOTS:
        raise _unusable(path, f"it holds {len(flat)} numbers in {len(values)} rows")
    return np.array(flat)[:, None], heading


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _unusable(path: str | Path, what: str) -> FileFormatError:
    return FileFormatError(
        f"{path}: not a response curve: {what}; give 256 rising exposures (pcalib.txt), or a CSV table of 256 "
        f"rows with 1 or 3 columns"
    )
