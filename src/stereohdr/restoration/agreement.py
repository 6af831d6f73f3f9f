"""Whether warped auxiliary radiance can be what the main view saw: a test of exposure intervals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.config import AgreementConfig
from stereohdr.model import RESPONSE_KNOTS, Photo, ResponseCurve

HIGHEST_KNOT = RESPONSE_KNOTS - 1


def agrees_with_main(
    main: Photo,
    warped: NDArray[np.float32],
    known: NDArray[np.bool_],
    response: ResponseCurve,
    *,
    exposures: tuple[float, float],
    slack: float | None = None,
    config: AgreementConfig | None = None,
) -> NDArray[np.bool_]:
    """Compare warped radiance with the interval that the main view's code stands for.

    A code z says that the radiance lies between E(z - c) and E(z + c), widened by a relative slack for errors of
    the response; a code near white only says that it is at least so bright, one near black that it is at most so
    bright.

    Parameters
    ----------
    main
        The main view's codes.
    warped
        ``(H, W, C)`` float32, radiance of the auxiliary view in the main view's pixels.
    known
        ``(H, W, C)`` bool, where `warped` is a measurement; other values are not compared.
    response
        Curve with C channels.
    exposures
        Exposure times ``(main, auxiliary)`` in seconds. A shorter auxiliary exposure has the coarser codes, and
        then they, too, stand for an interval: E(z - c') to E(z + c').
    slack
        Relative widening; the configuration's when None.
    config
        Widths of the intervals.

    Returns
    -------
    ``(H, W)`` bool, True where every known channel agrees. Source: our own, in place of the bit test of the paper.
    """
    config = config or AgreementConfig()
    slack = config.slack if slack is None else slack
    knots = np.arange(RESPONSE_KNOTS, dtype=np.float64)
    codes = np.arange(main.white + 1) * (HIGHEST_KNOT / main.white)
    agrees = np.ones(known.shape[:2], dtype=bool)
    for c in range(known.shape[2]):
        exposure = np.exp(response.log_exposure[c])
        radiance = exposure / exposures[0]
        highest = np.interp(np.minimum(codes + config.codes, HIGHEST_KNOT), knots, radiance) * (1 + slack)
        lowest = np.interp(np.maximum(codes - config.codes, 0), knots, radiance) * (1 - slack)
        highest[codes >= config.white_code] = np.inf
        lowest[codes <= config.black_code] = 0
        if exposures[1] < exposures[0]:
            # Intervals meet where the value itself lies in the sum of both.
            lowest, highest = _widened(lowest, highest, exposure / exposures[1], config.auxiliary_codes)
        z, value = main.codes[..., c], warped[..., c]
        inside = (value <= highest.astype(np.float32)[z]) & (value >= lowest.astype(np.float32)[z])
        agrees &= inside | ~known[..., c]
    return agrees


def _widened(
    lowest: NDArray[np.float64], highest: NDArray[np.float64], radiance: NDArray[np.float64], knots: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move the ends of intervals outwards by so many knots of a curve, where knot z has ``radiance[z]``.

    Beyond the ends of the curve there is no bound.
    """
    numbers = np.arange(len(radiance), dtype=np.float64)
    least = np.interp(lowest, radiance, numbers) - knots
    most = np.interp(highest, radiance, numbers) + knots
    return (
        np.where(least <= 0, 0, np.interp(least, numbers, radiance)),
        np.where(most >= numbers[-1], np.inf, np.interp(most, numbers, radiance)),
    )


def supported(mask: NDArray[np.bool_], *, radius: int) -> NDArray[np.bool_]:
    """Return the pixels of `mask` around which more than half of the ``(2 radius + 1)^2`` window is in it."""
    share = ndimage.uniform_filter(mask.astype(np.float32), 2 * radius + 1, mode="nearest")
    return mask & (share > 0.5)
