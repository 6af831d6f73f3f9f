"""Reading the photos that a command is given, with the options that say what the files do not."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereohdr.errors import ExposureError

if TYPE_CHECKING:
    from stereohdr.model import Photo

WhiteLevel = Annotated[
    int | None,
    typer.Option(
        "--white-level",
        "--white",
        metavar="CODE",
        help="Code at which the sensor clips, such as 4095 for 12 bits in 16.",
    ),
]

BlackLevel = Annotated[
    int, typer.Option(metavar="CODE", help="Code without light (pedestal of the sensor); it is subtracted.")
]

Bayer = Annotated[
    str | None,
    typer.Option(metavar="PATTERN", help="The photos are Bayer mosaics: RGGB, BGGR, GRBG or GBRG."),
]

ResponseFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Known camera response instead of an estimate: .json, a table of 256 rows (.csv, pcalib.txt), linear "
        "or srgb.",
    ),
]


def read_photos(
    paths: Sequence[Path],
    times: Sequence[float | None] | None = None,
    *,
    white_level: int | None = None,
    black_level: int = 0,
    bayer: str | None = None,
) -> list[Photo]:
    """Read photos; `times` in seconds win over EXIF, None leaves it to the file."""
    from stereohdr.io import read_photo

    return [
        read_photo(path, exposure_time=time, white_level=white_level, black_level=black_level, bayer=bayer)
        for path, time in zip(paths, times or [None] * len(paths), strict=True)
    ]


def exposure_times(given: Sequence[str] | None, count: int) -> list[float] | None:
    """Return one time in seconds per photo from options like ``1/4,1``; None when there are none.

    Fewer times than photos are repeated if they go into them evenly: two times serve any number of pairs.

    Raises
    ------
    ExposureError
        A text is no time, or the numbers do not fit.
    """
    from stereohdr.io.metadata import parse_exposure_time

    if not given:
        return None
    times = [parse_exposure_time(text) for option in given for text in option.split(",")]
    if count % len(times):
        raise ExposureError(
            f"--exposures gives {len(times)} times for {count} photos; give one for each, in the same order, or "
            f"as many as one pair has"
        )
    return times * (count // len(times))
