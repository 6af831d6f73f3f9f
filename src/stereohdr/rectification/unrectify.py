"""A result in the rectified main view, brought back to the pixels of the photo that it was made from."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stereohdr.camera_colour import to_bt709, white_balanced
from stereohdr.errors import InputError
from stereohdr.model import Disparity, HdrResult, Photo, ResponseCurve, SourceFlag
from stereohdr.radiance import exposure_map, initial_radiance
from stereohdr.rectification.geometry import Rectification, RectifiedView
from stereohdr.rectification.resampling import interpolated, strips

PixelT = TypeVar("PixelT", bound=np.generic)

OWN = (SourceFlag.MEASURED, SourceFlag.NO_INFORMATION, SourceFlag.WEIGHT_CUT)
"""Pixels that hold the main view's own radiance; they take it from the photo itself, as sharp as it was."""


def unrectified(
    result: HdrResult, rectification: Rectification, main_photo: Photo, *, response: ResponseCurve | None = None
) -> HdrResult:
    """Return a result in the pixels of the main photo instead of the rectified main view.

    Parameters
    ----------
    result
        Of a pair that was rectified.
    rectification
        How it was.
    main_photo
        The photo of the main view as it was before.
    response
        The response that was given to `stereohdr.fuse`, None if none was.

    Returns
    -------
    The result, ``(H, W, ...)`` as the photo. Radiance is interpolated where something was restored; elsewhere,
    and where the rectified view does not reach, it is that of the photo. Flags and disparities are those of the
    nearest rectified pixel. Disparities sit at the pixels of the photos but are still those of the rectified
    views, in their pixels: depth follows from them as before. Stages stay as they are, rectified.

    Raises
    ------
    InputError
        The photo or the result has another size than the rectification.
    """
    view = rectification.view(result.main)
    other = rectification.view("right" if result.main == "left" else "left")
    width, height = view.size
    if (main_photo.width, main_photo.height) != view.size or result.source.shape != rectification.size[::-1]:
        raise InputError(
            f"{main_photo.name}: is {main_photo.width}x{main_photo.height}, the result was rectified from "
            f"{width}x{height}; give the photo that the result was made from"
        )
    in_camera_colours = response is None and main_photo.linear
    if in_camera_colours:  # as `stereohdr.fuse` does
        (main_photo,) = white_balanced((main_photo,), as_in=main_photo)
    radiance = initial_radiance(main_photo, result.response, exposure=result.exposures[0])
    if in_camera_colours:
        radiance = to_bt709(radiance, main_photo.colour_matrix)
    weight = np.zeros((height, width), dtype=np.float32)
    out_of_range = exposure_map(main_photo)
    source = np.where(out_of_range, SourceFlag.NO_INFORMATION, SourceFlag.MEASURED).astype(np.uint8)
    rectified = np.concatenate([result.radiance, result.weight[..., None]], axis=2)
    for rows, pixels in strips(view.size):
        at = view.from_photo(pixels)
        values, inside = interpolated(rectified, at)
        source[rows] = np.where(inside, _nearest(result.source, at), source[rows])
        restored = inside & ~np.isin(source[rows], OWN)
        radiance[rows] = np.where(restored[..., None], values[..., :-1], radiance[rows])
        weight[rows] = np.where(restored, values[..., -1], 0)
    return replace(
        result,
        radiance=radiance,
        source=source,
        weight=weight,
        disparity=_unrectified_disparity(result.disparity, other),
        main_disparity=result.main_disparity and _unrectified_disparity(result.main_disparity, view),
        confidence=None if result.confidence is None else _unrectified_map(result.confidence, view),
    )


def _unrectified_disparity(disparity: Disparity, view: RectifiedView) -> Disparity:
    return Disparity(_unrectified_map(disparity.values, view), _unrectified_map(disparity.flags, view))


def _unrectified_map(image: NDArray[PixelT], view: RectifiedView) -> NDArray[PixelT]:
    """Return the nearest rectified pixel's value for each pixel of the photo, 0 where the view does not reach."""
    width, height = view.size
    return np.concatenate(
        [_nearest(image, view.from_photo(pixels)) for _, pixels in strips((width, height))], dtype=image.dtype
    )


def _nearest(image: NDArray[PixelT], at: NDArray[np.float64]) -> NDArray[PixelT]:
    """Return the values of ``(H, W)`` nearest to positions ``(..., 2)``, 0 outside."""
    height, width = image.shape
    x, y = at[..., 0], at[..., 1]
    inside = (x >= -0.5) & (x < width - 0.5) & (y >= -0.5) & (y < height - 0.5)
    column, row = (np.rint(np.where(inside, along, 0.0)).astype(np.intp) for along in (x, y))
    return np.where(inside, image[row, column], image.dtype.type(0))
