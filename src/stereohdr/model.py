"""The things that flow between the stages: photos, pairs, response curves, disparity, results.

Conventions: x right, y down, integer pixel centres; arrays are ``[row y, column x, channel]`` in RGB order,
always with a channel axis (``C`` is 1 for grey, 3 for RGB). Disparity is ``d >= 0`` with
``x_main = x_auxiliary + d`` for a left main view.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from stereohdr.errors import ExposureError, FileFormatError, InputError, ResponseError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stereohdr.config import FuseConfig

View = Literal["left", "right"]

ExposureSource = Literal["given", "file", "estimated"]
"""Where an exposure time comes from: the user, the file's metadata, or the photos themselves."""

RESPONSE_KNOTS = 256
"""Number of evenly spaced codes at which a response curve is stored."""

MID_KNOT = RESPONSE_KNOTS // 2
"""The knot at which ``ln X`` is 0 (Debevec's mid code)."""

LARGEST_LOG_EXPOSURE = 40.0
"""ln X of a response curve stays within plus and minus this, which float32 radiance can hold."""

EXPOSURE_TIME_RANGE = (1e-9, 1e9)
"""Exposure times in seconds that are taken seriously."""

IDENTICAL_EXPOSURE_TOLERANCE = 0.01
"""Two exposures closer than this relative difference count as identical."""


class SourceFlag(IntEnum):
    """Why a pixel of the result has the radiance that it has (`HdrResult.source`)."""

    MEASURED = 0
    """The main view's own radiance, unchanged (weight 0)."""
    AUXILIARY = 1
    """Blended with, or replaced by, radiance that the auxiliary view measured."""
    FILLED_OCCLUDED = 2
    """Restored: no auxiliary pixel was warped to this place."""
    FILLED_REJECTED = 3
    """Restored: the auxiliary pixel warped to this place did not fit the main view and was rejected."""
    NO_INFORMATION = 4
    """Under- or over-exposed, and nothing was restored (or with a negligible weight): the main view's radiance is
    kept."""
    WEIGHT_CUT = 5
    """Well exposed, but inside the soft border of the weight map where no auxiliary radiance exists: the
    main view's radiance is kept."""


class DisparityFlag(IntEnum):
    """Why a pixel of a disparity map has the value that it has (`Disparity.flags`)."""

    NOT_COMPUTED = 0
    """Outside the interest region; the value is 0."""
    MATCHED = 1
    """Found by matching, or known from the scene."""
    OCCLUDED = 2
    """Invisible in the other view. The value is that of the surface seen here where that is known, else that of
    the background beside it."""
    MISMATCHED = 3
    """Matched, but the other view does not confirm it; the value is that of the background beside it."""


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo as the camera delivered it.

    Parameters
    ----------
    codes
        ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)``, uint8 or uint16; stored as ``(H, W, C)``. Codes above
        the white level are stored as the white level.
    exposure_time
        Seconds, or None when unknown.
    white_level
        Code at which the sensor clips; 255 or 65535 by default. Sensors of 10 to 14 bits that are stored in
        uint16 carry theirs here.
    f_number, iso
        Aperture and sensitivity, used when both photos of a pair state them.
    name
        What messages call this photo, usually its file name.
    camera
        Maker and model, None when unknown.
    exposure_source
        Where `exposure_time` comes from, None when nobody said. An estimated time is one of a pair: only its
        ratio to the other one means something.
    response
        Known inverse response of these codes, with C channels; None when it must be estimated. Camera raw files
        bring theirs, a linear one. It is used where both photos of a pair have one.
    full_scale
        Codes of the sensor that the white level stands for, where the response is known; None when it is not. A
        code means the same light in two photos of one sensor, so differing ones count as exposure.
    white_balance
        C positive factors on linear codes that make grey equal in all channels, as shot; None when the codes are
        balanced already, or nothing is known.
    colour_matrix
        ``(3, 3)`` float64 from the camera's white-balanced linear RGB to linear BT.709; None when the codes are
        in display colours already, or nothing is known.

    Raises
    ------
    InputError
        Wrong dtype, shape or white level; a malformed white balance or colour matrix.
    ExposureError
        Exposure time, f-number or ISO is not a positive number.
    """

    codes: NDArray[np.uint8] | NDArray[np.uint16]
    exposure_time: float | None = None
    white_level: int | None = None
    f_number: float | None = None
    iso: float | None = None
    name: str = "photo"
    camera: str | None = None
    exposure_source: ExposureSource | None = None
    response: ResponseCurve | None = None
    full_scale: float | None = None
    white_balance: tuple[float, ...] | None = None
    colour_matrix: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        codes = np.asarray(self.codes)
        if codes.dtype.kind == "u" and not codes.dtype.isnative:
            codes = codes.astype(codes.dtype.newbyteorder("="))
        if codes.dtype not in (np.uint8, np.uint16):
            raise InputError(
                f"{self.name}: codes must be uint8 or uint16 as the camera delivered them, "
                f"got {codes.dtype}; convert the image first"
            )
        if codes.ndim == 2:
            codes = codes[..., None]
        if codes.ndim != 3 or codes.shape[2] not in (1, 3):
            raise InputError(
                f"{self.name}: expected an image of shape (H, W), (H, W, 1) or (H, W, 3), got {codes.shape}"
            )
        if codes.size == 0:
            raise InputError(f"{self.name}: the image is empty, shape {codes.shape}")
        highest = int(np.iinfo(codes.dtype).max)
        white = highest if self.white_level is None else self.white_level
        if not isinstance(white, int | np.integer) or not 3 <= white <= highest:
            raise InputError(f"{self.name}: white level must be 3 to {highest} for {codes.dtype}, got {white}")
        # A copy: the caller may go on using the array.
        codes = np.ascontiguousarray(np.minimum(codes, codes.dtype.type(white)))
        codes.flags.writeable = False
        for name in ("exposure_time", "f_number", "iso"):
            value = getattr(self, name)
            if value is not None:
                try:
                    object.__setattr__(self, name, float(value))
                except (TypeError, ValueError):
                    raise ExposureError(f"{self.name}: {name} must be a number, got {value!r}") from None
        shortest, longest = EXPOSURE_TIME_RANGE
        if self.exposure_time is not None and not shortest <= self.exposure_time <= longest:
            raise ExposureError(
                f"{self.name}: exposure time must be a positive number of seconds from {shortest:g} to "
                f"{longest:g}, got {self.exposure_time}"
            )
        for label, value in (
            ("f-number", self.f_number),
            ("ISO", self.iso),
        ):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ExposureError(f"{self.name}: {label} must be a positive number, got {value}")
        if self.white_balance is not None:
            gains = tuple(float(gain) for gain in self.white_balance)
            if len(gains) != codes.shape[2] or not all(math.isfinite(gain) and gain > 0 for gain in gains):
                raise InputError(
                    f"{self.name}: the white balance of {codes.shape[2]} channel(s) is as many positive factors, "
                    f"got {self.white_balance}"
                )
            object.__setattr__(self, "white_balance", gains)
        if self.colour_matrix is not None:
            matrix = np.array(self.colour_matrix, dtype=np.float64)
            if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
                raise InputError(
                    f"{self.name}: a colour matrix holds 3x3 finite numbers, got shape {matrix.shape}"
                )
            matrix.flags.writeable = False
            object.__setattr__(self, "colour_matrix", matrix)
        object.__setattr__(self, "codes", codes)
        object.__setattr__(self, "white_level", int(white))

    def __repr__(self) -> str:
        time = "unknown exposure" if self.exposure_time is None else f"{self.exposure_time:g} s"
        return (
            f"Photo({self.name!r}, {self.width}x{self.height}x{self.channels}, white {self.white_level}, {time})"
        )

    @property
    def white(self) -> int:
        """The white level as a number (never None once constructed)."""
        assert self.white_level is not None
        return self.white_level

    @property
    def height(self) -> int:
        """Rows."""
        return self.codes.shape[0]

    @property
    def width(self) -> int:
        """Columns."""
        return self.codes.shape[1]

    @property
    def channels(self) -> int:
        """1 (grey) or 3 (RGB)."""
        return self.codes.shape[2]

    @property
    def linear(self) -> bool:
        """Whether the codes are known to be what a linear sensor delivered (its response needs no estimate)."""
        return self.response is not None

    def with_exposure(self, seconds: float) -> Self:
        """Return this photo with another effective exposure time; the codes are shared, not copied."""
        return self._altered(exposure_time=seconds, iso=None, f_number=None, full_scale=None)

    def rows(self, rows: slice) -> Self:
        """Return some rows of this photo; the codes are shared, not copied."""
        return self._altered(codes=self.codes[rows])

    def _altered(self, **values: Any) -> Self:
        """Return this photo with other values, which are not checked again."""
        photo = copy(self)
        for name, value in values.items():
            object.__setattr__(photo, name, value)
        return photo

    def mirrored(self) -> Self:
        """Return this photo with left and right exchanged."""
        return replace(self, codes=self.codes[:, ::-1])


@dataclass(frozen=True, eq=False)
class StereoPair:
    """A rectified pair of photos of one scene at two different exposures.

    Parameters
    ----------
    left, right
        Photos of the left and the right camera; same size and channel count; each with an exposure time.
    main
        The view in which the result is made.

    Raises
    ------
    InputError
        The photos differ in size or channel count, or `main` is unknown.
    ExposureError
        An exposure time is missing, or both exposures are the same.
    """

    left: Photo
    right: Photo
    main: View = "left"

    def __post_init__(self) -> None:
        left, right = self.left, self.right
        for photo in (left, right):
            if not isinstance(photo, Photo):
                raise InputError(f"a pair is made of two Photo objects, got a {type(photo).__name__}")
        if self.main not in ("left", "right"):
            raise InputError(f"main view must be 'left' or 'right', got {self.main!r}")
        if (left.height, left.width) != (right.height, right.width):
            raise InputError(
                f"the two photos differ in size: {left.name} is {left.width}x{left.height}, {right.name} is "
                f"{right.width}x{right.height}; give a rectified pair of equal size"
            )
        if left.channels != right.channels:
            raise InputError(
                f"the two photos differ in channels: {left.name} has {left.channels}, {right.name} has "
                f"{right.channels}; convert both to grey or both to RGB"
            )
        for photo in (left, right):
            if photo.exposure_time is None:
                raise ExposureError(
                    f"{photo.name}: the exposure time is not known; give both times in seconds, left then "
                    f"right (command line: --exposures 1/60 1/15, or --estimate-ratio)"
                )
        t_main, t_auxiliary = self.exposures
        if abs(t_main - t_auxiliary) <= IDENTICAL_EXPOSURE_TOLERANCE * max(t_main, t_auxiliary):
            raise ExposureError(
                f"{left.name} and {right.name} have the same exposure ({t_main:g} s); two different "
                f"exposures are needed to extend the dynamic range"
            )

    @property
    def main_photo(self) -> Photo:
        """The photo of the main view (MV)."""
        return self.left if self.main == "left" else self.right

    @property
    def auxiliary_photo(self) -> Photo:
        """The photo of the auxiliary view (AV)."""
        return self.right if self.main == "left" else self.left

    @property
    def exposures(self) -> tuple[float, float]:
        """Effective exposure times ``(main, auxiliary)`` in seconds.

        The auxiliary time is expressed at the main camera's f-number and ISO when both photos state them:
        exposure value = time x (ISO / 100) / f_number^2. So is a differing `Photo.full_scale`.
        """
        main, auxiliary = self.main_photo, self.auxiliary_photo
        assert main.exposure_time is not None
        assert auxiliary.exposure_time is not None
        t_auxiliary = auxiliary.exposure_time
        if main.iso is not None and auxiliary.iso is not None:
            t_auxiliary *= auxiliary.iso / main.iso
        if main.f_number is not None and auxiliary.f_number is not None:
            t_auxiliary *= (main.f_number / auxiliary.f_number) ** 2
        if main.full_scale is not None and auxiliary.full_scale is not None:
            t_auxiliary *= main.full_scale / auxiliary.full_scale
        return main.exposure_time, t_auxiliary

    @property
    def known_response(self) -> ResponseCurve | None:
        """The response that the main photo brings, None unless both photos bring one."""
        return self.main_photo.response if self.auxiliary_photo.linear else None

    @property
    def exposure_ratio(self) -> float:
        """Longer exposure over shorter exposure, > 1."""
        t_main, t_auxiliary = self.exposures
        return max(t_main, t_auxiliary) / min(t_main, t_auxiliary)

    def mirrored(self) -> Self:
        """Return the pair seen in a mirror: left and right exchanged, every photo flipped.

        A right main view becomes a left one, so that every method is written for a left main view only.
        """
        return replace(
            self,
            left=self.right.mirrored(),
            right=self.left.mirrored(),
            main="left" if self.main == "right" else "right",
        )


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """Inverse camera response ``g``: the natural logarithm of the exposure X that gives each code.

    Parameters
    ----------
    log_exposure
        ``(C, 256)`` float64, ``g`` at 256 codes evenly spaced from 0 to the white level; ``g`` is 0 at knot
        128 by convention. For 8-bit photos a knot is a code. Between knots (deeper codes) the exposure X is
        interpolated linearly.

    Raises
    ------
    ResponseError
        Wrong shape, or a value that is not finite or beyond +-40.

    Notes
    -----
    Source: Debevec and Malik 1997, whose ``g`` this is.
    """

    log_exposure: NDArray[np.float64]

    def __post_init__(self) -> None:
        curve = np.array(self.log_exposure, dtype=np.float64)
        if curve.ndim != 2 or curve.shape[0] not in (1, 3) or curve.shape[1] != RESPONSE_KNOTS:
            raise ResponseError(
                f"a response curve has shape (1, {RESPONSE_KNOTS}) or (3, {RESPONSE_KNOTS}), got {curve.shape}"
            )
        if not (np.abs(curve) <= LARGEST_LOG_EXPOSURE).all():
            raise ResponseError(
                f"a response curve must be finite and within +-{LARGEST_LOG_EXPOSURE:g} at every code"
            )
        curve.flags.writeable = False
        object.__setattr__(self, "log_exposure", curve)

    @classmethod
    def srgb(cls, channels: int = 3) -> Self:
        """Return the inverse of the sRGB transfer function (IEC 61966-2-1) for `channels` channels."""
        code = np.arange(RESPONSE_KNOTS) / (RESPONSE_KNOTS - 1)
        code[0] = 0.5 * code[1]  # code 0 stands for everything that rounds to it
        linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
        return cls(np.tile(np.log(linear / linear[MID_KNOT]), (channels, 1)))

    @classmethod
    def gamma(cls, exponent: float = 2.2, channels: int = 3) -> Self:
        """Return the inverse of ``code = X ** (1 / exponent)``; exponent 1 is a linear sensor."""
        if not 0.1 <= exponent <= 10:
            raise ResponseError(f"the exponent of a gamma curve must be from 0.1 to 10, got {exponent}")
        code = np.arange(RESPONSE_KNOTS) / (RESPONSE_KNOTS - 1)
        code[0] = 0.5 * code[1]
        return cls(np.tile(exponent * np.log(code / code[MID_KNOT]), (channels, 1)))

    @classmethod
    def linear(cls, channels: int = 3, *, white_level: int = RESPONSE_KNOTS - 1) -> Self:
        """Return the response of a linear sensor without a pedestal: exposure proportional to the code.

        Parameters
        ----------
        channels
            1 (grey) or 3 (RGB).
        white_level
            Code at which the sensor clips. Code 0 stands for half a code of this scale, so that the codes of a
            deep sensor stay linear, to half a code in the darkest 256th of them.
        """
        exposure = np.arange(RESPONSE_KNOTS) / (RESPONSE_KNOTS - 1)
        exposure[0] = 0.5 / white_level
        return cls(np.tile(np.log(exposure / exposure[MID_KNOT]), (channels, 1)))

    def with_channels(self, channels: int) -> Self:
        """Return the curve for `channels` channels: a grey one is repeated, any other must have as many.

        Raises
        ------
        ResponseError
            It has another number of channels.
        """
        if self.channels not in (1, channels):
            raise ResponseError(
                f"the response curve has {self.channels} channels, the photos have {channels}; "
                f"give a response of the same camera and mode"
            )
        return type(self)(np.broadcast_to(self.log_exposure, (channels, RESPONSE_KNOTS)))

    @property
    def channels(self) -> int:
        """1 (grey) or 3 (RGB)."""
        return self.log_exposure.shape[0]

    @property
    def is_monotone(self) -> bool:
        """Whether every channel increases strictly with the code."""
        return bool((np.diff(self.log_exposure, axis=1) > 0).all())

    def exposure_table(self, white_level: int) -> NDArray[np.float64]:
        """Return the exposure ``X = exp(g)`` of every code, shape ``(C, white_level + 1)``, float64."""
        exposure = np.exp(self.log_exposure)
        if white_level == RESPONSE_KNOTS - 1:
            return exposure
        position = np.linspace(0.0, RESPONSE_KNOTS - 1, white_level + 1)
        knots = np.arange(RESPONSE_KNOTS)
        return np.stack([np.interp(position, knots, channel) for channel in exposure])

    def apply(self, codes: NDArray[Any], white_level: int) -> NDArray[np.float32]:
        """Return the exposure X of every pixel.

        Parameters
        ----------
        codes
            ``(H, W, C)`` integers from 0 to `white_level`; C as in the curve.
        white_level
            The code at which the sensor clips.

        Returns
        -------
        ``(H, W, C)`` float32, relative exposure, 1 at the mid code.
        """
        if codes.shape[-1] != self.channels:
            raise ResponseError(
                f"the response curve has {self.channels} channel(s), the image has {codes.shape[-1]}"
            )
        table = self.exposure_table(white_level).astype(np.float32)
        exposure = np.empty(codes.shape, dtype=np.float32)
        for c in range(self.channels):
            exposure[..., c] = table[c][codes[..., c]]
        return exposure

    def save(self, path: str | Path) -> None:
        """Write the curve as JSON (see `load`)."""
        from stereohdr.io.files import atomic_path

        document = {
            "format": "stereohdr response",
            "version": 1,
            "unit": "ln exposure at 256 codes evenly spaced from 0 to the white level, 0 at knot 128",
            "channels": ["grey"] if self.channels == 1 else ["red", "green", "blue"],
            "log_exposure": self.log_exposure.tolist(),
        }
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a curve that `save` wrote.

        Raises
        ------
        FileFormatError
            The file cannot be read or is not a response curve.
        """
        try:
            document = json.loads(Path(path).read_text(encoding="utf-8"))
            if document["format"] != "stereohdr response":
                raise KeyError("format")
            return cls(np.array(document["log_exposure"], dtype=np.float64))
        except OSError as error:
            raise FileFormatError(
                f"{path}: cannot read the response curve ({error.strerror}); check the name"
            ) from error
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            reason = str(error) if isinstance(error, ResponseError) else "not a stereohdr response file"
            raise FileFormatError(f"{path}: {reason}; write one with ResponseCurve.save") from error


@dataclass(frozen=True, eq=False)
class Disparity:
    """A disparity map and why each value is what it is.

    Parameters
    ----------
    values
        ``(H, W)`` float32, pixels, ``x_main = x_auxiliary + d``, negative only where rectification left it so; 0
        where nothing was computed.
    flags
        ``(H, W)`` uint8 of `DisparityFlag`.
    """

    values: NDArray[np.float32]
    flags: NDArray[np.uint8]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """``(H, W)`` bool, True where the disparity is known."""
        return self.flags != DisparityFlag.NOT_COMPUTED

    def mirrored(self) -> Self:
        """Return the map with left and right exchanged (values keep their sign: see the conventions)."""
        return replace(self, values=self.values[:, ::-1].copy(), flags=self.flags[:, ::-1].copy())


@dataclass(frozen=True, eq=False)
class HdrResult:
    """What a method delivers, in the main view's pixels unless said otherwise.

    Parameters
    ----------
    radiance
        ``(H, W, C)`` float32, linear, relative, positive and finite; BT.709 primaries are assumed for RGB.
    source
        ``(H, W)`` uint8 of `SourceFlag`.
    weight
        ``(H, W)`` float32, 0..1, share of the restored auxiliary radiance (W of equation 12).
    disparity
        Disparity of the auxiliary view, in the auxiliary view's pixels (D_a).
    response
        The response curve that was used.
    method
        Name of the method.
    config
        The effective configuration.
    statistics
        Shares (0..1) and ranges for reports: ``clipped_share``, ``interest_share``, ...
    seconds
        Wall time by stage, in the order in which the stages ran.
    stages
        Every intermediate array by name, in order; empty unless asked for.
    warnings
        Sentences that the user should read.
    versions
        Versions of stereohdr and of the packages that shape the result.
    exposures
        Effective exposure times ``(main, auxiliary)`` in seconds.
    main
        Which camera the result belongs to.
    main_disparity
        Disparity of the main view, in its pixels; None when the method does not make one.
    confidence
        ``(H, W)`` float32, 0..1, how sure `main_disparity` is; None when the method does not say.
    rectification
        How the photos were rectified and how well that fits, see `stereohdr.rectification.rectify_pair`; None when
        they were taken as they are.
    """

    radiance: NDArray[np.float32]
    source: NDArray[np.uint8]
    weight: NDArray[np.float32]
    disparity: Disparity
    response: ResponseCurve
    method: str
    config: FuseConfig
    statistics: Mapping[str, float] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    stages: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    exposures: tuple[float, float] = (math.nan, math.nan)
    main: View = "left"
    main_disparity: Disparity | None = None
    confidence: NDArray[np.float32] | None = None
    rectification: Mapping[str, Any] | None = None

    def __repr__(self) -> str:
        height, width, channels = self.radiance.shape
        return f"HdrResult(method {self.method!r}, {width}x{height}x{channels}, main view {self.main})"

    def mirrored(self) -> Self:
        """Return the result seen in a mirror; undoes `StereoPair.mirrored`."""
        return replace(
            self,
            radiance=self.radiance[:, ::-1].copy(),
            source=self.source[:, ::-1].copy(),
            weight=self.weight[:, ::-1].copy(),
            disparity=self.disparity.mirrored(),
            stages={name: array[:, ::-1].copy() for name, array in self.stages.items()},
            main="left" if self.main == "right" else "right",
            main_disparity=self.main_disparity and self.main_disparity.mirrored(),
            confidence=None if self.confidence is None else self.confidence[:, ::-1].copy(),
        )
