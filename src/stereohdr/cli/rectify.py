"""``stereohdr rectify``: two photos to two photos whose rows agree."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereohdr.cli.photos import Bayer, BlackLevel, ResponseFile, WhiteLevel
from stereohdr.errors import FileFormatError, StereoHdrWarning

if TYPE_CHECKING:
    from stereohdr.rectification import RectifiedPair


def rectify_command(
    left: Annotated[Path, typer.Argument(metavar="LEFT", help="Photo of the left camera.")],
    right: Annotated[Path, typer.Argument(metavar="RIGHT", help="Photo of the right camera, at any exposure.")],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for left.png and right.png: 16 bits, exposures in EXIF."
        ),
    ],
    calib: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Calibration of `stereohdr calibrate`, OpenCV, Kalibr; twice for ROS (left, right) and OpenCV's "
            "intrinsics and extrinsics. Without it, everything is found from the pictures.",
        ),
    ] = None,
    auto: Annotated[
        bool,
        typer.Option("--auto", help="With --calib: take only the lenses from it, the pose from the pictures."),
    ] = False,
    exposures: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="T_LEFT T_RIGHT", help="Exposure times to write; from EXIF when not given."),
    ] = None,
    white_level: WhiteLevel = None,
    black_level: BlackLevel = 0,
    bayer: Bayer = None,
    response: ResponseFile = None,
    full: Annotated[
        bool,
        typer.Option("--full", help="Keep what only one view covers; also write left_mask.png, right_mask.png."),
    ] = False,
    save_calib: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="Also write the geometry, to rectify other pairs the same way."),
    ] = None,
    preview: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Also draw both views with lines along their rows.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Also write how well the rows agree.")
    ] = None,
) -> None:
    """Bring two photos onto common rows: by a calibration, or by what the pictures have in common."""
    from stereohdr.cli.fuse import check_outputs
    from stereohdr.cli.photos import read_photos
    from stereohdr.io.deep_png import write_photo
    from stereohdr.io.files import new_folder
    from stereohdr.io.images import write_png
    from stereohdr.io.metadata import parse_exposure_time
    from stereohdr.io.response_files import read_response
    from stereohdr.rectification import read_calibration, rectify_pair, write_calibration
    from stereohdr.rectification.pictures import rows_picture
    from stereohdr.report import write_json

    if preview is not None and preview.suffix.lower() != ".png":
        raise FileFormatError(f"{preview}: the preview is a PNG picture; give a name that ends in .png")
    if save_calib is not None and save_calib.suffix.lower() != ".toml":
        raise FileFormatError(f"{save_calib}: the geometry is written as TOML; give a name that ends in .toml")
    with new_folder(output):
        views = {side: (output / f"{side}.png", output / f"{side}_mask.png") for side in ("left", "right")}
        outputs = [path for paths in views.values() for path in paths[: 1 + full]]
        outputs += [path for path in (save_calib, preview, json_file) if path is not None]
        check_outputs([*outputs], [left, right, response, *(calib or [])])

        times = None if exposures is None else [parse_exposure_time(text) for text in exposures]
        photos = read_photos([left, right], times, white_level=white_level, black_level=black_level, bayer=bayer)
        curve = None
        if response is not None:
            curve = read_response(response, channels=photos[0].channels, white_level=photos[0].white)
        pair = rectify_pair(
            *photos,
            calibration=read_calibration(*calib) if calib else None,
            pose_from_pictures=auto,
            response=curve,
            crop=not full,
        )
        for side, photo, valid in (("left", pair.left, pair.valid_left), ("right", pair.right, pair.valid_right)):
            write_photo(views[side][0], photo)
            if full:
                write_png(views[side][1], valid.astype("uint8") * 255)
        if save_calib is not None:
            write_calibration(save_calib, pair.rectification.calibration)
        if preview is not None:
            write_png(preview, rows_picture(pair))
        if json_file is not None:
            write_json(json_file, {"rectification": dict(pair.rectification.report or {})})
    if pair.left.linear and pair.left.channels == 3:
        warnings.warn(
            "the rectified photos hold linear codes in the colours of the sensor, and a PNG cannot say so; fuse "
            "them with --response linear, or the raw files themselves with --rectify or --calib, which also "
            "balances their colours",
            StereoHdrWarning,
            stacklevel=2,
        )
    for line in _summary(pair):
        typer.echo(line)
    typer.echo(f"wrote      {', '.join(map(str, outputs))}")


def _summary(pair: RectifiedPair) -> list[str]:
    """Return the closing lines, for people."""
    from stereohdr.report import rectification_text

    report = pair.rectification.report or {}
    width, height = pair.rectification.size
    lines = [f"rectified  {rectification_text(report)}"]
    if report["model"] is not None:
        lines.append(f"model      {report['model']}, fitted to {report['inliers']} matches")
    lines.append(f"cameras    look {report['vergence_degrees']:.1f} degrees apart")
    lines.append(f"size       {width}x{height}")
    if report["disparity_offset"]:
        lines.append(f"shifted    by {report['disparity_offset']} px, which were taken off the disparity")
    return lines
