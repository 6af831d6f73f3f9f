"""Photos and results moved to other pixels: as linear exposure, with clipped pixels kept apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ResponseError
from stereohdr.model import Photo, ResponseCurve
from stereohdr.rectification.geometry import EDGE_SLACK, RectifiedView

CLIPPED_CODE = 248
"""A channel counts as clipped from this code (of 255) on: sensors bend before they clip."""

WHITE_8_BITS, DEEP_WHITE = 255, 65535
"""White levels of pictures; those in between are of sensors."""

_ROWS = 64
"""Rows that are resampled at a time, to keep the float64 positions of large photos small."""

_SNAP = 65536.0
"""Positions are rounded to this part of a pixel, so that a view that stays in place keeps its codes exactly."""


def resampled_photo(
    photo: Photo,
    view: RectifiedView,
    size: tuple[int, int],
    *,
    scale: int | None = None,
    response: ResponseCurve | None = None,
) -> tuple[Photo, NDArray[np.bool_]]:
    """Return a photo as the rectified camera would have taken it.

    Codes become exposure, exposure is interpolated, and the result becomes codes again, with more bits. So all
    that works on photos works on rectified ones.

    Parameters
    ----------
    photo
        ``(H, W, C)`` codes.
    view
        Where the pixels come from.
    size
        ``(width, height)`` of the result.
    scale
        How many codes one code of the photo becomes, see `largest_scale`, which is used when this is None.
    response
        The camera's response with C channels; that of the photo when None and it brings one. Without any, or when
        it does not rise everywhere, a stand-in is used: the sRGB curve for codes of 8 and of full 16 bits, a
        straight line for the codes of sensors in between.

    Returns
    -------
    photo
        ``(height, width, C)`` uint16, all codes and white `scale` times as large as before.
    valid
        ``(height, width)`` bool, False where the photo holds nothing (code 0).

    Raises
    ------
    ResponseError
        `response` has another channel count than the photo.

    Notes
    -----
    A pixel is a mixture of the 4x4 pixels around it (Catmull-Rom, limited to the range of the nearest four). Where
    these differ in which of their channels are clipped (code >= `CLIPPED_CODE` of 255), only the nearest four
    count, and of those only the ones that agree with the majority: a clipped pixel never bleeds into a valid one,
    a valid one never makes a clipped one look measured, and all channels are mixed the same way. Black needs no
    such care: the exposure of a black pixel is known to within one code, that of a clipped one is not known.
    """
    tables = _exposure_tables(photo, response or photo.response)
    scale = scale or largest_scale(photo)
    exposure = np.stack([table.astype(np.float32)[photo.codes[..., c]] for c, table in enumerate(tables)], axis=-1)
    clipped = photo.codes.astype(np.uint32) * 255 >= CLIPPED_CODE * photo.white
    pattern = (clipped * np.array([1, 2, 4], dtype=np.uint8)[: photo.channels]).sum(axis=2, dtype=np.uint8)

    width, height = size
    codes = np.empty((height, width, photo.channels), dtype=np.uint16)
    valid = np.empty((height, width), dtype=bool)
    positions = np.arange(photo.white + 1) * float(scale)
    for rows, pixels in strips(size):
        values, inside = interpolated(exposure, view.to_photo(pixels), pattern=pattern)
        for channel, table in enumerate(tables):
            codes[rows, :, channel] = np.rint(np.interp(values[..., channel], table, positions))
        codes[rows][~inside] = 0
        valid[rows] = inside
    return replace(photo, codes=codes, white_level=photo.white * scale), valid


def largest_scale(photo: Photo) -> int:
    """Return the largest power of two by which the codes of a photo can be multiplied within 16 bits.

    So codes of 8 bits gain 8 binary digits behind the point, codes of 12 bits gain 4.
    """
    return 2 ** ((DEEP_WHITE // photo.white).bit_length() - 1)


def interpolated(
    image: NDArray[np.float32], at: NDArray[np.float64], *, pattern: NDArray[np.uint8] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return an image between its pixels.

    Parameters
    ----------
    image
        ``(H, W, C)`` float32.
    at
        ``(..., 2)`` float64 positions (x, y); NaN is nowhere.
    pattern
        ``(H, W)`` uint8: only pixels of the same value are mixed; None mixes all. See `resampled_photo`.

    Returns
    -------
    ``(..., C)`` float32, 0 outside; and ``(...)`` bool, True where the position lies in the image.
    """
    from stereohdr.rectification._kernels import interpolate

    if pattern is None:
        pattern = np.zeros(image.shape[:2], dtype=np.uint8)
    snapped = np.rint(at.reshape(-1, 2) * _SNAP) / _SNAP
    values = np.empty((len(snapped), image.shape[2]), dtype=np.float32)
    inside = np.empty(len(snapped), dtype=bool)
    x, y = np.ascontiguousarray(snapped.T)
    interpolate(image, pattern, x, y, EDGE_SLACK, values, inside)
    return values.reshape(*at.shape[:-1], -1), inside.reshape(at.shape[:-1])


def strips(size: tuple[int, int]) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    """Yield the rows of a picture of `size` (width, height) in strips, and their pixels ``(h, W, 2)`` (x, y)."""
    width, height = size
    for start in range(0, height, _ROWS):
        rows = slice(start, min(start + _ROWS, height))
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(rows.start, rows.stop)), axis=-1)
        yield rows, pixels.astype(np.float64)


def _exposure_tables(photo: Photo, response: ResponseCurve | None) -> NDArray[np.float64]:
    """Return the exposure of every code, ``(C, white + 1)`` float64, strictly ascending."""
    if response is not None:
        if response.channels != photo.channels:
            raise ResponseError(
                f"the response curve has {response.channels} channel(s), {photo.name} has {photo.channels}; "
                f"give a response of the same camera and mode"
            )
        tables = response.exposure_table(photo.white)
        if (np.diff(tables.astype(np.float32), axis=1) > 0).all():
            return tables
    share = np.arange(photo.white + 1) / photo.white
    if photo.white in (WHITE_8_BITS, DEEP_WHITE):
        share = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.tile(share, (photo.channels, 1))
