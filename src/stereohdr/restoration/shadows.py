"""Cleaning noisy pixels of the main view with a longer auxiliary exposure, in linear radiance."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import ShadowsConfig
from stereohdr.model import Photo, ResponseCurve
from stereohdr.restoration._shadows_kernels import (
    SMALLEST_SQUARE,
    TABLE_SHIFT,
    Noise,
    Scratch,
    Settings,
    Views,
    Windows,
    clean_rows,
    measure_windows,
)
from stereohdr.strips import run_strips

LEVELS = 24
"""Brightness classes in which the noise is measured, at most."""

FEWEST_WINDOWS = 50
"""Windows that a class needs to say something."""

QUANTISATION = 12**-0.5
"""Standard deviation of rounding to whole codes, in codes."""

MOST_WINDOWS = 50_000
"""So many windows are looked at for the noise of a channel, at most."""

STRIP_ROWS = 256


def clean_shadows(
    main: Photo,
    radiance: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    usable: NDArray[np.bool_],
    response: ResponseCurve,
    *,
    exposure: float,
    config: ShadowsConfig | None = None,
    threads: int | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Denoise the main view, guided by the auxiliary view.

    In each window the main view is explained by the auxiliary one, ``M = a A + b + noise``: least squares, drawn
    to a = 1 where the noise hides the relation. Noise has no part in A, so a A + b shows the structure of A at the
    level of M; there is no bias, because all is done in linear radiance. What the relation leaves unexplained
    beyond the noise (another surface, a wrong match, a highlight that moved) tells how much of M itself to keep.
    Windows that contain a pixel are averaged, those that explain more count more. A noisy pixel that the auxiliary
    view does not see is drawn to the mean of its neighbours as far as they differ by no more than noise. A pixel
    as clean as `ShadowsConfig.clean_noise` keeps its radiance exactly.

    Parameters
    ----------
    main
        The main view's codes.
    radiance
        ``(H, W, C)`` float32, its radiance M, positive.
    auxiliary
        ``(H, W, C)`` float32, radiance A of the longer exposure in the main view's pixels.
    usable
        ``(H, W, C)`` bool, where `auxiliary` is a measurement. (A dark A is one: leaving out what is dark would
        leave out only what noise made darker.)
    response
        Curve with C channels.
    exposure
        Exposure time of the main view in seconds.
    config
        Window and errors.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    cleaned
        ``(H, W, C)`` float32, positive.
    share
        ``(H, W, C)`` float32, 0..1, how much of the main view's own value was replaced.

    Notes
    -----
    Source: our own; the windowed linear model is that of the guided filter (He, Sun and Tang 2013), the weighing
    of both a Wiener filter with the noise of `noise_curve`.
    """
    config = config or ShadowsConfig()
    settings = Settings(
        radius=config.radius,
        noise_radius=config.noise_radius,
        clean_noise=float(config.clean_noise),
        level_error=float(config.level_error),
        slope_pull=float(config.slope_pull),
        fewest_share=float(config.fewest_share),
        alone_share=float(config.alone_share),
        alone_noise=float(config.alone_noise),
        lowest=float(config.lowest),
    )
    height, width, count = radiance.shape
    views = _views(radiance, auxiliary, usable)
    cleaned, share = views.main.copy(), np.zeros_like(views.main)
    known = [c for c in range(count) if usable[..., c].any()]
    strips = [(c, y) for c in known for y in range(0, height, STRIP_ROWS)]
    noises: dict[int, Noise] = {}

    def measure(start: int, stop: int) -> None:
        for c in known[start:stop]:
            curve = noise_curve(*views, channel=c, radius=config.noise_radius)
            noises[c] = _noise(*curve, main.white, np.exp(response.log_exposure[c]) / exposure)

    def clean(start: int, stop: int) -> None:
        for c, y in strips[start:stop]:
            last, scratch = min(y + STRIP_ROWS, height), _scratch(config, width)
            clean_rows(views, main.codes, c, noises[c], settings, y, last, scratch, cleaned, share)

    run_strips(measure, len(known), strip_rows=1, threads=threads)
    run_strips(clean, len(strips), strip_rows=1, threads=threads)
    return cleaned, share


def noise_curve(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    usable: NDArray[np.bool_],
    *,
    channel: int,
    radius: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measure the noise of a channel of the main view as a function of brightness.

    In each brightness class, the median of what windows of the least textured half leave unexplained by the
    auxiliary view. Of a large image, windows at regular distances are looked at.

    Parameters
    ----------
    main, auxiliary
        ``(H, W, C)`` float32, radiance of both views, in the main view's pixels.
    usable
        ``(H, W, C)`` bool, where they see the same.
    channel
        Its number.
    radius
        Of the windows.

    Returns
    -------
    log_brightness
        ``(N,)`` float64, rising, ln of the auxiliary view's radiance in the middle of each class.
    log_variance
        ``(N,)`` float64, ln of the variance of the noise there, squared radiance. N is 0 if there is nothing to
        measure.
    """
    height, width, _ = main.shape
    stride = math.ceil(math.sqrt(height * width / MOST_WINDOWS))
    rows, columns = -(-height // stride), -(-width // stride)
    brightness, texture, noise = (np.empty((rows, columns)) for _ in range(3))
    views = _views(main, auxiliary, usable)
    images, windows = np.empty((3, width), np.float32), _windows(6, radius, width)
    measure_windows(views, channel, stride, images, windows, brightness, texture, noise)
    found = brightness > 0
    order = np.argsort(brightness[found])
    if order.size < FEWEST_WINDOWS:
        return np.empty(0), np.empty(0)
    level = np.log(brightness[found][order])
    texture, noise = texture[found][order], noise[found][order]
    classes = min(LEVELS, level.size // FEWEST_WINDOWS)
    quantiles = np.interp(np.linspace(0, level.size - 1, classes + 1), np.arange(level.size), level)
    first, last = np.searchsorted(level, quantiles[:-1]), np.searchsorted(level, quantiles[1:], side="right")
    levels, variances = [], []
    for inside in map(slice, first, last):
        if len(level[inside]) >= FEWEST_WINDOWS:
            smooth = texture[inside] <= _median(np.sort(texture[inside]))
            levels.append(_median(level[inside]))
            variances.append(_median(np.sort(noise[inside][smooth])))
    return np.array(levels), np.log(np.maximum(variances, SMALLEST_SQUARE))


def _median(rising: NDArray[np.float64]) -> float:
    """Return the median of sorted numbers; NumPy's takes several times as long for so few."""
    return 0.5 * (rising[(len(rising) - 1) // 2] + rising[len(rising) // 2])


def _views(main: NDArray[np.float32], auxiliary: NDArray[np.float32], usable: NDArray[np.bool_]) -> Views:
    return Views(np.ascontiguousarray(main), np.ascontiguousarray(auxiliary), np.ascontiguousarray(usable))


def _noise(
    log_brightness: NDArray[np.float64],
    log_variance: NDArray[np.float64],
    white: int,
    table: NDArray[np.float64],
) -> Noise:
    """Return what is known about the noise of a channel; `table` is the radiance at the knots."""
    brightness, variance = _noise_table(log_brightness, log_variance)
    slopes = np.append(np.diff(variance) / np.diff(brightness), 0.0)
    step, doubt = _code_errors(white, table)
    rounding = np.maximum((QUANTISATION * step) ** 2, SMALLEST_SQUARE)
    return Noise(brightness, variance, slopes, rounding, doubt**2)


def _noise_table(
    log_brightness: NDArray[np.float64], log_variance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the variance of the noise at brightnesses that a kernel finds without a logarithm (`Noise`)."""
    if log_brightness.size == 0:
        return np.ones(1), np.zeros(1)
    first, last = np.exp(log_brightness[[0, -1]]).view(np.int64) >> TABLE_SHIFT
    brightness = (np.arange(first, last + 2) << TABLE_SHIFT).view(np.float64)
    return brightness, np.exp(np.interp(np.log(brightness), log_brightness, log_variance))


def _scratch(config: ShadowsConfig, width: int) -> Scratch:
    return Scratch(
        np.empty((2 * config.radius + config.noise_radius + 2, 3, width), np.float32),
        np.empty((2 * config.radius + 2, 7, width)),
        lights=_windows(1, config.noise_radius, width),
        moments=_windows(12, config.radius, width),
        fits=_windows(4, config.radius, width),
        misses=_windows(3, 1, width),
    )


def _windows(quantities: int, radius: int, width: int) -> Windows:
    rows = np.empty((2 * radius + 2, quantities, width))
    return Windows(radius, np.empty((quantities, width + radius + 1)), rows, np.empty((quantities, width)))


def _code_errors(white: int, table: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the radiance step at each code, and how wrong the radiance of the code itself may be.

    The doubt is a step at code 0, which stands for all that is darker, and falls with 1 / (1 + z)^2.
    """
    position = np.linspace(0, len(table) - 1, white + 1)
    step = np.gradient(np.interp(position, np.arange(len(table)), table))
    return step, step / (1 + np.arange(white + 1)) ** 2
