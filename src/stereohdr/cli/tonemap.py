"""``stereohdr tonemap``: an HDR image to a picture for the screen."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class OperatorName(StrEnum):
    """Tone mapping operators."""

    REINHARD = "reinhard"
    LOG = "log"
    LINEAR = "linear"


def tonemap_command(
    source: Annotated[Path, typer.Argument(metavar="IN", help="HDR image: .exr, .hdr, .pfm or .npy.")],
    target: Annotated[Path, typer.Argument(metavar="OUT.png", help="Picture to write.")],
    operator: Annotated[
        OperatorName, typer.Option(help="Reinhard's global operator, Drago's logarithm, or a linear scale.")
    ] = OperatorName.REINHARD,
    key: Annotated[float, typer.Option(help="Reinhard: brightness of the middle of the scene, 0 to 1.")] = 0.18,
    bias: Annotated[
        float, typer.Option(help="Log: smaller lifts the shadows and compresses highlights more, 0 to 1.")
    ] = 0.85,
    exposure: Annotated[float | None, typer.Option(help="Linear: factor on the radiance.")] = None,
    saturation: Annotated[float, typer.Option(help="1 keeps the colours, 0 gives grey.")] = 1.0,
) -> None:
    """Tone map an HDR image to an 8-bit sRGB picture."""
    from stereohdr.io import read_hdr
    from stereohdr.io.images import write_png
    from stereohdr.tone_mapping import tonemap

    picture = tonemap(
        read_hdr(source), operator.value, key=key, bias=bias, exposure=exposure, saturation=saturation
    )
    write_png(target, picture)
    typer.echo(f"wrote {target}")
