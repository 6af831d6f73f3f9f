"""Ground-truth disparity: reading, visibility, other sizes, views in between.

Maps of bare values are ``(H, W)`` float32 in pixels of their own image, 0 where unknown.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import FileFormatError, InputError
from stereohdr.io import read_photo
from stereohdr.io.metadata import first_bytes
from stereohdr.io.pfm import decode_pfm
from stereohdr.model import Disparity, DisparityFlag, View

Values = NDArray[np.float32]

TOLERANCE = 1.0
"""Pixels by which the disparities of one surface in the two views may differ."""


def read_disparity(path: str | Path, *, scale: float = 1.0) -> Values:
    """Read a disparity map.

    Parameters
    ----------
    path
        PNG or TIFF, where 0 is unknown (Middlebury 2005 and 2006), or ``.pfm``, where infinity is (2014).
    scale
        Stored value of one pixel of disparity: 3 for third-size Middlebury maps.

    Returns
    -------
    ``(H, W)`` float32, pixels, 0 where unknown.

    Raises
    ------
    FileFormatError
        The file cannot be read, or has three channels.
    InputError
        The scale is not positive.
    """
    if not scale > 0:
        raise InputError(f"{path}: the scale of a disparity map must be positive, got {scale}")
    if Path(path).suffix.lower() == ".pfm":
        first_bytes(path, 1)
        stored = decode_pfm(Path(path).read_bytes(), str(path))
    else:
        stored = read_photo(path).codes
    if stored.shape[2] != 1:
        raise FileFormatError(f"{path}: a disparity map is grey, this is a colour image; give another file")
    values = stored[..., 0].astype(np.float32)
    known = np.isfinite(values) & (values > 0)
    return np.where(known, values / np.float32(scale), 0).astype(np.float32)


def known_disparities(left: Values | None, right: Values | None) -> tuple[Disparity | None, Disparity | None]:
    """Flag the ground truth of both views: what the other view sees, what it does not, what is unknown.

    A pixel is ``MATCHED`` (visible in the other view) when its partner lies in the frame, and the other map there
    says the same disparity to `TOLERANCE`; where the other map is unknown or missing, when nothing nearer of this
    map falls there (z-buffer). Otherwise it is ``OCCLUDED``, or ``NOT_COMPUTED`` where its disparity is unknown.

    Parameters
    ----------
    left, right
        ``(H, W)`` float32, pixels, 0 where unknown, ``x_left = x_right + d``; or None.

    Returns
    -------
    The same with flags, None for None.
    """
    return (
        None if left is None else _flagged(left, right, -1),
        None if right is None else _flagged(right, left, 1),
    )


def _flagged(values: Values, other: Values | None, sign: int) -> Disparity:
    height, width = values.shape
    rows, columns = np.mgrid[:height, :width]
    known = values > 0
    target = np.rint(columns + sign * values).astype(np.intp)
    inside = known & (target >= 0) & (target < width)
    target = np.where(inside, target, 0)
    nearest = np.zeros((height, width), np.float32)
    np.maximum.at(nearest, (rows[inside], target[inside]), values[inside])
    in_front = values >= nearest[rows, target] - TOLERANCE
    if other is None:
        visible = inside & in_front
    else:
        there = other[rows, target]
        visible = inside & np.where(there > 0, np.abs(there - values) <= TOLERANCE, in_front)
    flags = np.full((height, width), DisparityFlag.NOT_COMPUTED, np.uint8)
    flags[known] = DisparityFlag.OCCLUDED
    flags[visible] = DisparityFlag.MATCHED
    return Disparity(np.where(known, values, np.float32(0)), flags)


def reduced_disparity(values: Values, factor: int) -> Values:
    """Return the disparity of an image reduced by `factor`, in its pixels.

    Each block takes the (upper) median of its known values, which does not mix surfaces, and is unknown when fewer
    than half of them are known.
    """
    if factor == 1:
        return values
    height, width = (size // factor for size in values.shape)
    blocks = values[: height * factor, : width * factor].reshape(height, factor, width, factor)
    blocks = np.sort(blocks.transpose(0, 2, 1, 3).reshape(height, width, factor**2), axis=2)
    known = np.count_nonzero(blocks, axis=2)
    middle = factor**2 - known + known // 2  # the unknown come first
    chosen = np.take_along_axis(blocks, np.minimum(middle, factor**2 - 1)[..., None], axis=2)[..., 0]
    return np.where(2 * known >= factor**2, chosen / np.float32(factor), 0).astype(np.float32)


def disparity_between(left: Values, right: Values, position: float) -> Values:
    """Return the disparity map of a camera between the two, towards both of them, in units of the whole baseline.

    Both maps are projected into the new view, the nearest surface wins, and cracks of one pixel are closed.

    Parameters
    ----------
    left, right
        ``(H, W)`` float32, pixels, 0 where unknown: the maps of two rectified cameras for each other.
    position
        Place of the new camera on the baseline, 0 (left) to 1 (right).

    Returns
    -------
    ``(H, W)`` float32: ``x_left - x_right`` of what the new view sees; 0 where no map knows it. Times `position`,
    it is the disparity between the left and the new view.
    """
    if position in (0, 1):
        return left if position == 0 else right
    height, width = left.shape
    rows, columns = np.mgrid[:height, :width]
    projected = np.zeros((height, width), np.float32)
    for values, shift in ((left, -position), (right, 1 - position)):
        target = np.rint(columns + shift * values).astype(np.intp)
        inside = (values > 0) & (target >= 0) & (target < width)
        np.maximum.at(projected, (rows[inside], target[inside]), values[inside])
    before, middle, after = projected[:, :-2], projected[:, 1:-1], projected[:, 2:]
    # A surface that widens leaves cracks, through which the background of the other map may shine.
    crack = (np.abs(before - after) <= TOLERANCE) & (middle < np.minimum(before, after) - TOLERANCE)
    closed = projected.copy()
    closed[:, 1:-1] = np.where(crack, 0.5 * (before + after), middle)
    return closed


def warped_by_truth(image: NDArray[np.float32], disparity: Disparity, *, main: View) -> NDArray[np.float32]:
    """Bring an image of the auxiliary view into the main view by known disparity.

    Parameters
    ----------
    image
        ``(H, W, C)`` float, in the AV's pixels.
    disparity
        In the MV's pixels.
    main
        Which camera the MV is: ``x_AV = x_MV - d`` for the left one, ``x_MV + d`` for the right one.

    Returns
    -------
    ``(H, W, C)`` float32, linear interpolation along the row, the border repeated. Only pixels flagged ``MATCHED``
    show the same surface.
    """
    height, width = disparity.values.shape
    rows, columns = np.mgrid[:height, :width]
    x = np.clip(columns + (-1 if main == "left" else 1) * disparity.values, 0, width - 1)
    first = np.minimum(x.astype(np.intp), width - 2)
    share = (x - first)[..., None].astype(np.float32)
    return (1 - share) * image[rows, first] + share * image[rows, first + 1]
