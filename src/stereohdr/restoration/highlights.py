"""Restoring clipped channels of the main view from a shorter auxiliary exposure, in log radiance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.config import HighlightsConfig
from stereohdr.restoration.screened_poisson import solve_screened_poisson

DISTANCE_CLASSES = (2.5, 5.5, 12.5, 25.5)
"""Distances from the rim of a clipped area, pixels, that separate the classes of the prior."""

PRIOR_PIXELS = 200.0
"""A class counts against the mean of all clipped pixels like so many pixels."""

FEWEST_PIXELS = 100
"""With fewer restored pixels in all, the prior is the clip value itself."""

LEAST_SPREAD = 0.1
"""Standard deviation of the prior, ln units, at least; what is used where nothing was seen is `UNSEEN_SPREAD`."""

UNSEEN_SPREAD = 0.5

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
    log_main = np.log(main)
    log_measured, log_borrowed = (
        np.log(np.maximum(e.radiance, np.float32(DARKEST))) for e in (measured, borrowed)
    )
    result = main.copy()
    for c in range(main.shape[2]):
        domain = clipped[..., c]
        if not domain.any():
            continue
        first = measured.usable[..., c]
        second = borrowed.usable[..., c] & ~first
        prior, spread = _prior(log_measured[..., c] - log_main[..., c], clipped, first, c)
        auxiliary = np.where(first, log_measured[..., c], log_borrowed[..., c])
        data = np.where(first | second, auxiliary, log_main[..., c] + prior)
        error = np.where(first, config.level_error, config.borrowed_level_error)
        error = np.where(first | second, error, spread * np.sqrt(config.prior_correlation))
        gradients = [_gradient(axis, auxiliary, first, second, log_main, clipped, c, config) for axis in (1, 0)]
        u = solve_screened_poisson(
            domain,
            log_main[..., c],
            data=data.astype(np.float32),
            data_weight=(1 / error**2).astype(np.float32),
            gradient_x=gradients[0][0],
            gradient_y=gradients[1][0],
            weight_x=gradients[0][1],
            weight_y=gradients[1][1],
            lower=log_main[..., c],
            threads=threads,
        )
        risen = domain & (u > log_main[..., c] + np.float32(SMALLEST_RISE))
        result[..., c] = np.where(risen, np.exp(u), main[..., c])
    return result


def _prior(
    excess: NDArray[np.float32], clipped: NDArray[np.bool_], seen: NDArray[np.bool_], channel: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return how far (ln) clipped pixels of each pixel's class exceed the clip value: mean and standard deviation.

    Classes: number of clipped channels, and distance from the rim of the clipped area.
    """
    domain = clipped[..., channel]
    distance = np.digitize(np.asarray(ndimage.distance_transform_edt(domain)), DISTANCE_CLASSES)
    classes = (clipped.sum(axis=2) * (len(DISTANCE_CLASSES) + 1) + distance)[domain]
    values, known = excess[domain].astype(np.float64), seen[domain]
    mean, spread = 0.0, UNSEEN_SPREAD
    if known.sum() >= FEWEST_PIXELS:
        mean, spread = float(values[known].mean()), float(values[known].std())
    size = int(classes.max()) + 1
    count = np.bincount(classes[known], minlength=size).astype(np.float64)
    total = np.bincount(classes[known], weights=values[known], minlength=size)
    squares = np.bincount(classes[known], weights=values[known] ** 2, minlength=size)
    share = count / (count + PRIOR_PIXELS)
    class_mean = total / np.maximum(count, 1)
    class_variance = np.maximum(squares / np.maximum(count, 1) - class_mean**2, 0)
    means = share * class_mean + (1 - share) * mean
    spreads = np.maximum(np.sqrt(share * class_variance + (1 - share) * spread**2), LEAST_SPREAD)
    prior, error = np.zeros(domain.shape, np.float32), np.full(domain.shape, UNSEEN_SPREAD, np.float32)
    prior[domain], error[domain] = means[classes], spreads[classes]
    return prior, error


def _gradient(
    axis: int,
    auxiliary: NDArray[np.float32],
    first: NDArray[np.bool_],
    second: NDArray[np.bool_],
    log_main: NDArray[np.float32],
    clipped: NDArray[np.bool_],
    channel: int,
    config: HighlightsConfig,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the wanted difference to the next pixel along `axis`, and its weight."""
    both_first = first & _next(first, axis)
    any_evidence = first | second
    both = any_evidence & _next(any_evidence, axis)
    total = np.zeros(first.shape, np.float32)
    count = np.zeros(first.shape, np.float32)
    for other in range(log_main.shape[2]):
        if other != channel:
            free = ~clipped[..., other]
            free &= _next(free, axis)
            total += np.where(free, _difference(log_main[..., other], axis), np.float32(0))
            count += free
    coloured = count > 0
    wanted = np.where(both, _difference(auxiliary, axis), total / np.maximum(count, 1))
    error = np.where(coloured, config.colour_error, config.smoothness_error)
    error = np.where(both, config.borrowed_gradient_error, error)
    error = np.where(both_first, config.gradient_error, error)
    return wanted.astype(np.float32), (1 / error**2).astype(np.float32)


def _next(array: NDArray, axis: int) -> NDArray:
    """Return each pixel's next neighbour along `axis`; the last one meets itself."""
    last = array[:, -1:] if axis == 1 else array[-1:]
    rest = array[:, 1:] if axis == 1 else array[1:]
    return np.concatenate([rest, last], axis=axis)


def _difference(array: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    return _next(array, axis) - array
