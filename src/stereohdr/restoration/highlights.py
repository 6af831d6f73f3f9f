"""Restoring clipped channels of the main view from a shorter auxiliary exposure, in log radiance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial, reduce

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import HighlightsConfig
from stereohdr.restoration import _highlights_kernels as kernels
from stereohdr.restoration._highlights_kernels import Terms, Views, Weights
from stereohdr.restoration.screened_poisson import solve_screened_poisson
from stereohdr.strips import available_threads, run_strips, run_together

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

SIDE_BY_SIDE_PIXELS = 2**21
"""Channels of larger images are restored one after the other, to save memory."""

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


@dataclass(frozen=True, eq=False)
class JointEvidence:
    """What is known of the auxiliary radiance in the main view's pixels; see `join_evidence`.

    Parameters
    ----------
    log_radiance
        ``(H, W, C)`` float32, its natural logarithm; any number where nothing is known.
    source
        ``(H, W, C)`` uint8: 2 where it is measured, 1 where it is borrowed, 0 where nothing is known.
    """

    log_radiance: NDArray[np.float32]
    source: NDArray[np.uint8]


def join_evidence(measured: Evidence, borrowed: Evidence) -> JointEvidence:
    """Take what is measured, and what is borrowed where nothing is."""
    source = np.where(borrowed.usable, np.uint8(kernels.BORROWED), np.uint8(kernels.NOTHING))
    source[measured.usable] = kernels.MEASURED
    radiance = np.where(measured.usable, measured.radiance, borrowed.radiance)
    return JointEvidence(np.log(np.maximum(radiance, np.float32(DARKEST))), source)


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
    log_main = np.log(main)
    restored = log_main.copy()
    restore_logarithms(restored, clipped, join_evidence(measured, borrowed), config=config, threads=threads)
    return np.where(restored != log_main, np.exp(restored), main)


def restore_logarithms(
    log_main: NDArray[np.float32],
    clipped: NDArray[np.bool_],
    evidence: JointEvidence,
    *,
    config: HighlightsConfig | None = None,
    threads: int | None = None,
) -> None:
    """Do what `restore_highlights` does in place, to the logarithm of the radiance: for large images."""
    config = config or HighlightsConfig()
    if not clipped.any():
        return
    rows = _rows_around(clipped)
    views = Views(
        np.ascontiguousarray(log_main[rows]),
        np.ascontiguousarray(clipped[rows]),
        np.ascontiguousarray(evidence.log_radiance[rows]),
        np.ascontiguousarray(evidence.source[rows]),
    )
    threads = threads or available_threads()
    at_once = min(threads, log_main.shape[2]) if views.clipped[..., 0].size <= SIDE_BY_SIDE_PIXELS else 1

    def restore(c: int) -> None:
        domain, log_clip = views.clipped[..., c], views.main[..., c]
        if domain.any():
            u = _solved(views, c, config, threads if at_once == 1 else 1)
            risen = domain & (u > log_clip + np.float32(SMALLEST_RISE))
            # The other channels look at this one only where it is not clipped.
            log_main[rows][..., c][risen] = u[risen]

    run_together(*(partial(restore, c) for c in range(log_main.shape[2])), threads=at_once)


def _solved(views: Views, channel: int, config: HighlightsConfig, threads: int | None) -> NDArray[np.float32]:
    terms, log_clip = _terms(views, channel, config, threads), views.main[..., channel]
    return solve_screened_poisson(
        views.clipped[..., channel],
        log_clip,
        data=terms.data,
        data_weight=terms.data_weight,
        gradient_x=terms.gradient[0],
        gradient_y=terms.gradient[1],
        weight_x=terms.gradient_weight[0],
        weight_y=terms.gradient_weight[1],
        lower=log_clip,
        threads=threads,
    )


def _rows_around(clipped: NDArray[np.bool_]) -> slice:
    """Return the rows that hold all clipped pixels and their neighbours; whole ones need no copy."""
    anywhere = reduce(np.logical_or, np.moveaxis(clipped, 2, 0))  # faster than any() over the channels
    touched = np.flatnonzero(anywhere.any(axis=1))
    return slice(max(int(touched[0]) - 1, 0), int(touched[-1]) + 2)


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
