"""`fuse`: checks the input, runs the method, and collects what a user needs to trust the result."""

from __future__ import annotations

import platform
import warnings
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np

from stereohdr import __version__
from stereohdr.checks import check_exposure_order, check_views, doubtful_white_level, unusable_view
from stereohdr.errors import ConfigError, InputError, ResponseError, StereoHdrError, StereoHdrWarning
from stereohdr.methods import get_method
from stereohdr.model import ResponseCurve, StereoPair
from stereohdr.stage_log import Progress, StageLog

if TYPE_CHECKING:
    from stereohdr.config import FuseConfig
    from stereohdr.model import Disparity, HdrResult

DEFAULT_METHOD = "paper"


def fuse(
    pair: StereoPair,
    method: str = DEFAULT_METHOD,
    config: FuseConfig | None = None,
    *,
    response: ResponseCurve | None = None,
    disparity: Disparity | None = None,
    keep_stages: bool = False,
    checks: bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> HdrResult:
    """Make an HDR image from a rectified stereo pair at two exposures.

    Parameters
    ----------
    pair
        Two photos ``(H, W, C)`` with their exposure times; says which view the result is made in.
    method
        Name of a method, see `stereohdr.methods.available_methods`.
    config
        The method's configuration; its defaults when None.
    response
        Known inverse response of the camera; estimated from the pair when None.
    disparity
        Known disparity of the auxiliary view, ``(H, W)`` in its pixels; estimated from the pair when None.
    keep_stages
        Keep every intermediate array in `HdrResult.stages`.
    checks
        Refuse swapped exposures and exchanged views, and warn of unrelated ones. False trusts the caller.
    threads
        Threads to use, all available by default. The result does not depend on it.
    progress
        Called with the name of each stage as it starts.

    Returns
    -------
    The radiance of the main view with everything that explains it. When one view is under- or over-exposed
    throughout, the main view's own radiance, flagged, with a warning.

    Raises
    ------
    ExposureError
        The exposure times contradict the brightness of the photos.
    InputError
        The photos of the left and the right camera are exchanged, or `disparity` has another size than the photos.
    ConfigError
        Unknown method, or a configuration that does not fit the pair.
    ResponseError
        `response` has another channel count, or none is given and the pair does not determine one.

    Warns
    -----
    StereoHdrWarning
        For each sentence in `HdrResult.warnings`.

    Examples
    --------
    >>> from stereohdr import StereoPair, fuse
    >>> from stereohdr.simulation import Camera, expose_pair, room
    >>> scene = room(width=64, height=48)
    >>> pair = expose_pair(scene.radiance_left, scene.radiance_right, (0.01, 0.16), Camera(), seed=1)
    >>> fuse(pair).radiance.shape
    (48, 64, 3)
    """
    if not isinstance(pair, StereoPair):
        raise InputError(f"fuse takes a StereoPair of two Photos, got a {type(pair).__name__}")
    if threads is not None and (not isinstance(threads, int) or threads < 1):
        raise ConfigError(f"threads must be a whole number from 1 on, or None for all, got {threads!r}")
    chosen = get_method(method)
    config = chosen.config_type() if config is None else config
    if not isinstance(config, chosen.config_type):
        raise ConfigError(
            f"method {method!r} takes a {chosen.config_type.__name__}, got a {type(config).__name__}"
        )
    config.search_range(pair.main_photo.width)
    if response is not None and not isinstance(response, ResponseCurve):
        raise ResponseError(f"response must be a ResponseCurve (see ResponseCurve.load), got {response!r}")
    if response is not None and response.channels != pair.main_photo.channels:
        raise ResponseError(
            f"the response curve has {response.channels} channel(s), the photos have "
            f"{pair.main_photo.channels}; give a response of the same camera and mode"
        )

    size = (pair.left.height, pair.left.width)
    if disparity is not None and disparity.values.shape != size:
        raise InputError(f"the disparity map has shape {disparity.values.shape}, the photos have {size}")

    log = StageLog(progress=progress, keep_arrays=keep_stages)
    with log.stage("checks"):
        problem = unusable_view(pair, config=config.exposure_map)
        if problem is not None:
            log.warn(f"{problem}; the result is the main view's own radiance")
            chosen = get_method("mv-only")
        elif checks:
            check_exposure_order(pair)
            for doubt in (doubtful_white_level((pair.left, pair.right)), check_views(pair)):
                if doubt is not None:
                    log.warn(doubt)
    run = chosen.load()

    if pair.main == "right":
        pair_left, disparity = pair.mirrored(), disparity and disparity.mirrored()
    else:
        pair_left = pair
    result = run(pair_left, config, response=response, disparity=disparity, log=log, threads=threads)
    if not result.response.is_monotone:
        log.warn("the response curve does not rise everywhere; radiance is not reliable where it falls")
    result = replace(
        result,
        config=config,
        seconds=log.seconds,
        stages=log.arrays,
        warnings=(*result.warnings, *log.warnings),
        versions=_versions(),
        exposures=pair.exposures,
        main="left",
    )
    if pair.main == "right":
        result = result.mirrored()
    if not np.isfinite(result.radiance).all():
        raise StereoHdrError("internal error: the result holds values that are not finite; please report it")
    for sentence in result.warnings:
        warnings.warn(sentence, StereoHdrWarning, stacklevel=2)
    return result


def _versions() -> dict[str, str]:
    packages = {name: version(name) for name in ("numpy", "scipy", "numba")}
    return {"stereohdr": __version__, "python": platform.python_version(), **packages}
