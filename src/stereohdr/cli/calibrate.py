"""``stereohdr calibrate``: a stereo rig from photos of a board."""

from __future__ import annotations

import re
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereohdr.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from stereohdr.rectification import Board, BoardCalibration

_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}

_LENGTH = re.compile(r"\s*([0-9]*\.?[0-9]+)\s*(mm|cm|m|in)\s*")
_GRID = re.compile(r"\s*([0-9]{1,3})\s*x\s*([0-9]{1,3})\s*", re.IGNORECASE)


class Lens(StrEnum):
    """How the lenses distort."""

    PLUMB_BOB = "plumb-bob"
    RATIONAL = "rational"
    FISHEYE = "fisheye"


def calibrate_command(
    images: Annotated[
        list[Path],
        typer.Argument(
            metavar="LEFT... RIGHT...",
            help="Photos of the board: all of the left camera, then as many of the right one, in the same order. "
            "Patterns (left*.png right*.png) may be quoted; numbers in the names must agree.",
        ),
    ],
    board: Annotated[
        str, typer.Option(metavar="COLSxROWS", help="Inner corners of the board: 9x6 for 10 x 7 squares.")
    ],
    square: Annotated[str, typer.Option(metavar="LENGTH", help="Side of a square: 25mm, 2.5cm, 0.025m, 1in.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.toml", help="Calibration to write.")],
    charuco: Annotated[bool, typer.Option("--charuco", help="The board is a ChArUco board.")] = False,
    marker: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="Side of a ChArUco marker; three quarters of a square by default."),
    ] = None,
    dictionary: Annotated[
        str, typer.Option(metavar="NAME", help="ChArUco dictionary, such as 4X4_50 or 5X5_100.")
    ] = "5X5_100",
    lens: Annotated[
        Lens, typer.Option(help="plumb-bob for most lenses, rational for wide ones, fisheye beyond 120 degrees.")
    ] = Lens.PLUMB_BOB,
    coverage: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Also draw where the corners were seen; red ones do not fit."),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Also write all errors as JSON.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no summary.")] = False,
) -> None:
    """Calibrate two cameras from photos of a chessboard or ChArUco board, for --calib of fuse and rectify."""
    from stereohdr.cli.fuse import check_outputs
    from stereohdr.cli.progress import show_progress

    if output.suffix.lower() != ".toml":
        raise FileFormatError(f"{output}: a calibration is written as TOML; give a name that ends in .toml")
    if coverage is not None and coverage.suffix.lower() != ".png":
        raise FileFormatError(f"{coverage}: the coverage is a PNG picture; give a name that ends in .png")
    pairs = paired(images)
    check_outputs([output, coverage, json_file], [path for pair in pairs for path in pair])
    target = _board(board, square, charuco, marker, dictionary)

    with show_progress(quiet=quiet) as progress:
        from stereohdr.io import read_photo
        from stereohdr.io.images import write_png
        from stereohdr.rectification import calibrate_stereo, find_board, write_calibration
        from stereohdr.rectification.pictures import coverage_picture
        from stereohdr.report import write_json

        views = []
        for number, (left, right) in enumerate(pairs, 1):
            progress(f"pair {number} of {len(pairs)}")
            views.append((find_board(read_photo(left), target), find_board(read_photo(right), target)))
        progress("calibration")
        result = calibrate_stereo(views, target, lens=lens.value)
        write_calibration(output, result.calibration)
        written = [output]
        if coverage is not None:
            write_png(coverage, coverage_picture(result))
            written.append(coverage)
        if json_file is not None:
            write_json(json_file, _document(result))
            written.append(json_file)
    for sentence in result.warnings:
        typer.echo(f"warning: {sentence}", err=True)
    if not quiet:
        for line in _summary(result):
            typer.echo(line)
        typer.echo(f"wrote      {', '.join(map(str, written))}")


def paired(given: Sequence[Path]) -> list[tuple[Path, Path]]:
    """Tell the photos of the left camera from those of the right one: the first half and the second half.

    Parameters
    ----------
    given
        Files, or patterns that the shell did not expand; each pattern stands for its files in sorted order.

    Raises
    ------
    InputError
        A pattern matches nothing, the number of files is odd, or the numbers in the names of a pair differ.
    """
    files: list[Path] = []
    for path in given:
        if any(sign in path.name for sign in "*?[") and not path.exists():
            found = sorted(path.parent.glob(path.name))
            if not found:
                raise InputError(f"{path}: no file matches this pattern; check the folder and the name")
            files += found
        else:
            files.append(path)
    half = len(files) // 2
    lefts, rights = files[:half], files[half:]
    if len(lefts) != len(rights):
        raise InputError(
            f"{len(files)} photos are no pairs; give as many of the right camera as of the left one, those of the "
            f"left camera first"
        )
    for left, right in zip(lefts, rights, strict=True):
        numbers = [re.findall(r"\d+", path.stem) for path in (left, right)]
        if left == right or (all(numbers) and int(numbers[0][-1]) != int(numbers[1][-1])):
            raise InputError(
                f"{left.name} would be paired with {right.name}; give all photos of the left camera, then those "
                f"of the right one in the same order, without gaps"
            )
    return list(zip(lefts, rights, strict=True))


def length(text: str) -> float:
    """Return a length in metres.

    Raises
    ------
    InputError
        Not a positive number with a unit.
    """
    match = _LENGTH.fullmatch(text)
    if match is None or float(match[1]) <= 0:
        raise InputError(f"{text!r} is not a length; give a number with its unit, such as 25mm, 2.5cm or 1in")
    return float(match[1]) * _UNITS[match[2]]


def _board(board: str, square: str, charuco: bool, marker: str | None, dictionary: str) -> Board:
    from stereohdr.rectification import Board

    match = _GRID.fullmatch(board)
    if match is None:
        raise InputError(f"{board!r} is not a board; give its inner corners in both directions, such as 9x6")
    return Board(
        int(match[1]),
        int(match[2]),
        length(square),
        "charuco" if charuco else "chessboard",
        None if marker is None else length(marker),
        dictionary,
    )


def _document(result: BoardCalibration) -> dict:
    return {
        "rms": result.calibration.rms,
        "dy_median": result.dy_median,
        "dy_p95": result.dy_p95,
        "coverage": list(result.coverage),
        "pairs": [
            {
                "left": left.name,
                "right": right.name,
                "error_left": float(errors[0]),
                "error_right": float(errors[1]),
            }
            for (left, right), errors in zip(result.pairs, result.errors, strict=True)
        ],
        "left_out": list(result.left_out),
    }


def _summary(result: BoardCalibration) -> list[str]:
    """Return the closing lines, for people."""
    import numpy as np

    from stereohdr.rectification.geometry import vergence_degrees

    calibration = result.calibration
    baseline = calibration.baseline
    lines = ["reprojection error of each photo, pixels"]
    lines += [
        f"{errors[0]:.2f}  {Path(left.name).name}    {errors[1]:.2f}  {Path(right.name).name}"
        for (left, right), errors in zip(result.pairs, result.errors, strict=True)
    ]
    return [
        *lines,
        f"error      {calibration.rms:.3f} px (root mean square of all), {len(result.pairs)} pairs",
        f"rows       agree to {result.dy_median:.3f} px (median of the corners, 95 % within {result.dy_p95:.3f})",
        f"focal      {calibration.left.focal:.1f} px left, {calibration.right.focal:.1f} px right",
        f"baseline   {1000 * float(np.linalg.norm(baseline if baseline is not None else 0)):.1f} mm, the cameras "
        f"look {vergence_degrees(calibration):.2f} degrees apart",
        f"coverage   {100 * result.coverage[0]:.0f} % of the left picture, {100 * result.coverage[1]:.0f} % of "
        f"the right one",
    ]
