"""``stereohdr fuse``: one pair to one HDR image."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from stereohdr.errors import FileFormatError, InputError


class Side(StrEnum):
    """Which camera is the main view."""

    LEFT = "left"
    RIGHT = "right"


def fuse_command(
    left: Annotated[
        Path, typer.Argument(metavar="LEFT", help="Photo of the left camera: PNG, JPEG or TIFF, 8 or 16 bit.")
    ],
    right: Annotated[
        Path, typer.Argument(metavar="RIGHT", help="Photo of the right camera, rectified to the left one.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="HDR image to write: .exr, .hdr, .pfm or .npy.")],
    exposures: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="T_LEFT T_RIGHT",
            help="Exposure times in seconds or as fractions (1/60); from EXIF when not given. ISO and f-number "
            "from EXIF count, too, when both photos have them.",
        ),
    ] = None,
    main: Annotated[Side, typer.Option(help="The view in which the result is made.")] = Side.LEFT,
    method: Annotated[
        str, typer.Option(help="How to fuse: paper; to compare mv-only, opencv, lin2009, baetz2014, sun2010.")
    ] = "paper",
    max_disparity: Annotated[
        int | None,
        typer.Option(metavar="N", help="Largest disparity in pixels; about 17 % of the width by default."),
    ] = None,
    white_level: Annotated[
        int | None,
        typer.Option(metavar="CODE", help="Code at which the sensor clips, such as 4095 for 12 bits in 16."),
    ] = None,
    config: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="Settings of the method.")] = None,
    response: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Known camera response instead of an estimate.")
    ] = None,
    preview: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Also write a tone-mapped picture.")
    ] = None,
    save_stages: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also write every intermediate as picture and array.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Also write settings, numbers and timings.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Threads; the result does not depend on it.")
    ] = None,
    checks: Annotated[
        bool, typer.Option(help="Refuse swapped exposures and exchanged views; --no-checks trusts you.")
    ] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no summary.")] = False,
) -> None:
    """Fuse a rectified stereo pair taken at two exposures into one HDR image."""
    from stereohdr.cli.progress import show_progress
    from stereohdr.io.files import make_folder
    from stereohdr.io.hdr import check_hdr_path

    start = time.perf_counter()
    check_hdr_path(output)
    if preview is not None and preview.suffix.lower() != ".png":
        raise FileFormatError(f"{preview}: the preview is a PNG picture; give a name that ends in .png")
    check_outputs([output, preview, json_file], [left, right, config, response], folder=save_stages)

    with show_progress(quiet=quiet) as progress:
        progress("reading")
        pair = _read_pair(left, right, exposures, main, white_level)
        from stereohdr.model import ResponseCurve
        from stereohdr.pipeline import fuse

        settings = _settings(method, config, max_disparity)
        curve = ResponseCurve.load(response) if response else None
        if save_stages is not None:
            make_folder(save_stages)
        result = fuse(
            pair,
            method,
            settings,
            response=curve,
            keep_stages=save_stages is not None,
            checks=checks,
            threads=threads,
            progress=progress,
        )
        progress("writing")
        from stereohdr import report
        from stereohdr.io import write_hdr
        from stereohdr.io.images import write_png
        from stereohdr.pictures import save_stages as write_stages
        from stereohdr.tone_mapping import tonemap

        write_hdr(output, result.radiance, attributes=report.attributes(result))
        written = [output]
        if preview is not None:
            write_png(preview, tonemap(result.radiance))
            written.append(preview)
        if json_file is not None:
            report.write_json(json_file, report.document(result, pair))
            written.append(json_file)
        if save_stages is not None:
            written.append(save_stages)
            write_stages(result, save_stages)
    if not quiet:
        for line in report.summary(result, pair):
            typer.echo(line)
        typer.echo(f"wrote      {', '.join(map(str, written))} ({time.perf_counter() - start:.2f} s in all)")


def check_outputs(outputs: list[Path | None], inputs: list[Path | None], *, folder: Path | None = None) -> None:
    """Refuse, before anything is computed, outputs that cannot be written or would replace another file.

    Parameters
    ----------
    outputs, inputs
        Files that will be written, and files that are read; None for options that are not used.
    folder
        Folder that gets many files: neither an input nor another output may be in it.

    Raises
    ------
    InputError
        An output is an input, or two outputs are the same.
    FileFormatError
        An output cannot be written.
    """
    from stereohdr.io.files import check_output

    used = {path.resolve(): path for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        check_output(path)
        if path.resolve() in used:
            raise InputError(
                f"{path}: would overwrite {used[path.resolve()]}; give every output a name of its own"
            )
        used[path.resolve()] = path
    if folder is not None:
        for resolved, path in used.items():
            if resolved.parent == folder.resolve():
                raise InputError(
                    f"{path}: is inside {folder}, whose files will be replaced; choose another folder"
                )


def _read_pair(left: Path, right: Path, exposures: tuple[str, str] | None, main: Side, white_level: int | None):
    from stereohdr.io import read_photo
    from stereohdr.io.metadata import parse_exposure_time
    from stereohdr.model import StereoPair

    times = (None, None) if exposures is None else tuple(parse_exposure_time(text) for text in exposures)
    photos = [
        read_photo(path, exposure_time=time, white_level=white_level)
        for path, time in zip((left, right), times, strict=True)
    ]
    return StereoPair(*photos, main=main.value)


def _settings(method: str, config: Path | None, max_disparity: int | None):
    from dataclasses import replace

    from stereohdr.config import load_config
    from stereohdr.methods import get_method

    config_type = get_method(method).config_type
    settings = load_config(config_type, config) if config else config_type()
    return settings if max_disparity is None else replace(settings, max_disparity=max_disparity)
