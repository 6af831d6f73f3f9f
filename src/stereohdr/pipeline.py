"""`fuse`: checks the input, runs the method, and collects what a user needs to trust the result."""

from __future__ import annotations

import platform
import warnings
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr import __version__
from stereohdr.camera_colour import to_bt709, white_balanced
from stereohdr.checks import (
    check_exposure_order,
    check_same_camera,
    check_views,
    doubtful_white_level,
    estimated_ratio,
    unusable_view,
)
from stereohdr.errors import ConfigError, InputError, ResponseError, StereoHdrError, StereoHdrWarning
from stereohdr.memory import PROCESS_BYTES, Budget, MemoryPlan, check_plan, memory_limit
from stereohdr.methods import Method, get_method
from stereohdr.model import ResponseCurve, StereoPair
from stereohdr.stage_log import Progress, StageLog

if TYPE_CHECKING:
    from stereohdr.config import FuseConfig
    from stereohdr.model import Disparity, HdrResult

DEFAULT_METHOD = "robust"


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
    memory: str | float | Budget | None = None,
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
        Known inverse response of the camera. When None, that of the photos where both bring one (camera raw
        files), else it is estimated from the pair.
    disparity
        Known disparity of the auxiliary view, ``(H, W)`` in its pixels; estimated from the pair when None.
    keep_stages
        Keep every intermediate array in `HdrResult.stages`.
    checks
        Refuse swapped exposures and exchanged views, and warn of unrelated ones. False trusts the caller.
    threads
        Threads to use, all available by default. The result does not depend on it.
    memory
        Most memory that the process may take, in bytes or as text such as ``"4GiB"``; a `Budget` also says what
        is taken already, beside the pair. Half of what the machine or the container has by default. Method
        ``robust`` matches in strips to keep to it; it does not change the result.
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
        The photos of the left and the right camera are exchanged, or are raw files of different cameras, or
        `disparity` has another size than the photos.
    ConfigError
        Unknown method, or a configuration that does not fit the pair.
    MemoryLimitError
        The photos need more memory than `memory`; the message says how much.
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

    budget = _budget(memory, pair)
    log = StageLog(progress=progress, keep_arrays=keep_stages)
    with log.stage("checks"):
        for doubt in (check_same_camera(pair, response), estimated_ratio(pair)):
            if doubt is not None:
                log.warn(doubt)
        in_camera_colours = response is None and pair.known_response is not None
        if in_camera_colours:
            left, right = white_balanced((pair.left, pair.right), as_in=pair.main_photo)
            pair = replace(pair, left=left, right=right)
            response = pair.known_response
        problem = unusable_view(pair, config=config.exposure_map)
        if problem is not None:
            log.warn(f"{problem}; the result is the main view's own radiance")
            chosen = get_method("mv-only")
        elif checks:
            check_exposure_order(pair)
            for doubt in (doubtful_white_level((pair.left, pair.right)), check_views(pair)):
                if doubt is not None:
                    log.warn(doubt)
    limits = _limits(chosen, pair, config, budget)
    run = chosen.load()

    if pair.main == "right":
        pair_left, disparity = pair.mirrored(), disparity and disparity.mirrored()
    else:
        pair_left = pair
    result = run(pair_left, config, response=response, disparity=disparity, log=log, threads=threads, **limits)
    if not result.response.is_monotone:
        log.warn("the response curve does not rise everywhere; radiance is not reliable where it falls")
    if in_camera_colours:
        result = replace(result, radiance=to_bt709(result.radiance, pair.main_photo.colour_matrix))
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


def fuse_other_view(
    pair: StereoPair,
    result: HdrResult,
    config: FuseConfig | None = None,
    *,
    threads: int | None = None,
    memory: str | float | Budget | None = None,
    progress: Progress | None = None,
) -> HdrResult:
    """Make the HDR image of the other view, too, with the same method and response.

    Parameters
    ----------
    pair
        The pair from which `result` was made.
    result
        What `fuse` made of it in its main view.
    config, threads, memory, progress
        As for `fuse`.

    Returns
    -------
    The result in the view that was the auxiliary one, with its own disparity, confidence and source flags.

    Raises
    ------
    StereoHdrError
        As `fuse` does.
    """
    other = replace(pair, main="right" if pair.main == "left" else "left")
    response = None if pair.known_response is not None else result.response
    budget = memory if isinstance(memory, Budget) else Budget(memory_limit(memory), 0)
    return fuse(
        other,
        result.method,
        config,
        response=response,
        checks=False,
        threads=threads,
        memory=replace(budget, held=budget.held + _result_bytes(result)),
        progress=progress,
    )


def _budget(memory: str | float | Budget | None, pair: StereoPair) -> Budget:
    """Return the limit, and what is taken before a method begins."""
    budget = memory if isinstance(memory, Budget) else Budget(memory_limit(memory), 0)
    copies = 1 + (pair.main == "right") + (pair.known_response is not None)  # in a mirror, white-balanced
    photos = copies * (pair.left.codes.nbytes + pair.right.codes.nbytes)
    return replace(budget, held=PROCESS_BYTES + budget.held + photos)


def _limits(method: Method, pair: StereoPair, config: FuseConfig, budget: Budget) -> dict[str, Any]:
    """Return the further arguments of a method that plans its memory; check the need of one that does not."""
    if method.takes_memory:
        return {"memory": budget}
    pixels = pair.left.height * pair.left.width
    disparities = config.search_range(pair.left.width) + 1
    need = pixels * max(method.pixel_bytes, method.cell_bytes * disparities)
    if need:
        plan = MemoryPlan(budget.limit, budget.held + need, f"method {method.name}")
        check_plan(plan, f"{pair.left.name} and {pair.right.name}")
    return {}


def _result_bytes(result: HdrResult) -> int:
    views = [view for view in (result.disparity, result.main_disparity) if view is not None]
    maps = [array for view in views for array in (view.values, view.flags)]
    planes = (result.radiance, result.source, result.weight, result.confidence, *maps, *result.stages.values())
    return sum(plane.nbytes for plane in planes if plane is not None)


def _versions() -> dict[str, str]:
    packages = {name: _package_version(name) for name in ("numpy", "scipy", "numba")}
    return {"stereohdr": __version__, "python": platform.python_version(), **packages}


@cache
def _package_version(name: str) -> str:
    return version(name)  # reads files
