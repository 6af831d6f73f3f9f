"""The command line, one file per command. Heavy modules are imported inside the commands."""

from __future__ import annotations

import gc
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated

import typer

from stereohdr import __version__
from stereohdr.cli import (
    bench,
    calibrate,
    convert,
    demo,
    evaluate,
    fuse,
    info,
    merge,
    rectify,
    response,
    tonemap,
    warmup,
)
from stereohdr.errors import InputError, StereoHdrError, StereoHdrWarning
from stereohdr.quiet import silence_libraries

EXIT_BAD_INPUT = 2
EXIT_FAILURE = 1

COLLECT_AFTER = 50_000
"""New objects after which Python looks for garbage; its default of 700 costs a tenth of the time to start."""

app = typer.Typer(
    name="stereohdr",
    help="High dynamic range images from a stereo pair whose two cameras were set to different exposures.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # the boxes take longer to load than all the rest of --help
    context_settings={"max_content_width": 110},
)
app.command("fuse")(fuse.fuse_command)
app.command("info")(info.info_command)
app.command("calibrate")(calibrate.calibrate_command)
app.command("rectify")(rectify.rectify_command)
app.command("response")(response.response_command)
app.command("demo")(demo.demo_command)
app.command("tonemap")(tonemap.tonemap_command)
app.command("convert")(convert.convert_command)
app.command("evaluate")(evaluate.evaluate_command)
app.command("merge")(merge.merge_command)
app.command("bench")(bench.bench_command)
app.command("warmup")(warmup.warmup_command)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"stereohdr {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """High dynamic range images from a stereo pair whose two cameras were set to different exposures."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; exits with 0, 2 for bad input, or 1 for any other failure.

    Parameters
    ----------
    arguments
        Without the program's name; `sys.argv` by default.
    """
    own_process = arguments is None
    if own_process:
        gc.set_threshold(COLLECT_AFTER)
        silence_libraries()
    status, message = EXIT_FAILURE, None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StereoHdrWarning)
        try:
            app(args=None if arguments is None else list(arguments))
        except SystemExit as stop:
            status = stop.code
        except InputError as error:
            status, message = EXIT_BAD_INPUT, str(error)
        except StereoHdrError as error:
            message = str(error)
        except MemoryError:
            message = "not enough memory for images of this size; reduce them first"
        except OSError as error:  # what is left is standard output: closed, or a full disk behind it
            message = f"cannot write the report ({error.strerror or error})"
    with suppress(OSError):
        # Shown at the end, so that they do not collide with the progress display.
        for notice in caught:
            typer.echo(f"warning: {notice.message}", err=True)
        if message is not None:
            typer.echo(f"error: {message}", err=True)
    if own_process:
        gc.freeze()  # or Python would look through all that Numba made before it ends: half a second
    sys.exit(status)
