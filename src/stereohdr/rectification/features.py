"""Points that two views at different exposures have in common, found without knowing how the views lie."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereohdr.model import Photo
from stereohdr.radiance import code_luma
from stereohdr.rectification._opencv import load_opencv

LARGEST_RATIO = 0.8
"""A match counts if its descriptor is nearer than this times the second nearest (Lowe 2004)."""

LARGEST_FEATURE = 8.0
"""Diameter in pixels of the largest features that count. Measured on POLAR and Boreal: the error of the position
grows with the size, from 0.1 px at 3 px to 0.3 px at 10 px and 2 px at 40 px."""

MOST_FEATURES = 12_000
"""Features that are kept of a view, the strongest of each part of the picture."""

PARTS = (8, 6)
"""Columns and rows of parts among which the features are shared out."""

LARGEST_PIXELS = 3_000_000
"""Larger photos are reduced by a whole factor before features are sought: SIFT needs 300 bytes per pixel."""

SMALLEST_SIDE = 16
"""Pixels below which SIFT's pyramid has no octave."""

CONTRAST = 0.02
"""SIFT's contrast threshold, half of the usual one: noise in the dark costs matches, not errors."""

GRADES = 65_536
"""Brightness grades of the luma of which ranks are taken."""

LOCAL_CONTRAST = (2.0, (8, 8))
"""Clip limit and tiles of the local equalisation (CLAHE)."""

_CHUNK = 1024


@dataclass(frozen=True, eq=False)
class Matches:
    """Positions of the same scene points in both views.

    Parameters
    ----------
    left, right
        ``(N, 2)`` float64 pixels (x, y).
    """

    left: NDArray[np.float64]
    right: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.left)

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Matches:
        return Matches(self.left[chosen], self.right[chosen])

    def joined(self, others: Matches) -> Matches:
        """Return these matches and others."""
        return Matches(np.concatenate([self.left, others.left]), np.concatenate([self.right, others.right]))


def match_features(left: Photo, right: Photo) -> Matches:
    """Match SIFT features of two photos at any two exposures.

    Parameters
    ----------
    left, right
        ``(H, W, C)`` codes; they need not be of the same size.

    Returns
    -------
    Mutual nearest neighbours that pass the ratio test. Some are wrong.

    Raises
    ------
    MissingDependencyError
        OpenCV is not installed.

    Notes
    -----
    Source: SIFT (Lowe 2004), Hellinger distance of descriptors (Arandjelovic and Zisserman 2012). Each view is
    brought to the same brightness by `normalised_view` first.
    """
    (at_left, of_left), (at_right, of_right) = (_features(photo) for photo in (left, right))
    to_right, to_left = _nearest(of_left, of_right), _nearest(of_right, of_left)
    first, ratio = to_right
    mutual = ratio < LARGEST_RATIO
    mutual[mutual] = to_left[0][first[mutual]] == np.flatnonzero(mutual)
    return Matches(at_left[mutual], at_right[first[mutual]])


def normalised_view(photo: Photo) -> NDArray[np.uint8]:
    """Return the photo as a grey picture that looks nearly the same at any exposure.

    Returns
    -------
    ``(H, W)`` uint8.

    Notes
    -----
    Every luma becomes its rank, the share of the pixels that are darker: two exposures of one scene have the same
    ranks wherever both are not clipped, whatever the response. (This is histogram matching of both views, to a
    flat histogram.) A local equalisation, CLAHE (Zuiderveld 1994), then evens out what the views do not share.
    """
    cv2 = load_opencv("finding features in photos")
    grades = np.minimum(code_luma(photo) * np.float32((GRADES - 1) / 255), GRADES - 1).astype(np.intp)
    counts = np.bincount(grades.ravel(), minlength=GRADES)
    rank = (np.cumsum(counts) - counts / 2) / grades.size
    picture = np.rint(rank * 255).astype(np.uint8)[grades]
    limit, tiles = LOCAL_CONTRAST
    return cv2.createCLAHE(limit, tiles).apply(picture)


def _features(photo: Photo) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return positions ``(N, 2)`` (x, y) and descriptors ``(N, 128)`` of whole numbers."""
    cv2 = load_opencv("finding features in photos")
    nothing = np.empty((0, 2)), np.empty((0, 128), dtype=np.float32)
    if min(photo.height, photo.width) < SMALLEST_SIDE:
        return nothing
    picture = normalised_view(photo)
    factor = math.ceil(math.sqrt(picture.size / LARGEST_PIXELS))
    if factor > 1:
        height, width = (side // factor * factor for side in picture.shape)
        blocks = picture[:height, :width].reshape(height // factor, factor, width // factor, factor)
        picture = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
    sift = cv2.SIFT.create(contrastThreshold=CONTRAST)
    found = [point for point in sift.detect(picture, None) if point.size <= LARGEST_FEATURE]
    at = np.array([point.pt for point in found]).reshape(-1, 2)
    kept = _shared_out(at, np.array([point.response for point in found]), picture.shape)
    found, descriptors = sift.compute(picture, [found[number] for number in kept])
    if descriptors is None:
        return nothing
    at = np.array([point.pt for point in found], dtype=np.float64)
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1)
    hellinger = np.rint(np.sqrt(descriptors / total) * 255).astype(np.float32)
    return (at + 0.5) * factor - 0.5, hellinger


def _shared_out(
    at: NDArray[np.float64], strength: NDArray[np.float64], shape: tuple[int, ...]
) -> NDArray[np.intp]:
    """Return the indices of the strongest features of each part of the picture."""
    columns, rows = PARTS
    column = np.minimum(at[:, 0] * columns // shape[1], columns - 1)
    row = np.minimum(at[:, 1] * rows // shape[0], rows - 1)
    order = np.argsort(-strength, kind="stable")
    part = (row * columns + column)[order]
    each = MOST_FEATURES // (columns * rows)
    return np.sort(np.concatenate([order[part == p][:each] for p in range(columns * rows)]))


def _nearest(of: NDArray[np.float32], among: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return for each descriptor the nearest one, and the ratio of its distance to that of the second nearest.

    The descriptors are whole numbers up to 255, so that all sums are exact in float32, in any order.
    """
    if len(among) < 2:
        return np.zeros(len(of), dtype=np.intp), np.ones(len(of))
    best = np.empty(len(of), dtype=np.intp)
    ratio = np.empty(len(of))
    lengths = (among * among).sum(axis=1)
    for start in range(0, len(of), _CHUNK):
        some = of[start : start + _CHUNK]
        squares = lengths - 2 * (some @ among.T) + (some * some).sum(axis=1)[:, None]
        row = np.arange(len(some))
        nearest = squares.argmin(axis=1)
        first = squares[row, nearest].astype(np.float64)
        squares[row, nearest] = np.inf
        second = squares.min(axis=1).astype(np.float64)
        best[start : start + _CHUNK] = nearest
        ratio[start : start + _CHUNK] = np.sqrt(np.maximum(first, 0) / np.maximum(second, 1))
    return best, ratio
