"""Tone mapping: from linear radiance to 8-bit sRGB codes, for looking at results.

References
----------
Reinhard, Stark, Shirley and Ferwerda 2002, "Photographic tone reproduction for digital images",
doi:10.1145/566654.566575.
Drago, Myszkowski, Annen and Chiba 2003, "Adaptive logarithmic mapping for displaying high contrast scenes",
doi:10.1111/1467-8659.00689.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from stereohdr.errors import ConfigError, InputError
from stereohdr.radiance import REC709

if TYPE_CHECKING:
    from numpy.typing import NDArray

Operator = Literal["reinhard", "log", "linear"]

LINEAR_WHITE_PERCENTILE = 99.0
"""``linear`` without an exposure shows this percentile of the luminance as white."""

_ROWS = 256
"""Rows that are mapped at a time, to keep the float64 copies of large images small."""

Curve = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]


def tonemap(
    radiance: NDArray[Any],
    operator: Operator = "reinhard",
    *,
    key: float = 0.18,
    white: float | None = None,
    bias: float = 0.85,
    exposure: float | None = None,
    saturation: float = 1.0,
) -> NDArray[np.uint8]:
    """Map linear radiance to 8-bit sRGB codes.

    The operator maps the luminance L to a display luminance L_d; each channel C becomes
    ``L_d (C / L) ** saturation``, is clipped to 0..1, and is encoded as sRGB.

    Parameters
    ----------
    radiance
        ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)``, linear, finite, >= 0, any scale; RGB with BT.709 primaries.
    operator
        ``"reinhard"``: the global operator of Reinhard et al. 2002, equations 1 to 4. ``"log"``: the adaptive
        logarithm of Drago et al. 2003, equation 4, on luminance relative to its log-average. ``"linear"``:
        nothing but the exposure, clipped.
    key
        Reinhard: display luminance of the scene's log-average before compression, 0 < key <= 1.
    white
        Reinhard and log: the luminance that becomes white, in the unit of `radiance`, > 0; the largest one
        by default.
    bias
        Log: smaller values brighten the dark parts and compress the highlights more, 0 < bias < 1; the paper
        advises 0.7 to 0.9.
    exposure
        Linear: factor on the radiance, > 0; by default such that the 99th percentile of the luminance is white.
    saturation
        Exponent of the colour ratio, 0 to 10; 0 gives grey, 1 keeps the ratios of the scene.

    Returns
    -------
    ``(H, W, C)`` uint8, C as in `radiance`. Black radiance stays black.

    Raises
    ------
    InputError
        Wrong shape or type, or a value that is negative or not finite.
    ConfigError
        Unknown operator, or a parameter out of range.
    """
    image = _checked(radiance)
    _check_parameters(operator, key, white, bias, exposure, saturation)

    luminance = _luminance(image)
    curve = _curve(operator, luminance, key, white, bias, exposure)
    codes = np.empty(image.shape, np.uint8)
    for top in range(0, image.shape[0], _ROWS):
        rows = slice(top, top + _ROWS)
        seen = luminance[rows, :, None]
        ratio = np.divide(image[rows], seen, out=np.zeros(image[rows].shape), where=seen > 0)
        display = curve(seen) * ratio**saturation
        codes[rows] = np.rint(255.0 * srgb_encode(display)).astype(np.uint8)
    return codes


def srgb_encode(linear: NDArray[Any]) -> NDArray[np.float64]:
    """Return the sRGB code (0..1) of linear light, clipped to 0..1 (IEC 61966-2-1)."""
    light = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def _checked(radiance: NDArray[Any]) -> NDArray[np.float32]:
    given = np.asarray(radiance)
    shaped = given[..., None] if given.ndim == 2 else given
    if given.dtype.kind not in "fiu" or shaped.ndim != 3 or shaped.shape[2] not in (1, 3) or given.size == 0:
        raise InputError(
            f"radiance must be real numbers of shape (H, W), (H, W, 1) or (H, W, 3), got {given.dtype} "
            f"{given.shape}"
        )
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite and is refused below
        image = shaped.astype(np.float32, copy=False)
    wrong = ~(np.isfinite(image) & (image >= 0))
    if wrong.any():
        y, x, channel = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        raise InputError(
            f"radiance must be finite in float32 and not negative to be tone mapped; {np.count_nonzero(wrong)} of "
            f"{wrong.size} values are not, the first is {image[y, x, channel]} at row {y}, column {x}, channel "
            f"{channel}"
        )
    return image


def _check_parameters(
    operator: str, key: float, white: float | None, bias: float, exposure: float | None, saturation: float
) -> None:
    if operator not in get_args(Operator):
        raise ConfigError(f"unknown tone mapping operator {operator!r}; use {', '.join(get_args(Operator))}")
    if not 0 < key <= 1:
        raise ConfigError(f"tone mapping: key must be above 0 and at most 1, got {key}")
    float32 = np.finfo(np.float32)
    for name, value in (("white", white), ("exposure", exposure)):
        if value is not None and not float32.tiny <= value <= float32.max:
            raise ConfigError(f"tone mapping: {name} must be a positive number that float32 holds, got {value}")
    if not 0 < bias < 1:
        raise ConfigError(f"tone mapping: bias must be above 0 and below 1, got {bias}")
    if not 0 <= saturation <= 10:
        raise ConfigError(f"tone mapping: saturation must be a number from 0 to 10, got {saturation}")


def _luminance(image: NDArray[Any]) -> NDArray[np.float64]:
    """Return ``(H, W)`` luminance in double precision: float32 could overflow."""
    if image.shape[2] == 1:
        return image[..., 0].astype(np.float64)
    luminance = np.zeros(image.shape[:2])
    for channel, weight in enumerate(REC709.astype(np.float64)):
        luminance += weight * image[..., channel].astype(np.float64)
    return luminance


def _curve(
    operator: Operator,
    luminance: NDArray[np.float64],
    key: float,
    white: float | None,
    bias: float,
    exposure: float | None,
) -> Curve:
    """Return the function from scene luminance to display luminance."""
    lit = luminance[luminance > 0]
    if lit.size == 0:
        return np.zeros_like
    largest = float(lit.max())
    if operator == "linear":
        if exposure is None:
            exposure = 1.0 / (float(np.percentile(luminance, LINEAR_WHITE_PERCENTILE)) or largest)
        return lambda scene: scene * exposure
    # Equation 1 of Reinhard et al., without its delta: black pixels would make the result depend on the
    # scale of the radiance, so they are left out instead.
    log_average = float(np.exp(np.log(lit).mean()))
    if operator == "reinhard":
        return _reinhard2002(key / log_average, white or largest)
    return _drago2003(1.0 / log_average, white or largest, bias)


def _reinhard2002(scale: float, white: float) -> Curve:
    def curve(scene: NDArray[np.float64]) -> NDArray[np.float64]:
        scaled = scale * scene  # equation 2
        burnt = np.minimum(scene, white) / white
        return (scaled + burnt**2) / (1 + scaled)  # equation 4; at and above the white luminance it is 1

    return curve


def _drago2003(scale: float, white: float, bias: float) -> Curve:
    exponent = math.log(bias) / math.log(0.5)
    range_end = scale * white

    def curve(scene: NDArray[np.float64]) -> NDArray[np.float64]:
        scaled = np.minimum(scale * scene, range_end)
        base = np.log(2 + 8 * (scaled / range_end) ** exponent)
        # Equation 4 for a display whose largest luminance is 1.
        return np.log1p(scaled) / base * (math.log(10.0) / math.log1p(range_end))

    return curve
