"""Codes to radiance, luminance, and the map S of under- and over-exposed pixels."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import ExposureMapConfig
from stereohdr.model import Photo, ResponseCurve, StereoPair
from stereohdr.strips import run_strips

REC601 = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Luma weights for gamma-encoded codes."""

REC709 = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""Luminance weights for linear radiance."""


STRIP_ROWS = 64


def initial_radiance(photo: Photo, response: ResponseCurve, *, exposure: float) -> NDArray[np.float32]:
    """Return the initial radiance of one view, ``E = exp(g(z)) / t``.

    Parameters
    ----------
    photo
        ``(H, W, C)`` codes.
    response
        Curve with C channels.
    exposure
        Effective exposure time t in seconds.

    Returns
    -------
    ``(H, W, C)`` float32, linear, relative (1 / seconds). Source: paper Figure 3, R^i.
    """
    radiance = response.apply(photo.codes, photo.white)
    radiance /= np.float32(exposure)
    return radiance


def luminance(radiance: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Return the Rec.709 luminance ``(H, W)`` float32 of linear radiance ``(H, W, C)``; grey passes through."""
    return _weighted(radiance, REC709)


def code_luma(photo: Photo) -> NDArray[np.float32]:
    """Return the Rec.601 luma ``(H, W)`` float32 of the codes, scaled so that white is 255."""
    return _weighted(photo.codes, REC601) * np.float32(255.0 / photo.white)


SEEN_CODES = (2, 247)
"""Codes (of 255) between which a sensor is taken to follow its response."""


def clip_to_common_interval(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    response: ResponseCurve,
    *,
    exposures: tuple[float, float],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cut both views to the radiance that both exposures can see, channel by channel.

    Beyond it one view is flat where the other is not, and structures that only one of them has do not match.

    Parameters
    ----------
    main, auxiliary
        ``(H, W, C)`` float32 radiance.
    response
        Curve with C channels.
    exposures
        Exposure times of both views in seconds.

    Returns
    -------
    Both views, within ``[max E(2), min E(247)]`` of the two exposures. Where the interval is empty (no overlap of
    the exposures) both are cut to its geometric middle, and nothing is left to match.
    """
    low, high = _common_interval(response, exposures)
    cut = np.empty_like(main), np.empty_like(auxiliary)
    for view, result in zip((main, auxiliary), cut, strict=True):
        for c in range(view.shape[2]):
            np.clip(view[..., c], low[c], high[c], out=result[..., c])
    return cut


def common_luminance(
    pair: StereoPair, response: ResponseCurve, *, threads: int | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the luminance of the main and the auxiliary view, cut to the radiance that both exposures can see.

    Parameters
    ----------
    pair
        Photos.
    response
        Their curve.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    ``(H, W)`` float32 each: the `luminance` of what `clip_to_common_interval` makes of both `initial_radiance`.
    """
    low, high = _common_interval(response, pair.exposures)
    shape = pair.main_photo.codes.shape[:2]
    views = np.empty(shape, np.float32), np.empty(shape, np.float32)
    for photo, time, view in zip((pair.main_photo, pair.auxiliary_photo), pair.exposures, views, strict=True):
        table = response.exposure_table(photo.white).astype(np.float32) / np.float32(time)
        table = np.clip(table, low[:, None], high[:, None])
        # Every code has one radiance, so it is weighted before it is looked up.
        weighted = table * REC709[:, None] if photo.channels == 3 else table
        task = partial(_look_up, weighted, photo.codes, view)
        run_strips(task, len(view), strip_rows=STRIP_ROWS, threads=threads)
    return views


def _look_up(
    tables: NDArray[np.float32], codes: NDArray[np.integer], out: NDArray[np.float32], start: int, stop: int
) -> None:
    """Write for rows `start` to `stop` the sum over the channels of what the tables say of the codes."""
    rows = codes[start:stop]
    out[start:stop] = _sum([table[rows[..., c]] for c, table in enumerate(tables)])


def _common_interval(
    response: ResponseCurve, exposures: tuple[float, float]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the ends of the common interval, ``(C,)`` float32 radiance each."""
    knots = response.log_exposure[:, list(SEEN_CODES)]
    low = np.max([knots[:, 0] - np.log(time) for time in exposures], axis=0)
    high = np.min([knots[:, 1] - np.log(time) for time in exposures], axis=0)
    middle = 0.5 * (low + high)
    return np.exp(np.minimum(low, middle)).astype(np.float32), np.exp(np.maximum(high, middle)).astype(np.float32)


def _weighted(image: NDArray[Any], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    if image.shape[2] == 1:
        return np.ascontiguousarray(image[..., 0], dtype=np.float32)
    return _sum([image[..., c].astype(np.float32) * weights[c] for c in range(3)])


def _sum(channels: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    # Not a matrix product: its summation order depends on the BLAS, and S on the last bit.
    total = channels[0]
    for channel in channels[1:]:
        total += channel
    return total


def exposure_map(photo: Photo, *, config: ExposureMapConfig | None = None) -> NDArray[np.bool_]:
    """Return the map S of under- and over-exposed pixels, ``(H, W)`` bool.

    Notes
    -----
    Source: equation 1, with codes 0 and 255 included: a clipped pixel is what S is for.
    """
    return out_of_range(code_luma(photo), config=config)


def out_of_range(luma: NDArray[np.float32], *, config: ExposureMapConfig | None = None) -> NDArray[np.bool_]:
    """Return the map S, `exposure_map`, of a photo whose `code_luma` is known."""
    config = config or ExposureMapConfig()
    return (luma < config.under_threshold) | (luma > config.over_threshold)
