"""``stereohdr tonemap``: an HDR image to a picture for the screen."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from stereohdr.cli.outputs import HDR_INPUT


class OperatorName(StrEnum):
    """Tone mapping operators."""

    REINHARD = "reinhard"
    REINHARD_LOCAL = "reinhard-local"
    DRAGO = "drago"
    MAI = "mai"
    FILMIC = "filmic"
    LOG = "log"
    LINEAR = "linear"


def tonemap_command(
    source: Annotated[Path, typer.Argument(metavar="IN", help=HDR_INPUT)],
    target: Annotated[Path, typer.Argument(metavar="OUT.png", help="Picture to write.")],
    operator: Annotated[
        OperatorName,
        typer.Option(
            help="Reinhard 2002, global or local; Drago 2003; Mai 2011; an ACES-like curve; a logarithm; a factor."
        ),
    ] = OperatorName.REINHARD,
    exposure: Annotated[float, typer.Option(metavar="EV", help="Stops by which to brighten the picture.")] = 0.0,
    key: Annotated[
        float, typer.Option(help="Reinhard and filmic: brightness of the middle of the scene, 0 to 1.")
    ] = 0.18,
    white: Annotated[
        float | None,
        typer.Option(help="Luminance that becomes white; the largest one, with linear the 99th percentile."),
    ] = None,
    bias: Annotated[
        float, typer.Option(help="Drago: smaller lifts the shadows and compresses highlights more, 0 to 1.")
    ] = 0.85,
    saturation: Annotated[float, typer.Option(help="1 keeps the colours, 0 gives grey.")] = 1.0,
) -> None:
    """Tone map an HDR image to an 8-bit sRGB picture."""
    from stereohdr.errors import FileFormatError
    from stereohdr.io import read_hdr
    from stereohdr.io.images import write_png
    from stereohdr.tone_mapping import tonemap

    if target.suffix.lower() != ".png":
        raise FileFormatError(
            f"{target}: the picture is a PNG; give a name that ends in .png, or use stereohdr convert"
        )
    picture = tonemap(
        read_hdr(source),
        operator.value,
        exposure=exposure,
        key=key,
        white=white,
        bias=bias,
        saturation=saturation,
    )
    write_png(target, picture)
    typer.echo(f"wrote {target}")
