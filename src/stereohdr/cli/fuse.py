"""``stereohdr fuse``: one pair to one HDR image."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereohdr.cli.outputs import HDR_OUTPUT
from stereohdr.cli.photos import Bayer, BlackLevel, ResponseFile, WhiteLevel
from stereohdr.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from stereohdr.rectification import RectifiedPair


class Rectify(StrEnum):
    """Whether the pictures tell how the cameras stand."""

    NONE = "none"
    AUTO = "auto"


class Side(StrEnum):
    """Which camera is the main view."""

    LEFT = "left"
    RIGHT = "right"


def fuse_command(
    left: Annotated[
        Path, typer.Argument(metavar="LEFT", help="Photo of the left camera: PNG, JPEG, TIFF, HEIC or camera raw.")
    ],
    right: Annotated[
        Path,
        typer.Argument(
            metavar="RIGHT", help="Photo of the right camera; rectified, or see --rectify and --calib."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help=HDR_OUTPUT)],
    exposures: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="T_LEFT T_RIGHT",
            help="Exposure times in seconds or as fractions (1/60); from EXIF when not given. ISO and f-number "
            "from EXIF count, too, when both photos have them.",
        ),
    ] = None,
    estimate_ratio: Annotated[
        bool,
        typer.Option("--estimate-ratio", help="Nobody knows the exposures: estimate their ratio from the photos."),
    ] = False,
    main: Annotated[Side, typer.Option(help="The view in which the result is made.")] = Side.LEFT,
    rectify: Annotated[
        Rectify,
        typer.Option(help="auto: bring the views onto common rows first, by what the pictures have in common."),
    ] = Rectify.NONE,
    calib: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Rectify by this calibration: of `stereohdr calibrate`, OpenCV or Kalibr; twice for ROS (left, "
            "right) and OpenCV's intrinsics and extrinsics. With --rectify auto only its lenses are used.",
        ),
    ] = None,
    unrectify: Annotated[
        bool, typer.Option("--unrectify", help="Bring the result back to the pixels of the main photo.")
    ] = False,
    method: Annotated[
        str,
        typer.Option(
            help="How to fuse: robust (our own), paper (Park et al. 2017); to compare mv-only, opencv, lin2009, "
            "baetz2014, sun2010."
        ),
    ] = "robust",
    max_disparity: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Largest disparity in pixels; found from the pair by default.",
        ),
    ] = None,
    white_level: WhiteLevel = None,
    black_level: BlackLevel = 0,
    bayer: Bayer = None,
    config: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="Settings of the method.")] = None,
    response: ResponseFile = None,
    both: Annotated[
        bool,
        typer.Option(
            "--both", help="Also make the result in the other view: NAME_left or NAME_right beside the output."
        ),
    ] = False,
    half: Annotated[bool, typer.Option("--half", help="OpenEXR and JPEG XL: half floats, half as large.")] = False,
    layers: Annotated[
        bool,
        typer.Option("--layers", help="OpenEXR: also channels disparity.Z, source.I and, if known, confidence.Y."),
    ] = False,
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
    memory: Annotated[
        str | None,
        typer.Option(
            metavar="LIMIT",
            help="Most memory to use, such as 4GiB or 800MB; half of the machine's by default. Large photos are "
            "matched in strips to keep to it; the result does not depend on it.",
        ),
    ] = None,
    checks: Annotated[
        bool, typer.Option(help="Refuse swapped exposures and exchanged views; --no-checks trusts you.")
    ] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no summary.")] = False,
) -> None:
    """Fuse a rectified stereo pair taken at two exposures into one HDR image."""
    from stereohdr.cli.progress import print_line, show_progress
    from stereohdr.io.files import make_folder
    from stereohdr.io.hdr import check_hdr_path
    from stereohdr.memory import memory_limit

    start = time.perf_counter()
    if estimate_ratio and exposures is not None:
        raise InputError("--estimate-ratio takes the place of --exposures; give one of the two")
    check_hdr_path(output, *(name for name, given in (("half", half), ("layers", layers)) if given))
    if preview is not None and preview.suffix.lower() != ".png":
        raise FileFormatError(f"{preview}: the preview is a PNG picture; give a name that ends in .png")
    other = "right" if main is Side.LEFT else "left"
    other_output = output.with_stem(f"{output.stem}_{other}") if both else None
    if unrectify and rectify is Rectify.NONE and not calib:
        raise InputError("--unrectify undoes a rectification; give --rectify auto or --calib, too")
    inputs = [left, right, config, response, *(calib or [])]
    check_outputs([output, other_output, preview, json_file], inputs, folder=save_stages)
    limit = memory_limit(memory)

    with show_progress(quiet=quiet) as progress:
        progress("reading")
        from stereohdr.cli.photos import read_photos
        from stereohdr.io.metadata import parse_exposure_time
        from stereohdr.io.response_files import read_response
        from stereohdr.model import StereoPair
        from stereohdr.pipeline import fuse, fuse_other_view
        from stereohdr.warmup import cold_start

        times = None if exposures is None else [parse_exposure_time(text) for text in exposures]
        photos = read_photos([left, right], times, white_level=white_level, black_level=black_level, bayer=bayer)
        curve = None
        if response is not None:
            curve = read_response(response, channels=photos[0].channels, white_level=photos[0].white)
        if estimate_ratio:
            from stereohdr.response.exposure_ratio import with_estimated_exposures

            photos = with_estimated_exposures(*photos, response=curve)
        rectified, originals = None, photos
        if calib or rectify is Rectify.AUTO:
            progress("rectification")
            from stereohdr.rectification import read_calibration, rectify_pair

            rectified = rectify_pair(
                *photos,
                main=main.value,
                calibration=read_calibration(*calib) if calib else None,
                pose_from_pictures=rectify is Rectify.AUTO,
                response=curve,
            )
            photos = [rectified.left, rectified.right]
            originals = originals if unrectify else None  # else not needed any more
        pair = StereoPair(*photos, main=main.value)
        settings = _settings(method, config, max_disparity, rectified)
        if save_stages is not None:
            make_folder(save_stages)
        with cold_start(pair, method, progress, say=None if quiet else print_line) as at_stage:
            result = fuse(
                pair,
                method,
                settings,
                response=curve,
                keep_stages=save_stages is not None,
                checks=checks,
                threads=threads,
                memory=limit,
                progress=at_stage,
            )
            other_result = (
                fuse_other_view(pair, result, settings, threads=threads, memory=limit, progress=at_stage)
                if both
                else None
            )
        if rectified is not None:
            result = rectified.finished(result, originals, response=curve)
            other_result = other_result and rectified.finished(other_result, originals, response=curve)
        progress("writing")
        from stereohdr import report
        from stereohdr.io import write_hdr
        from stereohdr.io.images import write_png
        from stereohdr.pictures import save_stages as write_stages
        from stereohdr.tone_mapping import tonemap

        written = []
        for path, made in ((output, result), (other_output, other_result)):
            if path is not None and made is not None:
                write_hdr(
                    path,
                    made.radiance,
                    attributes=report.attributes(made),
                    layers=report.layers(made) if layers else None,
                    half=half,
                )
                written.append(path)
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


def _settings(method: str, config: Path | None, max_disparity: int | None, rectified: RectifiedPair | None):
    """Return the configuration; the search range as given, or as the rectification found it."""
    from dataclasses import replace

    from stereohdr.config import load_config
    from stereohdr.methods import get_method

    config_type = get_method(method).config_type
    settings = load_config(config_type, config) if config else config_type()
    if max_disparity is None and settings.max_disparity is None and rectified is not None:
        max_disparity = rectified.largest_disparity
    return settings if max_disparity is None else replace(settings, max_disparity=max_disparity)
