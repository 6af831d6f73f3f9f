"""Colour encodings: pixel values to linear channels of absolute scale."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ConfigError, InputError, StereoHdrWarning

ENCODINGS: dict[str, int | None] = {
    "luminance": 1,
    "luma-display": 1,
    "sRGB-display": 3,
    "rgb-bt.709": 3,
    "XYZ": 3,
    "generic": None,
}
"""Encodings by name, with their number of channels; None: any.

``luminance``: cd/m^2. ``luma-display``: gamma 2.2 codes 0..1 of a display from 1 to 100 cd/m^2. ``sRGB-display``:
sRGB codes 0..1 of such a display. ``rgb-bt.709``: linear, scaled so that the luminance is in cd/m^2. ``XYZ``: CIE
1931, Y in cd/m^2. ``generic``: linear channels of which `HdrVdp2Options.spectral_responses` tells the spectra.
"""

_DISPLAY_CODES = ("luma-display", "sRGB-display")

_RGB_OF_XYZ = (
    (3.240708, -1.537259, -0.498570),
    (-0.969257, 1.875995, 0.041555),
    (0.055636, -0.203996, 1.057069),
)

NAN_REPLACEMENT = 1e-5
"""Value of linear channels, cd/m^2, where a pixel is NaN."""


def linear_channels(image: NDArray[Any], encoding: str, *, name: str) -> NDArray[np.float64]:
    """Return the linear channels of an image.

    Parameters
    ----------
    image
        ``(H, W)`` or ``(H, W, C)`` real numbers in the unit of the encoding.
    encoding
        Key of `ENCODINGS`.
    name
        How messages call the image.

    Returns
    -------
    ``(C, H, W)`` float64; pixels that are NaN are `NAN_REPLACEMENT`, with a warning.

    Raises
    ------
    ConfigError
        Unknown encoding.
    InputError
        The image has the wrong number of dimensions or channels, is not numeric, or has values that the encoding
        does not allow: negative, infinite, or codes above 1.
    """
    if encoding not in ENCODINGS:
        raise ConfigError(f"encoding must be one of {', '.join(ENCODINGS)}, got {encoding!r}")
    values = np.asarray(image)
    if values.dtype.kind not in "fiub":
        raise InputError(f"the {name} image must hold real numbers, got an array of {values.dtype}")
    if values.ndim == 2:
        values = values[..., None]
    expected = ENCODINGS[encoding]
    if values.ndim != 3 or values.shape[2] == 0 or expected not in (None, values.shape[2]):
        wanted = {None: "(H, W, C)", 1: "(H, W)", 3: "(H, W, 3)"}[expected]
        raise InputError(
            f"the {name} image must have the shape {wanted} for the encoding {encoding!r}, got {np.shape(image)}"
        )
    channels = np.ascontiguousarray(np.moveaxis(values, 2, 0), dtype=np.float64)
    _check_range(channels, encoding, name)

    if encoding == "luma-display":
        channels = 99.0 * channels**2.2 + 1.0
    elif encoding == "sRGB-display":
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        channels = 99.0 * linear + 1.0
    elif encoding == "XYZ":
        x, y, z = channels
        channels = np.stack([a * x + b * y + c * z for a, b, c in _RGB_OF_XYZ])
    return _without_nan(channels, name)


def warn_if_relative(test: NDArray[np.float64], encoding: str) -> None:
    """Warn if the test image, ``(C, H, W)`` linear channels, is so dark that it is probably not in cd/m^2."""
    if encoding in _DISPLAY_CODES:
        return
    brightest = float(test[min(1, len(test) - 1)].max())
    if brightest <= 1.0:
        warnings.warn(
            f"the test image reaches only {brightest:.3g} cd/m^2; HDR-VDP-2 needs absolute luminance, check that "
            f"the values are not relative",
            StereoHdrWarning,
            stacklevel=3,
        )


def _check_range(channels: NDArray[np.float64], encoding: str, name: str) -> None:
    low, high = float(np.fmin.reduce(channels, axis=None)), float(np.fmax.reduce(channels, axis=None))
    if low < 0:
        raise InputError(f"the {name} image must not be negative (encoding {encoding!r}), got {low:g}")
    if encoding in _DISPLAY_CODES and high > 1:
        raise InputError(f"the {name} image must be 0 to 1 for the encoding {encoding!r}, got {high:g}")
    if np.isinf(high):
        raise InputError(f"the {name} image must be finite, got infinite values")


def _without_nan(channels: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    unknown = np.isnan(channels)
    if unknown.any():
        count = int(unknown.any(axis=0).sum())
        warnings.warn(
            f"the {name} image is NaN at {count} pixels; they are taken as {NAN_REPLACEMENT:g} cd/m^2",
            StereoHdrWarning,
            stacklevel=4,
        )
        return np.where(unknown, NAN_REPLACEMENT, channels)
    return channels
