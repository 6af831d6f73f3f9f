"""Bayer mosaics to RGB, with clipped samples that stay recognisable."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ConfigError, InputError

BayerPattern = Literal["RGGB", "BGGR", "GRBG", "GBRG"]
"""Colours of the top left 2x2 pixels, row by row."""

DemosaicMethod = Literal["malvar2004", "bilinear"]
"""Ways to interpolate."""

_CHANNEL = {"R": 0, "G": 1, "B": 2}


def bayer_pattern(text: str) -> BayerPattern:
    """Return the Bayer pattern that `text` names, in upper case.

    Raises
    ------
    ConfigError
        It names none.
    """
    for pattern in get_args(BayerPattern):
        if text.strip().upper() == pattern:
            return pattern
    raise ConfigError(
        f"{text!r} is not a Bayer pattern; give the colours of the top left 2x2 pixels, row by row: "
        f"{', '.join(get_args(BayerPattern))}"
    )


def demosaic(
    mosaic: NDArray[Any],
    pattern: BayerPattern,
    *,
    white_level: int,
    method: DemosaicMethod = "malvar2004",
    name: str = "mosaic",
) -> NDArray[Any]:
    """Interpolate the two missing colours of every pixel of a Bayer mosaic.

    Parameters
    ----------
    mosaic
        ``(H, W)`` uint8 or uint16, codes without pedestal, at least 2x2; the same scale in all colours.
    pattern
        Colours of the top left 2x2 pixels.
    white_level
        Code at which the sensor clips.
    method
        ``malvar2004``: means of the nearest samples, sharpened by the curvature of the colour that was sampled at
        the pixel. ``bilinear``: the means alone.
    name
        What messages call the mosaic.

    Returns
    -------
    ``(H, W, 3)`` codes of the same type. A sample stays as it is. An interpolated code lies between the samples
    that it is the mean of; it is the white level where **any** of them is, so that clipping stays recognisable,
    and nowhere else, with one exception: where such a mean also takes in a sample below half of the white level,
    the pixel straddles a hard edge, and all its channels are white. (One white channel beside two dark ones would
    be a bright coloured dot, and count as well exposed.)

    Raises
    ------
    InputError
        The mosaic is no ``(H, W)`` array of uint8 or uint16 with H and W at least 2.
    ConfigError
        Unknown pattern or method.

    Notes
    -----
    Source: Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color
    images", ICASSP 2004. Three things are ours, because radiance errors count as ratios and clipping must not
    hide. (1) Their gains assume a white-balanced mosaic; here the curvature is scaled by the ratio of the two
    colours' mean codes. (2) The result is bounded by the samples that are averaged: no ringing into the dark.
    (3) Clipped samples bend nothing: the curvature is left out where its own colour is clipped in the 5x5 window.
    """
    mosaic = np.ascontiguousarray(mosaic)
    if mosaic.ndim != 2 or mosaic.dtype not in (np.uint8, np.uint16) or min(mosaic.shape) < 2:
        raise InputError(
            f"{name}: a Bayer mosaic is grey, at least 2x2 pixels, 8 or 16 bits, got shape {mosaic.shape} of "
            f"{mosaic.dtype}; give the raw image"
        )
    if method not in get_args(DemosaicMethod):
        raise ConfigError(f"demosaicing method must be one of {get_args(DemosaicMethod)}, got {method!r}")
    from stereohdr.demosaicing._kernels import interpolate_colours

    colours = np.array([_CHANNEL[letter] for letter in bayer_pattern(pattern)]).reshape(2, 2)
    strength = np.zeros((3, 3))
    if method == "malvar2004":
        levels = _mean_codes(mosaic, colours, white_level)
        strength = levels[:, None] / levels[None, :]
    rgb = np.empty((*mosaic.shape, 3), mosaic.dtype)
    interpolate_colours(mosaic, colours, white_level, strength, rgb)
    return rgb


def _mean_codes(mosaic: NDArray[np.integer], colours: NDArray[np.intp], white_level: int) -> NDArray[np.float64]:
    """Return the mean unclipped code of each colour, at least 1; all equal when a colour has none."""
    total, count = np.zeros(3), np.zeros(3)
    for (y, x), channel in np.ndenumerate(colours):
        samples = mosaic[y::2, x::2]
        unclipped = samples < white_level
        total[channel] += samples.sum(where=unclipped, dtype=np.int64)
        count[channel] += unclipped.sum()
    if not count.all():
        return np.ones(3)
    return np.maximum(total / count, 1.0)
