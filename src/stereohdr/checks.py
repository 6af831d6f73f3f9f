"""Checks on a pair that need its pixels: unusable views, swapped exposures, swapped or unrelated views."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import DEFAULT_DISPARITY_SHARE, ExposureMapConfig
from stereohdr.errors import ExposureError, InputError
from stereohdr.model import Photo, ResponseCurve, StereoPair
from stereohdr.radiance import code_luma, out_of_range


def unusable_view(pair: StereoPair, *, config: ExposureMapConfig | None = None) -> str | None:
    """Return a sentence about a view without a single well-exposed pixel, None if both have some."""
    config = config or ExposureMapConfig()
    for photo in (pair.main_photo, pair.auxiliary_photo):
        luma = code_luma(photo)
        if out_of_range(luma, config=config).all():
            dark = bool((luma < config.under_threshold).all())
            bright = bool((luma > config.over_threshold).all())
            state = "black" if dark else "white" if bright else "black or white"
            return f"{photo.name}: every pixel is {state}, so stereo cannot use it"
    return None


SAME_MATRIX = 0.02
"""Colour matrices of one camera model agree within this; DNG files of two units may differ a little."""


def check_same_camera(pair: StereoPair, response: ResponseCurve | None = None) -> str | None:
    """Check that one response can hold for both photos.

    Parameters
    ----------
    pair
        Photos; only what their files state is looked at.
    response
        A response that the user gives for both, None when there is none.

    Returns
    -------
    A sentence to warn with when the photos come from different cameras, else None.

    Raises
    ------
    InputError
        The photos are raw files of different cameras, or only one of them is linear, and no response is given.
    """
    left, right = pair.left, pair.right
    differ = None not in (left.camera, right.camera) and left.camera != right.camera
    if response is None and left.linear != right.linear:
        linear, other = (left, right) if left.linear else (right, left)
        raise InputError(
            f"{linear.name} is linear sensor data, {other.name} is not; give both photos in the same format"
        )
    if response is None and left.linear and left.colour_matrix is not None and right.colour_matrix is not None:
        differ |= bool(np.abs(left.colour_matrix - right.colour_matrix).max() > SAME_MATRIX)
    if not differ:
        return None
    cameras = (
        f"{left.name} comes from {left.camera or 'one camera'}, {right.name} from {right.camera or 'another'}"
    )
    if response is None and left.linear:
        raise InputError(
            f"{cameras}: their raw codes do not mean the same light; give raw files of two cameras of one model, "
            f"or developed pictures"
        )
    return f"{cameras}; one response is assumed for both, so give two cameras of one model"


def estimated_ratio(pair: StereoPair) -> str | None:
    """Return a sentence when the exposures of the pair are an estimate, else None."""
    if "estimated" not in (pair.left.exposure_source, pair.right.exposure_source):
        return None
    return (
        f"the exposure ratio {pair.exposure_ratio:.3g} was estimated from the photos and is only as good as the "
        f"response that was assumed for it; give the exposure times if you can"
    )


CLEAR_RATIO = 1.5
"""From this exposure ratio on, what one view sees and the other does not cannot outweigh the exposure."""

SMALL_RATIO_SLACK = 8.0
"""Codes (of 255) by which the longer exposure may be darker on average below `CLEAR_RATIO`."""

ORDER_PIXELS = 100_000
"""So many pixels of a photo are compared, at most, at regular distances."""


def check_exposure_order(pair: StereoPair) -> None:
    """Check that the photo of the longer exposure is the brighter one.

    Compares the luma of both photos at the same quantiles, where not both are clipped the same way: the views
    see nearly the same scene, so the longer exposure is brighter there.

    Raises
    ------
    ExposureError
        It is not; the times are probably swapped.
    """
    exposures = pair.exposures
    photos = (pair.main_photo, pair.auxiliary_photo)
    if np.array_equal(photos[0].codes, photos[1].codes):
        raise ExposureError(
            f"{pair.left.name} and {pair.right.name} hold the same picture; give the photos of two cameras"
        )
    short, long = (photos[i] for i in np.argsort(exposures))
    levels = np.linspace(0.05, 0.95, 19)
    step = math.ceil(math.sqrt(short.height * short.width / ORDER_PIXELS))
    dark, bright = (np.quantile(code_luma(photo)[::step, ::step], levels) for photo in (short, long))
    config = ExposureMapConfig()
    clipped = (np.maximum(dark, bright) < config.under_threshold) | (
        np.minimum(dark, bright) > config.over_threshold
    )
    difference = (bright - dark)[~clipped]
    slack = 0.0 if pair.exposure_ratio >= CLEAR_RATIO else SMALL_RATIO_SLACK
    if difference.size and difference.mean() <= -slack:
        raise ExposureError(
            f"the exposures contradict the photos: {long.name} should be the brighter one "
            f"({max(exposures):g} s against {min(exposures):g} s), but {short.name} is at least as bright; "
            f"check that exposures and photos are in the same order, left then right"
        )


def doubtful_white_level(photos: Sequence[Photo]) -> str | None:
    """Return a sentence when 16-bit codes use so few bits that the white level must be lower, else None."""
    highest = max(int(photo.codes.max()) for photo in photos)
    bits = max(10, highest.bit_length())
    if min(photo.white for photo in photos) < 65535 or bits > 14:
        return None
    return (
        f"the highest of the 16-bit codes is {highest}; if the camera delivers {bits} bits, give the white level "
        f"{2**bits - 1} (command line: --white-level), or clipped pixels go unnoticed"
    )


VIEW_CHECK_WIDTH = 160
"""Width in pixels to which the views are reduced before they are compared."""

VIEW_CHECK_SMALLEST = (40, 96)
"""Rows and columns below which a reduced view says too little."""

SWAPPED_MARGIN = 0.15
"""The wrong order must win by this share of confirmed matches. Of 38 true pairs (three real ones, twelve scenes
re-exposed 16:1) the right order won by 0.23 or more; of ten unrelated pairs neither won by more than 0.04."""

UNRELATED_SHARE = 0.6
"""Below this share of confirmed matches, with the orders `UNRELATED_MARGIN` apart, the views are unrelated."""

UNRELATED_MARGIN = 0.1
"""See `UNRELATED_SHARE`."""


def check_views(pair: StereoPair) -> str | None:
    """Check that the left photo is the left view, and that the views show the same scene.

    Both views are reduced and matched twice, as they are and mirrored, which is the same as exchanged: only
    the right order finds partners at ``x_left = x_right + d`` with ``d >= 0``.

    Returns
    -------
    A sentence to warn with when the views hardly match in either order, else None.

    Raises
    ------
    InputError
        The views match much better when exchanged.
    """
    from stereohdr.disparity.consistency import consistent_share

    factor = max(1, round(pair.left.width / VIEW_CHECK_WIDTH))
    lumas = [code_luma(photo) for photo in (pair.left, pair.right)]
    left, right = (_reduced(luma, factor) for luma in lumas)
    usable_left, usable_right = (_reduced(out_of_range(luma).astype(np.float32), factor) < 0.5 for luma in lumas)
    height, width = left.shape
    if height < VIEW_CHECK_SMALLEST[0] or width < VIEW_CHECK_SMALLEST[1]:
        return None
    reach = round(DEFAULT_DISPARITY_SHARE * width)
    in_order = consistent_share(left, right, usable_left, usable_right, max_disparity=reach)
    exchanged = consistent_share(
        left[:, ::-1], right[:, ::-1], usable_left[:, ::-1], usable_right[:, ::-1], max_disparity=reach
    )
    if exchanged > in_order + SWAPPED_MARGIN:
        raise InputError(
            f"{pair.left.name} and {pair.right.name} look exchanged: {100 * exchanged:.0f} % of the matches are "
            f"confirmed with left and right swapped, {100 * in_order:.0f} % as given; give the photo of the left "
            f"camera first"
        )
    if in_order < UNRELATED_SHARE and abs(in_order - exchanged) < UNRELATED_MARGIN:
        return (
            f"{pair.left.name} and {pair.right.name} hardly match ({100 * in_order:.0f} % of the matches are "
            f"confirmed, about what chance gives); check that they are rectified photos of the same scene"
        )
    return None


def _reduced(image: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Return block means of `factor` x `factor` pixels."""
    height, width = (size // factor for size in image.shape)
    rows = image[: height * factor, : width * factor].reshape(height, factor, width * factor).mean(axis=1)
    return rows.reshape(height, width, factor).mean(axis=2)
