"""One HDR image from a bracket: photos of a still scene from one place, at several exposures."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereohdr.camera_colour import to_bt709, white_balanced
from stereohdr.checks import doubtful_white_level
from stereohdr.errors import ResponseError, StereoHdrWarning
from stereohdr.model import RESPONSE_KNOTS, Photo, ResponseCurve
from stereohdr.response.bracket import USED_CODES, bracket_exposures, check_bracket, estimate_bracket_response

Codes = NDArray[np.uint8] | NDArray[np.uint16]

_ROWS = 256
"""Rows that are merged at a time, to keep the float64 sums of large photos small."""


def merge_bracket(
    photos: Sequence[Photo], *, response: ResponseCurve | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Merge a bracket into one HDR image.

    Each channel of each pixel is ``E = sum w(z) X(z) / sum w(z) t`` over the photos: exposure ``X = exp(g(z))``,
    effective time t, and the hat weight ``w(z) = min(z, white - z)``, which vanishes at both clip points, so that
    no clipped code leaks in. A photo is left out where another one contradicts it: where a shorter exposure is
    white or nearly so (code >= 250 of 255), and where a longer one is black or nearly so (code <= 2).

    Parameters
    ----------
    photos
        Two or more registered photos ``(H, W, C)`` of equal size, channels and white level, 8 to 16 bits, each
        with its own exposure time; ISO and f-number count when all photos state them. In any order.
    response
        The camera's response with C channels. When None, that of the first photo where all photos bring one
        (camera raw files; the radiance is then converted to BT.709), else it is estimated from the bracket.

    Returns
    -------
    radiance
        ``(H, W, C)`` float32, linear, positive, relative (1 / seconds, at the first photo's ISO and f-number).
    clipped
        ``(H, W)`` bool, True where no photo has a usable code in some channel. Such a channel takes the nearest
        bound that the photos give: white in all, the radiance of the last code below white in the shortest
        exposure; black in all, that of code 1 in the longest; both kinds, the geometric mean of the two bounds.

    Raises
    ------
    InputError, ExposureError
        The photos are no bracket, see `stereohdr.response.bracket.check_bracket`.
    ResponseError
        `response` has another channel count, or the bracket does not determine one.

    Warns
    -----
    StereoHdrWarning
        16-bit photos that use 14 bits or fewer and state no white level.

    Notes
    -----
    Source: the weights of Debevec and Malik 1997, times the exposure time: photon noise gives the radiance X / t
    of one photo a variance of E / t. So the mean is one of radiances, not of their logarithms as in their
    equation 6: there, a slightly too dark code of a long exposure (a 254 that compression left in a white area)
    pulls a highlight down by a share of many stops, while in a mean of radiances it counts for little. Against
    the opposite fault, dark codes of short exposures that noise made too bright, stand the time in the weight and
    the rule of contradiction. For a simulated sRGB camera and three or eight photos they more than halve the error
    in the dark that plain hat weights leave in either domain; for a linear 8-bit one it falls by a tenth.
    """
    check_bracket(photos)
    doubt = doubtful_white_level(photos)
    if doubt is not None:
        warnings.warn(doubt, StereoHdrWarning, stacklevel=2)
    in_camera_colours = response is None and all(photo.linear for photo in photos)
    if in_camera_colours:
        photos = white_balanced(photos, as_in=photos[0])
        response = photos[0].response
    first = photos[0]
    if response is None:
        response = estimate_bracket_response(photos)
    elif response.channels != first.channels:
        raise ResponseError(
            f"the response curve has {response.channels} channel(s), {first.name} has {first.channels}; "
            f"give a response of the same camera and mode"
        )
    exposures = bracket_exposures(photos)
    order = np.argsort(exposures)
    times = [exposures[i] for i in order]
    tables = response.exposure_table(first.white)

    radiance = np.empty(first.codes.shape, np.float32)
    clipped = np.zeros(radiance.shape[:2], bool)
    for start in range(0, first.height, _ROWS):
        rows = slice(start, start + _ROWS)
        for channel, table in enumerate(tables):
            seen = [photos[i].codes[rows, :, channel] for i in order]
            radiance[rows, :, channel], lost = _merged_channel(seen, times, table)
            clipped[rows] |= lost
    if in_camera_colours:
        radiance = to_bt709(radiance, first.colour_matrix)
    return radiance, clipped


def _merged_channel(
    seen: Sequence[Codes], times: Sequence[float], table: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return radiance and where it is only a bound, for one channel; photos are sorted by time.

    Parameters
    ----------
    seen
        For each photo ``(h, w)`` codes.
    times
        Effective exposure times, ascending.
    table
        ``(white + 1,)`` exposure X of each code.
    """
    white = len(table) - 1
    low, high = (limit * white / (RESPONSE_KNOTS - 1) for limit in USED_CODES)
    codes = np.arange(white + 1)
    hat = np.minimum(codes, white - codes).astype(np.float64)

    usable = [np.ones(z.shape, bool) for z in seen]
    for shorter in range(len(seen) - 1):
        usable[shorter + 1] = usable[shorter] & (seen[shorter] < high)
    allowed = np.ones(seen[0].shape, bool)
    for longer in range(len(seen) - 1, 0, -1):
        allowed = allowed & (seen[longer] > low)
        usable[longer - 1] = usable[longer - 1] & allowed

    exposure, time = np.zeros((2, *seen[0].shape))
    for z, t, use in zip(seen, times, usable, strict=True):
        exposure += np.where(use, (hat * table)[z], 0.0)
        time += np.where(use, (hat * t)[z], 0.0)
    lost = time == 0
    radiance = exposure / np.where(lost, 1.0, time)
    radiance[lost] = _nearest_bound([z[lost] for z in seen], times, table, low, high)
    return radiance, lost


def _nearest_bound(
    seen: Sequence[Codes], times: Sequence[float], table: NDArray[np.float64], low: float, high: float
) -> NDArray[np.float64]:
    """Return the bound of pixels ``(N,)`` without a usable code: what their black and white codes say."""
    white = len(table) - 1
    at_least, at_most = np.zeros(seen[0].shape), np.full(seen[0].shape, np.inf)
    for z, t in zip(seen, times, strict=True):
        value = table[np.clip(z, 1, white - 1)] / t
        at_least = np.where(z >= high, np.maximum(at_least, value), at_least)
        at_most = np.where(z <= low, np.minimum(at_most, value), at_most)
    bounded_below, bounded_above = at_least > 0, np.isfinite(at_most)
    middle = np.sqrt(at_least * np.where(bounded_above, at_most, 1.0))
    return np.where(bounded_below & bounded_above, middle, np.where(bounded_below, at_least, at_most))
