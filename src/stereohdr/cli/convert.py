"""``stereohdr convert``: an HDR image to another HDR format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stereohdr.cli.outputs import HDR_INPUT, HDR_OUTPUT
from stereohdr.cli.tonemap import OperatorName
from stereohdr.errors import InputError


def convert_command(
    source: Annotated[Path, typer.Argument(metavar="IN", help=HDR_INPUT)],
    target: Annotated[Path, typer.Argument(metavar="OUT", help=HDR_OUTPUT)],
    half: Annotated[bool, typer.Option("--half", help="OpenEXR and JPEG XL: half floats.")] = False,
    white: Annotated[
        float | None,
        typer.Option(
            metavar="RADIANCE",
            help="Ultra HDR, AVIF and JPEG XL: what is shown as diffuse white (203 cd/m²); by default the "
            "log-average of the scene over 0.18.",
        ),
    ] = None,
    headroom: Annotated[
        float | None,
        typer.Option(metavar="STOPS", help="Ultra HDR: what is kept above diffuse white, 4 by default."),
    ] = None,
    operator: Annotated[
        OperatorName | None,
        typer.Option(help="Ultra HDR: tone mapping of the picture for ordinary displays, reinhard by default."),
    ] = None,
    quality: Annotated[
        int | None,
        typer.Option(
            metavar="1..100",
            help="Ultra HDR and AVIF, 95 by default, and JPEG XL, 100; AVIF and JPEG XL are lossless at 100.",
        ),
    ] = None,
    bits: Annotated[
        int | None, typer.Option(metavar="10|12", help="AVIF: bits per channel, 10 by default.")
    ] = None,
) -> None:
    """Write an HDR image in another format, with what the file says about it; layers stay behind."""
    from stereohdr.io.hdr import check_hdr_path, read_hdr_with_attributes, write_hdr

    given = {"half": half or None, "white": white, "headroom": headroom, "quality": quality, "bits": bits}
    given["operator"] = operator.value if operator else None
    options = {name: value for name, value in given.items() if value is not None}
    check_hdr_path(target, *options)
    if source.resolve() == target.resolve():
        raise InputError(f"{target}: would overwrite the image that is read; give another name")
    image, attributes = read_hdr_with_attributes(source)
    write_hdr(target, image, attributes=attributes, **options)
    typer.echo(f"wrote {target}")
