"""``stereohdr evaluate``: an HDR image against a reference."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stereohdr.cli.outputs import HDR_INPUT


def evaluate_command(
    test: Annotated[Path, typer.Argument(metavar="TEST", help=HDR_INPUT)],
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE", help="What it should be; same size.")],
    metric: Annotated[
        str, typer.Option(metavar="NAMES", help="Some of hdrvdp2,pu21,log2,cvvdp, with commas.")
    ] = "hdrvdp2,pu21,log2",
    encoding: Annotated[
        str,
        typer.Option(help="auto, rgb-bt.709, luminance, XYZ, ...; auto goes by the channels."),
    ] = "auto",
    ppd: Annotated[float, typer.Option(help="Pixels per degree of the observer's view.")] = 30.0,
    align: Annotated[
        bool, typer.Option("--align/--no-align", help="Bring the test to the reference's scale by one factor.")
    ] = True,
    peak: Annotated[
        float, typer.Option(help="cd/m2 of the reference's 99th luminance percentile; 0: it is absolute already.")
    ] = 100.0,
    main_photo: Annotated[
        Path | None,
        typer.Option("--main-photo", metavar="FILE", help="Photo of the view: align on its well-exposed pixels."),
    ] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE.png", help="Also draw where differences are seen.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Also write the scores.")
    ] = None,
) -> None:
    """Compare an HDR image with a reference by HDR-VDP-2.2, PU21 and errors in stops."""
    from stereohdr.cli.fuse import check_outputs
    from stereohdr.errors import ConfigError, FileFormatError, InputError
    from stereohdr.io import read_hdr, read_photo
    from stereohdr.io.images import write_png
    from stereohdr.metrics.evaluation import evaluate
    from stereohdr.metrics.protocol import Protocol
    from stereohdr.pictures import visibility_picture
    from stereohdr.report import write_json

    names = [name.strip() for name in metric.split(",") if name.strip()]
    if map_file is not None and map_file.suffix.lower() != ".png":
        raise FileFormatError(f"{map_file}: the map is a PNG picture; give a name that ends in .png")
    if map_file is not None and "hdrvdp2" not in names:
        raise ConfigError("--map draws what HDR-VDP-2 sees; add hdrvdp2 to --metric")
    check_outputs([map_file, json_file], [test, reference, main_photo])
    protocol = Protocol(pixels_per_degree=ppd, encoding=encoding, peak_luminance=peak, align=align)
    images = [read_hdr(path) for path in (test, reference)]
    if images[0].shape != images[1].shape:
        sizes = " and ".join(f"{i.shape[1]}x{i.shape[0]} with {i.shape[2]} channel(s)" for i in images)
        raise InputError(f"{test} and {reference} differ: {sizes}; compare images of the same view")
    photo = None
    if main_photo is not None:
        photo = read_photo(main_photo)
        if photo.codes.shape != images[0].shape:
            raise InputError(f"{main_photo}: has shape {photo.codes.shape}, the images {images[0].shape}")
    result = evaluate(images[0], images[1], protocol=protocol, metrics=names, main=photo)
    if map_file is not None and result.hdrvdp2 is not None:
        write_png(map_file, visibility_picture(result.hdrvdp2.p_map, images[1]))
    if json_file is not None:
        write_json(json_file, result.scores)

    if "hdrvdp2" in result.scores:
        vdp = result.scores["hdrvdp2"]
        typer.echo(f"HDR-VDP-2  Q {vdp['q']:.2f}, Q_MOS {vdp['q_mos']:.2f} (0 worst, 100 best)")
        typer.echo(f"           P_det {vdp['p_det']:.4f}, C_max {vdp['c_max']:.4g}")
    if "pu21_psnr" in result.scores:
        psnr = result.scores["pu21_psnr"]
        typer.echo(f"PU21       PSNR {'inf' if psnr is None else f'{psnr:.2f}'} dB", nl=False)
        typer.echo(f", SSIM {result.scores['pu21_ssim']:.4f}")
    if "log2_rmse" in result.scores:
        off = 100 * result.scores["share_off_third_stop"]
        typer.echo(f"stops      RMSE {result.scores['log2_rmse']:.4f}, {off:.2f} % off by more than 1/3 stop")
    if "cvvdp_jod" in result.scores:
        typer.echo(f"cvvdp      {result.scores['cvvdp_jod']:.3f} JOD")
    typer.echo(f"protocol   {result.report}")
