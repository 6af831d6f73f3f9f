"""``stereohdr info``: what photos hold, and whether two of them make a usable pair."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereohdr.cli.photos import Bayer, BlackLevel, ResponseFile, WhiteLevel

if TYPE_CHECKING:
    from stereohdr.inspection import PairFacts, PhotoFacts


def info_command(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="Photos; two are checked as a pair.")],
    exposures: Annotated[
        list[str] | None,
        typer.Option(
            metavar="T,T,...", help="Exposure times in the order of the files; from EXIF when not given."
        ),
    ] = None,
    white_level: WhiteLevel = None,
    black_level: BlackLevel = 0,
    bayer: Bayer = None,
    response: ResponseFile = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
) -> None:
    """Show what was read from photos: size, bits, exposure, clipping; and whether a pair is usable."""
    import json
    from dataclasses import asdict

    from stereohdr.cli.photos import exposure_times, read_photos
    from stereohdr.inspection import pair_facts, photo_facts
    from stereohdr.io.response_files import read_response

    times = exposure_times(exposures, len(files))
    photos = read_photos(files, times, white_level=white_level, black_level=black_level, bayer=bayer)
    facts = [photo_facts(photo) for photo in photos]
    pair = None
    if len(photos) == 2:
        curve = None
        if response is not None:
            curve = read_response(response, channels=photos[0].channels, white_level=photos[0].white)
        pair = pair_facts(*photos, response=curve)
    if json_output:
        content = {"photos": [asdict(fact) for fact in facts], "pair": None if pair is None else asdict(pair)}
        typer.echo(json.dumps(content, indent=1, allow_nan=False))
        return
    for fact in facts:
        typer.echo("\n".join(_photo_lines(fact)))
    if pair is not None:
        typer.echo("\n".join(_pair_lines(pair)))


def _photo_lines(fact: PhotoFacts) -> list[str]:
    from stereohdr.report import exposure_text

    colour = "grey" if fact.channels == 1 else "RGB"
    clips = f", clips at {fact.clips_at}" if fact.clips_at < fact.white_level else ""
    if fact.exposure_time is None:
        exposure = "unknown"
    else:
        source = "EXIF" if fact.exposure_source == "file" else fact.exposure_source
        exposure = f"{exposure_text(fact.exposure_time)} ({source})"
    exposure += f", f/{fact.f_number:g}" if fact.f_number else ""
    exposure += f", ISO {fact.iso:g}" if fact.iso else ""
    exposure += f", EV {fact.exposure_value:.1f}" if fact.exposure_value is not None else ""
    return [
        fact.name,
        f"  size      {fact.width}x{fact.height} {colour}",
        f"  codes     {fact.bits} bits, white level {fact.white_level}, highest {fact.highest_code}{clips}",
        f"  response  {'linear (camera raw)' if fact.linear else 'unknown'}",
        f"  camera    {fact.camera or 'unknown'}",
        f"  exposure  {exposure}",
        f"  clipped   {100 * fact.black_share:.1f} % black, {100 * fact.white_share:.1f} % white",
        *([f"  note      {fact.note}"] if fact.note else []),
    ]


def _pair_lines(pair: PairFacts) -> list[str]:
    ratio = "unknown" if pair.exposure_ratio is None else f"{pair.exposure_ratio:.3g}"
    if pair.estimated_ratio is not None:
        basis = {
            "srgb": "if the camera is like sRGB",
            "linear": "linear codes",
            "given": "with the given response",
        }
        ratio += f" (the photos alone say {pair.estimated_ratio:.3g}, {basis[pair.estimate_assumes or 'srgb']})"
    return [
        "pair",
        f"  ratio     {ratio}",
        f"  overlap   {100 * pair.overlap:.1f} % of the scene is well exposed in both views",
        f"  lost      {100 * pair.white_in_both:.1f} % white, {100 * pair.black_in_both:.1f} % black in both",
        *(f"  note      {text}" for text in pair.notes),
        *(f"  problem   {text}" for text in pair.problems),
        f"  usable    {'yes' if pair.usable else 'no'}",
    ]
