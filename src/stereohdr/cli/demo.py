"""``stereohdr demo``: a known scene, photographed, fused, and compared with the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SEED = 2017


@dataclass(frozen=True, eq=False)
class DemoScene:
    """True radiance of both views, ``(H, W, 3)`` float32, 1 saturates at one second; and how to expose it."""

    name: str
    left: NDArray[np.float32]
    right: NDArray[np.float32]
    max_disparity: int
    exposures: tuple[float, float]
    """Exposure times (main, auxiliary) in seconds, ratio 16."""


def demo_command(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")] = Path(
        "stereohdr-demo"
    ),
    scene: Annotated[
        str | None,
        typer.Option(help="motorcycle (needs scikit-image) or room; by default the first that is there."),
    ] = None,
) -> None:
    """Fuse a simulated pair whose truth is known, and show every step on a contact sheet."""
    from stereohdr.cli.progress import print_line, show_progress
    from stereohdr.io.files import make_folder

    with show_progress() as progress:
        progress("scene")
        truth = _scene(scene)
        make_folder(output)
        from stereohdr import report
        from stereohdr.io import write_hdr
        from stereohdr.io.images import write_png
        from stereohdr.metrics import aligning_scale, log2_error, log2_rmse
        from stereohdr.pictures import codes_picture, contact_sheet
        from stereohdr.pipeline import DEFAULT_METHOD, fuse
        from stereohdr.simulation import Camera, expose_pair
        from stereohdr.tone_mapping import tonemap
        from stereohdr.warmup import cold_start

        pair = expose_pair(truth.left, truth.right, truth.exposures, Camera(), SEED)
        with cold_start(pair, DEFAULT_METHOD, progress, say=print_line) as at_stage:
            result = fuse(pair, keep_stages=True, progress=at_stage)

        progress("comparison")
        s = result.stages["exposure_map"]
        errors, scores = {}, {}
        for name, image in (("main view only", result.stages["main_radiance"]), ("result", result.radiance)):
            error = log2_error(image, truth.left, scale=aligning_scale(image, truth.left, pair.left))
            errors[name] = error
            scores[name] = {
                "inside_s": log2_rmse(error, s),
                "outside_s": log2_rmse(error, ~s),
                "all": log2_rmse(error),
            }

        progress("pictures")
        write_png(output / "demo_left.png", codes_picture(pair.left))
        write_png(output / "demo_right.png", codes_picture(pair.right))
        write_hdr(output / "demo_result.exr", result.radiance, attributes=report.attributes(result))
        write_png(output / "demo_result.png", tonemap(result.radiance))
        title = f"stereohdr demo: {truth.name}, exposures 16:1, method {result.method}"
        tiles = _tiles(pair, result, truth, errors, scores)
        write_png(output / "demo_contact_sheet.png", contact_sheet(tiles, title=title))
        content = {**report.document(result, pair), "scene": truth.name, "log2_rmse": scores}
        report.write_json(output / "demo.json", content)

    for line in report.summary(result, pair):
        typer.echo(line)
    typer.echo(f"\n{truth.name}: log2 RMSE against the truth, in stops")
    typer.echo(f"{'':16}{'inside S':>10}{'outside S':>11}{'all':>8}")
    for name, score in scores.items():
        typer.echo(f"{name:16}{score['inside_s']:10.3f}{score['outside_s']:11.3f}{score['all']:8.3f}")
    typer.echo(f"\nopen {output / 'demo_contact_sheet.png'} to see every step")


def _scene(name: str | None) -> DemoScene:
    from stereohdr.errors import InputError, MissingDependencyError

    if name not in (None, "motorcycle", "room"):
        raise InputError(f"unknown scene {name!r}; use motorcycle or room")
    if name != "room":
        try:
            return _motorcycle()
        except ImportError as error:
            if name == "motorcycle":
                raise MissingDependencyError(
                    "the Motorcycle pair comes with scikit-image; install stereohdr[demo], or use --scene room"
                ) from error
            typer.echo(
                "note: scikit-image is not installed, so the demo uses a procedural scene instead of its "
                "Motorcycle pair (install stereohdr[demo] for that)",
                err=True,
            )
    return _room()


def _motorcycle() -> DemoScene:
    from skimage.data import stereo_motorcycle

    from stereohdr.simulation import reexpose_codes

    left, right, _ = stereo_motorcycle()
    return DemoScene(
        "Motorcycle",
        reexpose_codes(left, seed=SEED),
        reexpose_codes(right, seed=SEED + 1),
        max_disparity=64,
        exposures=(4.0, 0.25),
    )


def _room() -> DemoScene:
    import numpy as np

    from stereohdr.radiance import luminance
    from stereohdr.simulation import room

    scene = room()
    # The main view is exposed for the window, the auxiliary view for the shadows.
    white = 4 * np.percentile(luminance(scene.radiance_left), 75).astype(np.float32)
    return DemoScene(
        "room",
        scene.radiance_left / white,
        scene.radiance_right / white,
        max_disparity=scene.max_disparity,
        exposures=(1 / 8, 2.0),
    )


def _tiles(pair: Any, result: Any, truth: DemoScene, errors: dict, scores: dict) -> list:
    from stereohdr.metrics import aligning_scale
    from stereohdr.pictures import (
        codes_picture,
        diverging,
        heat,
        source_colours,
        tonemap_together,
    )
    from stereohdr.report import exposure_text

    stages = result.stages
    t_main, t_auxiliary = result.exposures
    # All three on the scale of the main view.
    scale = aligning_scale(stages["main_radiance"], truth.left, pair.left)
    true_view, main_only, fused = tonemap_together([truth.left / scale, stages["main_radiance"], result.radiance])
    return [
        (f"left photo, main view, {exposure_text(t_main)}", codes_picture(pair.left)),
        (f"right photo, auxiliary, {exposure_text(t_auxiliary)}", codes_picture(pair.right)),
        ("S: under- and over-exposed", stages["exposure_map"].astype("uint8") * 255),
        ("disparity of the main view", heat(stages["main_disparity"], high=truth.max_disparity)),
        ("confidence of the disparity", heat(stages["confidence"])),
        ("matches that agree with the main view", stages["valid"].astype("uint8") * 255),
        ("source: grey main, green auxiliary, others filled", source_colours(result.source)),
        ("truth", true_view),
        (f"main view only: {scores['main view only']['inside_s']:.2f} stops off in S", main_only),
        (f"result: {scores['result']['inside_s']:.2f} stops off in S", fused),
        ("main view only: blue 1 stop too dark, red too bright", diverging(errors["main view only"], limit=1.0)),
        ("result: blue 1 stop too dark, red too bright", diverging(errors["result"], limit=1.0)),
    ]
