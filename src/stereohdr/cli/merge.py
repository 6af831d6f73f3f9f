"""``stereohdr merge``: a bracket from one place to one HDR image, for instance a reference."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereohdr.cli.outputs import HDR_OUTPUT
from stereohdr.cli.photos import Bayer, BlackLevel, ResponseFile, WhiteLevel
from stereohdr.errors import FileFormatError, InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from stereohdr.model import Photo


def merge_command(
    images: Annotated[
        list[Path], typer.Argument(metavar="IMAGES...", help="Photos of one view, registered: PNG, JPEG or TIFF.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help=HDR_OUTPUT)],
    exposures: Annotated[
        list[str] | None,
        typer.Option(
            metavar="T,T,...",
            help="Exposure times in the order of the photos, separated by commas: 1/4,1,4 (seconds) or "
            "250ms,1000ms; may be given several times. Read from EXIF when not given.",
        ),
    ] = None,
    response: ResponseFile = None,
    save_response: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Also write the response that was used.")
    ] = None,
    white_level: WhiteLevel = None,
    black_level: BlackLevel = 0,
    bayer: Bayer = None,
    preview: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Also write a tone-mapped picture.")
    ] = None,
    clipped: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Also write a mask, white where a pixel is clipped in all photos."),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no summary.")] = False,
) -> None:
    """Merge a bracket (one view, several exposures) into one HDR image."""
    from stereohdr.cli.progress import show_progress
    from stereohdr.io.hdr import check_hdr_path

    start = time.perf_counter()
    check_hdr_path(output)
    for picture in (preview, clipped):
        if picture is not None and picture.suffix.lower() != ".png":
            raise FileFormatError(f"{picture}: is written as PNG picture; give a name that ends in .png")
    _check_outputs([output, save_response, preview, clipped], [*images, response])
    times = _times(exposures, len(images))

    with show_progress(quiet=quiet) as progress:
        progress("reading")
        from stereohdr import __version__
        from stereohdr.cli.photos import read_photos
        from stereohdr.io import write_hdr
        from stereohdr.io.images import write_png
        from stereohdr.io.response_files import read_response
        from stereohdr.merging import merge_bracket
        from stereohdr.report import RADIANCE_SCALE
        from stereohdr.response.bracket import check_bracket, estimate_bracket_response
        from stereohdr.tone_mapping import tonemap

        photos = read_photos(images, times, white_level=white_level, black_level=black_level, bayer=bayer)
        check_bracket(photos)
        brought = photos[0].response if all(photo.linear for photo in photos) else None
        if response is not None:
            brought = None
            curve = read_response(response, channels=photos[0].channels, white_level=photos[0].white)
        elif brought is not None:
            curve = brought
        else:
            progress("response")
            curve = estimate_bracket_response(photos)
        progress("merging")
        radiance, lost = merge_bracket(photos, response=None if brought is not None else curve)
        progress("writing")
        attributes = {
            "software": f"stereohdr {__version__}",
            "method": "merge",
            "exposureTimes": [photo.exposure_time for photo in photos],
            "radianceScale": RADIANCE_SCALE,
        }
        write_hdr(output, radiance, attributes=attributes)
        written = [output]
        if save_response is not None:
            curve.save(save_response)
            written.append(save_response)
        if preview is not None:
            write_png(preview, tonemap(radiance))
            written.append(preview)
        if clipped is not None:
            write_png(clipped, lost.astype("uint8") * 255)
            written.append(clipped)
    if not curve.is_monotone:
        typer.echo(
            "warning: the response curve does not rise everywhere; radiance is not reliable there", err=True
        )
    if not quiet:
        origin = "linear, as the camera raw files state" if brought else "estimated from the bracket"
        origin = origin if response is None else f"from {response}"
        for line in _summary(photos, radiance, lost, origin):
            typer.echo(line)
        typer.echo(f"wrote      {', '.join(map(str, written))} ({time.perf_counter() - start:.2f} s in all)")


def _times(given: list[str] | None, count: int) -> list[float] | list[None]:
    """Return one exposure time in seconds per photo, None each when EXIF is to say it."""
    from stereohdr.errors import ExposureError
    from stereohdr.io.metadata import parse_exposure_time

    if not given:
        return [None] * count
    times = [parse_exposure_time(text) for option in given for text in option.split(",")]
    if len(times) != count:
        raise ExposureError(
            f"--exposures gives {len(times)} times for {count} photos; give one for each, in the same order"
        )
    return times


def _check_outputs(outputs: list[Path | None], inputs: list[Path | None]) -> None:
    """Refuse to overwrite an input, to write one file twice, or to write where nothing can be written."""
    from stereohdr.io.files import check_output

    used = {path.resolve(): path for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in used:
            raise InputError(
                f"{path}: would overwrite {used[path.resolve()]}; give every output a name of its own"
            )
        check_output(path)
        used[path.resolve()] = path


def _summary(
    photos: list[Photo], radiance: NDArray[np.float32], lost: NDArray[np.bool_], origin: str
) -> list[str]:
    """Return the closing lines, for people."""
    import numpy as np

    from stereohdr.radiance import luminance
    from stereohdr.report import exposure_text
    from stereohdr.response.bracket import bracket_exposures

    exposures = bracket_exposures(photos)
    times = sorted(photo.exposure_time or 0.0 for photo in photos)
    low, high = np.percentile(luminance(radiance), (0.1, 99.9))
    colour = "grey" if photos[0].channels == 1 else "RGB"
    return [
        f"bracket    {len(photos)} photos, {exposure_text(times[0])} to {exposure_text(times[-1])}, "
        f"exposure ratio {max(exposures) / min(exposures):.4g}",
        f"size       {photos[0].width}x{photos[0].height} {colour}, white level {photos[0].white}",
        f"response   {origin}",
        f"range      {np.log2(high / low):.1f} stops (0.1 to 99.9 % of the pixels)",
        f"clipped    {100 * lost.mean():.2f} % of the pixels in all photos; they hold the nearest bound",
    ]
