"""A forward camera model: from scene radiance to the codes that a camera would have delivered.

The chain is the one of a real sensor, in this order::

    radiance E -> exposure X = E t -> photo-electrons (shot noise) -> read noise -> full well clips
               -> response f -> pedestal -> quantisation -> code z

`Camera.response_curve` is the true inverse of the chain, in the convention of the curves that the rest of the
package estimates, so that an estimated response can be compared with the truth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ExposureError, InputError
from stereohdr.model import MID_KNOT, RESPONSE_KNOTS, Photo, ResponseCurve, StereoPair, View

Response = Literal["linear", "gamma", "srgb", "s-shaped"]
"""The responses that a `Camera` can have."""

S_SHAPE_CONTRAST = 1.4
"""Exponent p of the S-shaped response; 1 is a plain gamma curve, larger is steeper in the middle."""

DITHER = 0.4999
"""Half width of the dither of `reexpose_codes` in codes: just below half a code, so that the rounding of the
radiance to float32 cannot carry a value into the neighbouring code."""

MOST_ELECTRONS = 1e15
"""Mean electron counts are cut here before the shot noise is drawn: far above any full well, and safely inside
what the Poisson generator accepts."""

ValueT = TypeVar("ValueT")


@dataclass(frozen=True)
class Camera:
    """A simulated camera.

    Raises
    ------
    InputError
        A value is out of range, or a response is unknown.
    """

    response: Response | tuple[Response, ...] = "srgb"
    """Response f from exposure (0..1 of the full well) to code (0..1 of the range): one for all channels, or
    one per channel. ``linear``: ``f(X) = X``. ``gamma``: ``f(X) = X ** (1 / gamma)``. ``srgb``: IEC 61966-2-1.
    ``s-shaped``: ``v ** p / (v ** p + (1 - v) ** p)`` of ``v = X ** (1 / gamma)``, p = `S_SHAPE_CONTRAST`: a toe
    and a soft shoulder, as cameras that render pictures have."""
    gamma: float | tuple[float, ...] = 2.2
    """Exponent of ``gamma`` and ``s-shaped``, one or one per channel, > 0."""
    full_well: float = 12000.0
    """Electrons at which a pixel saturates, > 0. Exposure X = 1 fills it."""
    read_noise: float = 4.0
    """Standard deviation of the read noise in electrons, >= 0."""
    black_level: int = 0
    """Pedestal in codes, added before quantisation, at least 0 and below the white level. The codes that
    `expose` returns still carry it: no light gives this code (not 0), full well gives the white level, and read
    noise below zero survives as codes below the pedestal."""
    bits: int = 8
    """Bits per code, 8 to 16. 8 gives uint8; more give uint16 with white level ``2 ** bits - 1``."""
    noise: bool = True
    """False switches shot noise and read noise off: what remains is clipping and quantisation."""

    def __post_init__(self) -> None:
        for name in _as_tuple(self.response):
            if name not in get_args(Response):
                raise InputError(f"camera response must be one of {', '.join(get_args(Response))}, got {name!r}")
        for exponent in _as_tuple(self.gamma):
            _require(math.isfinite(exponent) and exponent > 0, "gamma", exponent, "a positive number")
        _require(
            math.isfinite(self.full_well) and self.full_well > 0,
            "full_well",
            self.full_well,
            "a positive number of electrons",
        )
        _require(
            math.isfinite(self.read_noise) and self.read_noise >= 0,
            "read_noise",
            self.read_noise,
            "a number of electrons >= 0",
        )
        _require(isinstance(self.bits, int | np.integer) and 8 <= self.bits <= 16, "bits", self.bits, "8 to 16")
        _require(
            isinstance(self.black_level, int | np.integer) and 0 <= self.black_level < self.white_level,
            "black_level",
            self.black_level,
            f"a whole code from 0 to {self.white_level - 1}",
        )

    @property
    def white_level(self) -> int:
        """The code at which the camera clips, ``2 ** bits - 1``."""
        return 2**self.bits - 1

    def response_curve(self, channels: int = 3) -> ResponseCurve:
        """Return the true inverse response of this camera.

        Parameters
        ----------
        channels
            1 (grey) or 3 (RGB).

        Returns
        -------
        ln X at 256 codes evenly spaced from 0 to the white level, 0 at knot 128; X is relative, as in every
        `ResponseCurve`.

        Raises
        ------
        InputError
            `channels` is not 1 or 3, or the camera has responses for another number of channels.

        Notes
        -----
        The code without light stands for everything that rounds to it and gets the exposure of half a knot,
        as in `ResponseCurve.gamma`. Codes below a pedestal hold nothing but noise; the curve falls by ln 2 per
        knot there, which keeps it finite and strictly monotone.
        """
        if channels not in (1, 3):
            raise InputError(f"a camera has 1 or 3 channels, got {channels}")
        knot = self.white_level / (RESPONSE_KNOTS - 1)  # codes
        codes = np.arange(RESPONSE_KNOTS) * knot
        value_range = self.white_level - self.black_level
        fraction = (codes - self.black_level) / value_range
        knots_below_black = np.maximum(self.black_level - codes, 0.0) / knot
        fraction = np.maximum(fraction, 0.5 * knot / value_range)
        curve = np.stack(
            [
                np.log(_inverse_response(fraction, name, exponent)) - math.log(2.0) * knots_below_black
                for name, exponent in self._channel_responses(channels)
            ]
        )
        return ResponseCurve(curve - curve[:, MID_KNOT : MID_KNOT + 1])

    def _channel_responses(self, channels: int) -> list[tuple[str, float]]:
        names = _per_channel(self.response, channels, "response")
        exponents = _per_channel(self.gamma, channels, "gamma")
        return list(zip(names, exponents, strict=True))


def expose(
    radiance: NDArray[Any],
    exposure_time: float,
    camera: Camera,
    seed: int | np.random.SeedSequence,
    *,
    name: str = "photo",
) -> Photo:
    """Take one photo.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float, relative, finite, >= 0; C is 1 or 3. Radiance times `exposure_time` is the exposure
        X, and X = 1 fills the pixel.
    exposure_time
        Seconds, > 0.
    camera
        The camera.
    seed
        Seed of the noise, >= 0. The same seed gives the same codes (with the same version of NumPy).
    name
        What messages call the photo.

    Returns
    -------
    A photo of ``(H, W, C)`` codes, uint8 for 8 bits, else uint16, with the exposure time and white level set.

    Raises
    ------
    InputError
        The radiance has a wrong shape or holds negative or non-finite values; the camera has responses for
        another number of channels; the seed is negative.
    ExposureError
        The exposure time is not a positive number.

    Notes
    -----
    Read noise can push a dark pixel below zero. The response is continued there as an odd function,
    ``f(-X) = -f(X)``, so that a pedestal (`Camera.black_level`) keeps the noise whole, as real raw data do;
    without a pedestal such pixels become code 0.
    """
    radiance = np.asarray(radiance)
    if radiance.ndim != 3 or radiance.shape[2] not in (1, 3) or radiance.size == 0:
        raise InputError(f"{name}: radiance must have shape (H, W, 1) or (H, W, 3), got {radiance.shape}")
    if not np.issubdtype(radiance.dtype, np.floating):
        raise InputError(f"{name}: radiance must be floating point, got {radiance.dtype}")
    if not np.isfinite(radiance).all():
        raise InputError(f"{name}: radiance must be finite, but it holds NaN or infinity")
    if (radiance < 0).any():
        raise InputError(f"{name}: radiance must be >= 0, but its smallest value is {radiance.min():g}")
    if not (math.isfinite(exposure_time) and exposure_time > 0):
        raise ExposureError(f"{name}: exposure time must be a positive number, got {exposure_time}")
    responses = camera._channel_responses(radiance.shape[2])

    with np.errstate(over="ignore"):  # a radiance that overflows saturates like any other bright one
        electrons = radiance.astype(np.float64) * (exposure_time * camera.full_well)
    if camera.noise:
        generator = np.random.default_rng(_checked_seed(seed))
        electrons = generator.poisson(np.minimum(electrons, MOST_ELECTRONS)).astype(np.float64)
        electrons += generator.normal(0.0, camera.read_noise, electrons.shape)
    exposure = np.minimum(electrons / camera.full_well, 1.0)

    value_range = camera.white_level - camera.black_level
    codes = np.empty(exposure.shape, np.uint16)
    for channel, (response, exponent) in enumerate(responses):
        signal = exposure[..., channel]
        fraction = np.copysign(_response(np.abs(signal), response, exponent), signal)
        # Round half up (np.rint would round half to even, which has no counterpart in a converter).
        code = np.floor(camera.black_level + value_range * fraction + 0.5)
        codes[..., channel] = np.clip(code, 0, camera.white_level)
    if camera.bits == 8:
        codes = codes.astype(np.uint8)
    return Photo(codes=codes, exposure_time=exposure_time, white_level=camera.white_level, name=name)


def expose_pair(
    radiance_main: NDArray[Any],
    radiance_auxiliary: NDArray[Any],
    exposures: tuple[float, float],
    camera: Camera,
    seed: int,
    *,
    main: View = "left",
) -> StereoPair:
    """Take a stereo pair of photos at two exposures, each with its own noise.

    Parameters
    ----------
    radiance_main, radiance_auxiliary
        ``(H, W, C)`` float, relative radiance of the main and of the auxiliary view; same size.
    exposures
        Exposure times ``(main, auxiliary)`` in seconds.
    camera
        The camera, the same for both views.
    seed
        Seed of the noise, >= 0.
    main
        Which camera is the main view.

    Returns
    -------
    The pair; its photos are named ``left`` and ``right``.

    Raises
    ------
    InputError
        See `expose`; or the views differ in size.
    ExposureError
        An exposure time is not a positive number, or both are the same.
    """
    if main not in ("left", "right"):
        raise InputError(f"main view must be 'left' or 'right', got {main!r}")
    auxiliary: View = "right" if main == "left" else "left"
    seed_main, seed_auxiliary = _checked_seed(seed).spawn(2)
    photos = {
        main: expose(radiance_main, exposures[0], camera, seed_main, name=main),
        auxiliary: expose(radiance_auxiliary, exposures[1], camera, seed_auxiliary, name=auxiliary),
    }
    return StereoPair(left=photos["left"], right=photos["right"], main=main)


def reexpose_codes(codes: NDArray[np.uint8], *, gamma: float = 2.2, seed: int) -> NDArray[np.float32]:
    """Turn an 8-bit image into radiance that can be taken as true and exposed again.

    Each code stands for all the values that round to it; a seeded dither picks one of them, so that the
    radiance is not a comb of 256 values.

    Parameters
    ----------
    codes
        ``(H, W, C)`` or ``(H, W)`` uint8.
    gamma
        Exponent that linearises the codes, > 0.
    seed
        Seed of the dither, >= 0.

    Returns
    -------
    ``(H, W, C)`` float32 in [0, 1], relative radiance, 1 at code 255. Exposed for 1 s by a camera without noise
    and with the same gamma response, it gives back the codes exactly.

    Raises
    ------
    InputError
        Wrong dtype or shape, or gamma is not a positive number.
    """
    codes = np.asarray(codes)
    if codes.dtype != np.uint8:
        raise InputError(f"codes to re-expose must be uint8, got {codes.dtype}")
    if codes.ndim == 2:
        codes = codes[..., None]
    if codes.ndim != 3 or codes.size == 0:
        raise InputError(f"codes to re-expose must have shape (H, W) or (H, W, C), got {codes.shape}")
    if not (math.isfinite(gamma) and gamma > 0):
        raise InputError(f"gamma must be a positive number, got {gamma}")
    generator = np.random.default_rng(_checked_seed(seed))
    values = codes + generator.uniform(-DITHER, DITHER, codes.shape)
    values = np.abs(values)  # below code 0 there is nothing: fold the dither back
    values = np.where(values > 255.0, 510.0 - values, values)  # and above code 255 likewise
    return ((values / 255.0) ** gamma).astype(np.float32)


def _response(exposure: NDArray[np.float64], name: str, exponent: float) -> NDArray[np.float64]:
    """Return ``f(X)`` in 0..1 for exposures X in 0..1 (and, for noise, a little beyond)."""
    exposure = np.minimum(exposure, 1.0)
    if name == "linear":
        return exposure
    if name == "srgb":
        return np.where(exposure <= 0.0031308, 12.92 * exposure, 1.055 * exposure ** (1 / 2.4) - 0.055)
    value = exposure ** (1.0 / exponent)
    return _s_curve(value, S_SHAPE_CONTRAST) if name == "s-shaped" else value


def _inverse_response(fraction: NDArray[np.float64], name: str, exponent: float) -> NDArray[np.float64]:
    """Return the exposure X in 0..1 that gives a code of this fraction (0..1) of the code range."""
    if name == "linear":
        return fraction
    if name == "srgb":
        return np.where(fraction <= 0.04045, fraction / 12.92, ((fraction + 0.055) / 1.055) ** 2.4)
    if name == "s-shaped":
        fraction = _s_curve(fraction, 1.0 / S_SHAPE_CONTRAST)
    return fraction**exponent


def _s_curve(value: NDArray[np.float64], contrast: float) -> NDArray[np.float64]:
    """Return ``v^p / (v^p + (1 - v)^p)``; the same function with 1 / p is its inverse."""
    rising = value**contrast
    return rising / (rising + (1.0 - value) ** contrast)


def _as_tuple(value: ValueT | tuple[ValueT, ...]) -> tuple[ValueT, ...]:
    return value if isinstance(value, tuple) else (value,)


def _per_channel(value: ValueT | tuple[ValueT, ...], channels: int, name: str) -> Sequence[ValueT]:
    if not isinstance(value, tuple):
        return (value,) * channels
    if len(value) != channels:
        raise InputError(f"camera {name} is given for {len(value)} channel(s), the image has {channels}")
    return value


def _checked_seed(seed: int | np.random.SeedSequence) -> np.random.SeedSequence:
    if isinstance(seed, np.random.SeedSequence):
        return seed
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"the seed must be a whole number >= 0, got {seed!r}")
    return np.random.SeedSequence(int(seed))


def _require(condition: bool, name: str, value: object, accepted: str) -> None:
    if not condition:
        raise InputError(f"camera {name} must be {accepted}, got {value!r}")
