"""Response samples from matched SIFT features: the "conventional" way that the paper compares with (Table 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.errors import MissingDependencyError
from stereohdr.model import RESPONSE_KNOTS, Photo, StereoPair
from stereohdr.radiance import code_luma
from stereohdr.response.cdf_matching import knot_codes

if TYPE_CHECKING:
    from types import ModuleType

LARGEST_RATIO = 0.8
"""A match counts if its descriptor is nearer than this times the second nearest (Lowe 2004)."""

POSITION_SLACK = 1.5
"""Pixels by which matches may leave their row, or the search range, in a rectified pair."""

WINDOW = 3
"""Side in pixels of the window whose mean code is sampled at a feature."""

BRIGHT_SHARE = 99.0
"""Percentile of the luma that becomes white before features are sought."""

DOUBLED_PIXELS = 1_000_000
"""Images of at most this size are doubled first, for about twice the features; larger ones have enough."""

SMALLEST_SIDE = 16
"""Pixels below which SIFT's pyramid has no octave."""


def sift_sample_pairs(pair: StereoPair, *, max_disparity: int | None = None) -> list[NDArray[np.intp]]:
    """Pair the codes of both views at matched SIFT features.

    Parameters
    ----------
    pair
        Rectified photos, 8 to 16 bits.
    max_disparity
        Largest plausible disparity in pixels; None takes half the width.

    Returns
    -------
    For each channel ``(N, 2)`` intp: codes 0..255 in the main and the auxiliary view, means of 3x3 pixels, rounded
    (deeper codes to the knots of a response curve). Pairs with a clipped pixel in either window are dropped.

    Raises
    ------
    MissingDependencyError
        scikit-image is not installed.

    Notes
    -----
    Known of the original (Lin and Chang 2009): samples are SIFT matches between the two exposures. Chosen here:
    scikit-image's SIFT, ratio test 0.8, mutual matches, at most 1.5 px off the row, disparity within the search
    range. SIFT's contrast threshold is absolute, so dark views would hardly have features: each view's luma is
    scaled until its 99th percentile is white. Only the search for features sees that; the samples are the codes
    themselves.
    """
    feature = _skimage_feature()
    left, right = (_features(photo, feature) for photo in (pair.left, pair.right))
    if left is None or right is None:
        return [np.empty((0, 2), dtype=np.intp)] * pair.left.channels
    matches = feature.match_descriptors(left[1], right[1], max_ratio=LARGEST_RATIO, cross_check=True)
    at_left, at_right = left[0][matches[:, 0]], right[0][matches[:, 1]]
    reach = pair.left.width / 2 if max_disparity is None else max_disparity
    disparity = at_left[:, 1] - at_right[:, 1]
    plausible = (
        (np.abs(at_left[:, 0] - at_right[:, 0]) <= POSITION_SLACK)
        & (disparity >= -POSITION_SLACK)
        & (disparity <= reach + POSITION_SLACK)
    )
    codes = [
        _sampled_codes(photo, positions[plausible])
        for photo, positions in ((pair.left, at_left), (pair.right, at_right))
    ]
    if pair.main == "right":
        codes.reverse()
    samples = []
    for channel in range(pair.left.channels):
        pairs = np.stack([view[:, channel] for view in codes], axis=1)
        samples.append(pairs[(pairs >= 0).all(axis=1)])
    return samples


def _skimage_feature() -> ModuleType:
    try:
        from skimage import feature
    except ImportError as error:
        raise MissingDependencyError(
            "SIFT samples for the response need scikit-image; install stereohdr[demo], or give a response"
        ) from error
    return feature


def _features(photo: Photo, feature: Any) -> tuple[NDArray[np.float64], NDArray[Any]] | None:
    """Return positions ``(N, 2)`` (row, column) and descriptors, None when there are none."""
    if min(photo.height, photo.width) < SMALLEST_SIDE:
        return None
    luma = code_luma(photo)
    bright = float(np.percentile(luma, BRIGHT_SHARE))
    if bright <= 0:
        return None
    sift = feature.SIFT(upsampling=2 if photo.height * photo.width <= DOUBLED_PIXELS else 1)
    try:
        sift.detect_and_extract(np.minimum(luma / np.float32(bright), np.float32(1)))
    except RuntimeError:  # "SIFT found no features"
        return None
    return sift.positions, sift.descriptors


def _sampled_codes(photo: Photo, positions: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the mean code ``(N, C)`` around each position, 0..255, -1 where the window holds a clipped pixel."""
    y, x = np.rint(positions).astype(np.intp).T
    knots = knot_codes(photo.codes, photo.white)
    clipped = (knots == 0) | (knots == RESPONSE_KNOTS - 1)
    sampled = np.empty((len(positions), photo.channels), dtype=np.intp)
    for channel in range(photo.channels):
        mean = ndimage.uniform_filter(knots[..., channel].astype(np.float64), WINDOW, mode="nearest")
        spoilt = ndimage.maximum_filter(clipped[..., channel], WINDOW, mode="nearest")
        sampled[:, channel] = np.where(spoilt[y, x], -1, np.rint(mean[y, x]).astype(np.intp))
    return sampled
