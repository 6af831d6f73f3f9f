"""Photos made smaller: blocks of pixels averaged, borders cut, Bayer mosaics turned into RGB."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.model import Photo

Box = tuple[int, int, int, int]
"""Left, top, width, height in pixels."""

PixelT = TypeVar("PixelT", bound=np.generic)


def reduced_photo(photo: Photo, factor: int) -> Photo:
    """Return the photo with blocks of ``factor x factor`` codes averaged; rows and columns left over are cut.

    Source: the half-size images of the paper's section 3, made by area averaging of codes.
    """
    if factor == 1:
        return photo
    means = reduced_image(photo.codes, factor, photo.name)
    return replace(photo, codes=np.rint(means).astype(photo.codes.dtype))


def reduced_image(image: NDArray[np.generic], factor: int, name: str = "image") -> NDArray[np.float64]:
    """Return the means of blocks of ``factor x factor`` pixels of ``(H, W, C)``, float64.

    Raises
    ------
    InputError
        The image is smaller than one block.
    """
    height, width = (size // factor for size in image.shape[:2])
    if height == 0 or width == 0:
        raise InputError(
            f"{name}: {image.shape[1]}x{image.shape[0]} pixels cannot be reduced by {factor}; "
            f"choose a smaller factor"
        )
    cut = image[: height * factor, : width * factor].astype(np.float64)
    return cut.reshape(height, factor, width, factor, -1).mean(axis=(1, 3))


def cropped_photo(photo: Photo, box: Box) -> Photo:
    """Return the part of the photo inside `box`.

    Raises
    ------
    InputError
        The box is empty or leaves the image.
    """
    return replace(photo, codes=cropped(photo.codes, box, photo.name))


def cropped(image: NDArray[PixelT], box: Box, name: str = "image") -> NDArray[PixelT]:
    """Return the rows and columns of ``(H, W, ...)`` inside `box`.

    Raises
    ------
    InputError
        The box is empty or leaves the image.
    """
    left, top, width, height = box
    rows, columns = image.shape[:2]
    if not (width > 0 and height > 0 and 0 <= left <= columns - width and 0 <= top <= rows - height):
        raise InputError(
            f"{name}: the crop {list(box)} (left, top, width, height) must lie inside of {columns}x{rows} pixels"
        )
    return image[top : top + height, left : left + width]


def bayer_to_rgb(mosaic: Photo) -> Photo:
    """Turn an RGGB Bayer mosaic into RGB of half the size: one pixel for each 2x2 cell.

    Red and blue are the cell's own codes, green is the mean of its two, rounded; where one green is clipped, so is
    the result. Nothing is interpolated, so each channel keeps its noise and its clip point; red and blue sit half
    a mosaic pixel beside green, which demosaicing at full size would correct.

    Parameters
    ----------
    mosaic
        ``(H, W, 1)`` codes, red in the top left corner; an odd last row or column is cut.

    Returns
    -------
    ``(H // 2, W // 2, 3)`` codes of the same type and white level.

    Raises
    ------
    InputError
        The photo is in colour already, or smaller than a cell.
    """
    if mosaic.channels != 1 or min(mosaic.height, mosaic.width) < 2:
        raise InputError(
            f"{mosaic.name}: a Bayer mosaic is grey and at least 2x2 pixels, got {mosaic.width}x{mosaic.height} "
            f"with {mosaic.channels} channel(s); give the raw image"
        )
    height, width = mosaic.height // 2 * 2, mosaic.width // 2 * 2
    codes = mosaic.codes[:height, :width, 0]
    greens = np.stack([codes[0::2, 1::2], codes[1::2, 0::2]]).astype(np.uint32)
    green = np.where((greens == mosaic.white).any(axis=0), mosaic.white, (greens.sum(axis=0) + 1) // 2)
    rgb = np.stack([codes[0::2, 0::2], green.astype(codes.dtype), codes[1::2, 1::2]], axis=-1)
    return replace(mosaic, codes=rgb)
