"""Restoring clipped channels of the main view from a shorter auxiliary exposure, in log radiance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import HighlightsConfig
from stereohdr.restoration import _highlights_kernels as kernels
from stereohdr.restoration._highlights_kernels import Terms, Views, Weights
from stereohdr.restoration.screened_poisson import solve_screened_poisson
from stereohdr.strips import run_strips

DISTANCE_CLASSES = (2.5, 5.5, 12.5, 25.5)
"""Distances from the rim of a clipped area, pixels, that separate the classes of the prior."""

PRIOR_PIXELS = 200.0
"""A class counts against the mean of all clipped pixels like so many pixels."""

FEWEST_PIXELS = 100
"""With fewer restored pixels in all, the prior is the clip value itself."""

LEAST_SPREAD = 0.1
"""Standard deviation of the prior, ln units, at least; what is used where nothing was seen is `UNSEEN_SPREAD`."""

UNSEEN_SPREAD = 0.5

STRIP_ROWS = 64

SMALLEST_RISE = 1e-3
"""What would come out less than this (ln) above its clip value keeps it: the solver is not more accurate, and what
is not restored should not look as if it were."""

DARKEST = 1e-12
"""Radiance below it is raised to it before the logarithm."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Auxiliary radiance in the main view's pixels.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32.
    usable
        ``(H, W, C)`` bool, where it counts.
    """

    radiance: NDArray[np.float32]
    usable: NDArray[np.bool_]


def restore_highlights(
    main: NDArray[np.float32],
    clipped: NDArray[np.bool_],
    measured: Evidence,
    borrowed: Evidence,
    *,
    config: HighlightsConfig | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Replace the clipped channels of the main view; everything else stays as it is.

    Per channel, the log radiance u of the clipped pixels minimises a sum of squares, each over its error:

    * u against the auxiliary radiance: that of matched pixels with a small error, that borrowed from the
      background with a large one, and where there is neither, against what clipped pixels of the same kind turned
      out to be elsewhere in this image (as many channels clipped, as far from the rim);
    * the differences of neighbours against those of the auxiliary view, or else of the channels that are not
      clipped, or else against 0. Unclipped neighbours are fixed, so that no seam appears;

    with u at least the clip value: a highlight never comes out darker than what the main view saw.

    Parameters
    ----------
    main
        ``(H, W, C)`` float32, initial radiance, positive; at a clipped channel its clip value.
    clipped
        ``(H, W, C)`` bool.
    measured, borrowed
        Radiance of matched pixels, and of pixels whose disparity is borrowed from the background.
    config
        The errors, in ln units.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    ``(H, W, C)`` float32. Source: our own; the gradient terms are those of Perez et al. 2003 in log radiance.
    """
    config = config or HighlightsConfig()
    result = main.copy()
    if not clipped.any():
        return result
    window = _neighbourhood(clipped)
    near = [Evidence(evidence.radiance[window], evidence.usable[window]) for evidence in (measured, borrowed)]
    views = _log_views(main[window], clipped[window], *near)
    for c in range(main.shape[2]):
        domain, log_main = views.clipped[..., c], views.main[..., c]
        if domain.any():
            terms = _terms(views, c, config, threads)
            u = solve_screened_poisson(
                domain,
                log_main,
                data=terms.data,
                data_weight=terms.data_weight,
                gradient_x=terms.gradient[0],
                gradient_y=terms.gradient[1],
                weight_x=terms.gradient_weight[0],
                weight_y=terms.gradient_weight[1],
                lower=log_main,
                threads=threads,
            )
            risen = domain & (u > log_main + np.float32(SMALLEST_RISE))
            result[window][..., c][risen] = np.exp(u[risen])
    return result


def _neighbourhood(clipped: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the rows and columns that hold all clipped pixels and their neighbours."""
    anywhere = reduce(np.logical_or, np.moveaxis(clipped, 2, 0))  # faster than any() over the channels
    spans = []
    for axis in (0, 1):
        touched = np.flatnonzero(anywhere.any(axis=1 - axis))
        spans.append(slice(max(int(touched[0]) - 1, 0), int(touched[-1]) + 2))
    return spans[0], spans[1]


def _log_views(
    main: NDArray[np.float32], clipped: NDArray[np.bool_], measured: Evidence, borrowed: Evidence
) -> Views:
    source = np.where(borrowed.usable, np.uint8(kernels.BORROWED), np.uint8(kernels.NOTHING))
    source[measured.usable] = kernels.MEASURED
    auxiliary = np.where(measured.usable, measured.radiance, borrowed.radiance)
    log_auxiliary = np.log(np.maximum(auxiliary, np.float32(DARKEST)))
    return Views(np.log(main), np.ascontiguousarray(clipped), log_auxiliary, source)


def _terms(views: Views, channel: int, config: HighlightsConfig, threads: int | None) -> Terms:
    """Return what is wanted of the pixels of a channel, and how much."""
    classes = _classes(views.clipped, channel)
    shape = classes.shape
    prior, spread = _prior(views, channel, classes)
    prior_weight = (1 / (config.prior_correlation * spread**2)).astype(np.float32)
    weights = Weights(
        level=_weight(config.level_error),
        borrowed_level=_weight(config.borrowed_level_error),
        gradient=_weight(config.gradient_error),
        borrowed_gradient=_weight(config.borrowed_gradient_error),
        colour=_weight(config.colour_error),
        smoothness=_weight(config.smoothness_error),
    )
    terms = Terms(*(np.empty(size, np.float32) for size in (shape, shape, (2, *shape), (2, *shape))))

    def task(start: int, stop: int) -> None:
        kernels.fill_terms(views, channel, classes, prior, prior_weight, weights, start, stop, terms)

    run_strips(task, len(classes), strip_rows=STRIP_ROWS, threads=threads)
    return terms


def _weight(error: float) -> np.float32:
    return np.float32(1 / error**2)


def _classes(clipped: NDArray[np.bool_], channel: int) -> NDArray[np.uint8]:
    """Return the class of each clipped pixel: by the number of clipped channels, and its distance from the rim."""
    rows, classes = np.empty(clipped.shape[:2], np.uint8), np.empty(clipped.shape[:2], np.uint8)
    limits = np.floor(np.square(DISTANCE_CLASSES)).astype(np.int64)
    kernels.fill_classes(clipped, channel, limits, rows, classes)
    return classes


def _prior(
    views: Views, channel: int, classes: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return how far (ln) clipped pixels of each class exceed the clip value: mean and standard deviation."""
    sums = np.zeros(((views.clipped.shape[2] + 1) * (len(DISTANCE_CLASSES) + 1), 3))
    kernels.sum_excess(views, channel, classes, sums)
    count, total, squares = sums.T
    mean, spread = 0.0, UNSEEN_SPREAD
    if count.sum() >= FEWEST_PIXELS:
        mean = total.sum() / count.sum()
        spread = np.sqrt(max(squares.sum() / count.sum() - mean**2, 0.0))
    share = count / (count + PRIOR_PIXELS)
    class_mean = total / np.maximum(count, 1)
    class_variance = np.maximum(squares / np.maximum(count, 1) - class_mean**2, 0)
    means = share * class_mean + (1 - share) * mean
    spreads = np.sqrt(share * class_variance + (1 - share) * spread**2)
    return means.astype(np.float32), np.maximum(spreads, LEAST_SPREAD)
