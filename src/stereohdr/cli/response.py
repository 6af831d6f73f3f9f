"""``stereohdr response``: the response of a rig from many pairs, or of a camera from a bracket."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stereohdr.cli.photos import Bayer, BlackLevel, WhiteLevel
from stereohdr.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stereohdr.model import Photo
    from stereohdr.response.rig import RigResponse


def response_command(
    images: Annotated[
        list[Path],
        typer.Argument(metavar="LEFT RIGHT...", help="Photos of one or more pairs: LEFT1 RIGHT1 LEFT2 RIGHT2 ..."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Response to write: .json or .csv.")
    ],
    exposures: Annotated[
        list[str] | None,
        typer.Option(
            metavar="T,T,...",
            help="Exposure times in the order of the photos, or two that hold for every pair; from EXIF when not "
            "given.",
        ),
    ] = None,
    bracket: Annotated[
        bool, typer.Option("--bracket", help="The photos are one bracket of one view instead of pairs.")
    ] = False,
    white_level: WhiteLevel = None,
    black_level: BlackLevel = 0,
    bayer: Bayer = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Also draw the curves, the samples and the residuals.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Also write the residuals.")
    ] = None,
) -> None:
    """Estimate one camera response from all photos together, to be used by fuse --response."""
    from stereohdr.cli.fuse import check_outputs
    from stereohdr.cli.photos import exposure_times, read_photos
    from stereohdr.io.images import write_png
    from stereohdr.io.response_files import RESPONSE_SUFFIXES, write_response_table
    from stereohdr.report import write_json
    from stereohdr.response.rig import estimate_view_response
    from stereohdr.response_plot import response_picture

    if output.suffix.lower() not in RESPONSE_SUFFIXES:
        raise FileFormatError(f"{output}: a response is written as .json or .csv; give a name that ends so")
    if plot is not None and plot.suffix.lower() != ".png":
        raise FileFormatError(f"{plot}: the plot is a PNG picture; give a name that ends in .png")
    if not bracket and len(images) % 2:
        raise InputError(
            f"{len(images)} photos are no pairs; give LEFT1 RIGHT1 LEFT2 RIGHT2 ..., or --bracket for one view"
        )
    check_outputs([output, plot, json_file], list(images))
    times = exposure_times(exposures, len(images))
    photos = read_photos(images, times, white_level=white_level, black_level=black_level, bayer=bayer)
    if any(photo.linear for photo in photos):
        raise InputError(
            "camera raw files are linear: there is no response to estimate, fuse uses what they bring"
        )
    result = estimate_view_response(photos) if bracket else _from_pairs(photos)
    if output.suffix.lower() == ".csv":
        write_response_table(output, result.curve)
    else:
        result.curve.save(output)
    written = [output]
    if plot is not None:
        write_png(plot, response_picture(result, title=_title(photos, bracket)))
        written.append(plot)
    if json_file is not None:
        write_json(json_file, _document(result, photos, bracket))
        written.append(json_file)
    for line in _summary(result, photos, bracket):
        typer.echo(line)
    typer.echo(f"wrote      {', '.join(map(str, written))}")


def _from_pairs(photos: Sequence[Photo]) -> RigResponse:
    from stereohdr.checks import check_exposure_order
    from stereohdr.model import StereoPair
    from stereohdr.response.rig import estimate_rig_response

    pairs = [StereoPair(left, right) for left, right in zip(photos[::2], photos[1::2], strict=True)]
    for pair in pairs:
        check_exposure_order(pair)
    return estimate_rig_response(pairs)


def _title(photos: Sequence[Photo], bracket: bool) -> str:
    return f"bracket of {len(photos)} photos" if bracket else f"{len(photos) // 2} pair(s)"


def _residual_rows(result: RigResponse) -> list[list[float | None]]:
    """Return the residuals of each pair by channel, None where it has no sample."""
    return [[None if value != value else float(value) for value in row] for row in result.residuals]


def _document(result: RigResponse, photos: Sequence[Photo], bracket: bool) -> dict[str, Any]:
    return {
        "photos": [photo.name for photo in photos],
        "bracket": bracket,
        "samples": [len(rows) for rows in result.samples],
        "residual": result.residual,
        "residuals": dict(zip(result.labels, _residual_rows(result), strict=True)),
        "monotone": result.curve.is_monotone,
    }


def _summary(result: RigResponse, photos: Sequence[Photo], bracket: bool) -> list[str]:
    counts = ", ".join(str(len(rows)) for rows in result.samples)
    lines = [
        f"photos     {_title(photos, bracket)}",
        f"samples    {counts} pairs of codes by channel",
        f"residual   {result.residual:.4f} RMS of ln exposure ({result.residual / 0.693147:.3f} stops)",
        f"monotone   {'yes' if result.curve.is_monotone else 'NO: radiance is not reliable where it falls'}",
    ]
    for row, label in zip(_residual_rows(result), result.labels, strict=True):
        values = ", ".join("-" if value is None else f"{value:.3f}" for value in row)
        lines.append(f"  {values}  {label}")
    return lines
