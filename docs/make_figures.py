"""Make the figures of README and docs: ``python docs/make_figures.py`` (needs the extra ``demo``)."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from stereohdr import PaperConfig, fuse
from stereohdr.cli import demo
from stereohdr.pictures import (
    codes_picture,
    contact_sheet,
    heat,
    segment_colours,
    source_colours,
    stage_pictures,
    tonemap_together,
)
from stereohdr.simulation import Camera, expose_pair

IMAGES = Path(__file__).parent / "images"


def save(name: str, picture: np.ndarray, width: int) -> None:
    """Save a figure as JPEG of at most `width` pixels."""
    image = Image.fromarray(picture)
    image.thumbnail((width, 10_000), Image.Resampling.LANCZOS)
    image.save(IMAGES / name, quality=82, optimize=True)


def demo_figure() -> None:
    """Save the contact sheet of ``stereohdr demo``."""
    with tempfile.TemporaryDirectory() as folder:
        demo.demo_command(Path(folder), scene="motorcycle")
        save("demo.jpg", np.asarray(Image.open(Path(folder) / "demo_contact_sheet.png")), 1600)


def method_figure() -> None:
    """Save the boxes of the paper's Figure 1, each with what it makes of the Motorcycle pair."""
    truth = demo._motorcycle()
    pair = expose_pair(truth.left, truth.right, truth.exposures, Camera(), demo.SEED)
    result = fuse(pair, "paper", PaperConfig(max_disparity=truth.max_disparity), keep_stages=True)
    stages = stage_pictures(result.stages)
    main_only, fused = tonemap_together([result.stages["main_radiance"], result.radiance])
    tiles = [
        ("1  main view I_m, long exposure", codes_picture(pair.left)),
        ("2  auxiliary view I_a, short exposure", codes_picture(pair.right)),
        ("3  response curve -> radiance R_m", main_only),
        ("4  S: under- and over-exposed (1)", stages["exposure_map"]),
        ("5  super-pixels merged to segments G_m", segment_colours(result.stages["main_segments"])),
        ("6  interest region: segments with S", stages["main_interest"]),
        ("7  disparity D_a (2)-(9)", heat(result.stages["auxiliary_disparity"], high=truth.max_disparity)),
        ("8  auxiliary radiance warped (10)", stages["warped"]),
        ("9  holes and rejected pixels", stages["holes"]),
        ("10 filled, filtered, Poisson edited (11)", stages["restored"]),
        ("11 weight map W", stages["weight"]),
        ("12 fused radiance R (12)", fused),
    ]
    save("method.jpg", contact_sheet(tiles), 1600)


def robust_figure() -> None:
    """Save what each stage of method ``robust`` makes of the Motorcycle pair."""
    truth = demo._motorcycle()
    pair = expose_pair(truth.left, truth.right, truth.exposures, Camera(), demo.SEED)
    result = fuse(pair, "robust", keep_stages=True)
    stages = stage_pictures(result.stages)
    main_only, warped, borrowed, fused = tonemap_together(
        [result.stages["main_radiance"], result.stages["warped"], result.stages["borrowed"], result.radiance]
    )
    tiles = [
        ("1  main view, long exposure", codes_picture(pair.left)),
        ("2  auxiliary view, short exposure", codes_picture(pair.right)),
        ("3  disparity of the main view", heat(result.stages["main_disparity"], high=truth.max_disparity)),
        (
            "4  disparity of the auxiliary view",
            heat(result.stages["auxiliary_disparity"], high=truth.max_disparity),
        ),
        ("5  confidence", stages["confidence"]),
        ("6  response -> radiance of the main view", main_only),
        ("7  auxiliary radiance warped", warped),
        ("8  matches that agree", stages["valid"]),
        ("9  the rest borrowed from the background", borrowed),
        ("10 S: out of range", stages["exposure_map"]),
        ("11 where the radiance comes from", source_colours(result.source)),
        ("12 result", fused),
    ]
    save("robust.jpg", contact_sheet(tiles), 1600)


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    demo_figure()
    method_figure()
    robust_figure()
