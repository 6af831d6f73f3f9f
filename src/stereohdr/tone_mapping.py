"""Tone mapping: from linear radiance to 8-bit sRGB codes, for looking at results and for SDR base images.

Every operator maps luminance; colours follow with their hue.

References
----------
Reinhard, Stark, Shirley and Ferwerda 2002, "Photographic tone reproduction for digital images",
doi:10.1145/566654.566575.
Drago, Myszkowski, Annen and Chiba 2003, "Adaptive logarithmic mapping for displaying high contrast scenes",
doi:10.1111/1467-8659.00689.
Mai, Mansour, Mantiuk, Nasiopoulos, Ward and Heidrich 2011, "Optimizing a tone curve for backward-compatible high
dynamic range image and video compression", doi:10.1109/TIP.2010.2095866.
Narkowicz 2015, "ACES filmic tone mapping curve", a fit of the curve of the Academy Color Encoding System.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from stereohdr.errors import ConfigError, InputError
from stereohdr.radiance import REC709

if TYPE_CHECKING:
    from numpy.typing import NDArray

Operator = Literal["reinhard", "reinhard-local", "drago", "mai", "filmic", "log", "linear"]

LINEAR_WHITE_PERCENTILE = 99.0
"""``linear`` without a white shows this percentile of the luminance as white."""

LARGEST_EXPOSURE = 30.0
"""Stops by which a picture may be brightened or darkened."""

LOCAL_SCALES = 1.6 ** np.arange(9)
"""``reinhard-local``: sizes of the areas that are compared, pixels (Reinhard et al.: 8 pairs, factor 1.6)."""

LOCAL_THRESHOLD = 0.05
"""``reinhard-local``: contrast at which a surrounding is taken to hold an edge, epsilon of equation 8."""

LOCAL_SHARPENING = 8.0
"""``reinhard-local``: phi of equation 7."""

MAI_BIN = 0.1
"""``mai``: width of the histogram's bins, in log10 of luminance."""

FILMIC_EXPOSURE = 0.6
"""``filmic``: factor before the curve with which middle grey stays near middle grey (Narkowicz)."""

_ROWS = 256
"""Rows that are coloured at a time, to keep the float64 copies of large images small."""

Curve = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]


def tonemap(
    radiance: NDArray[Any],
    operator: Operator = "reinhard",
    *,
    exposure: float = 0.0,
    key: float = 0.18,
    white: float | None = None,
    bias: float = 0.85,
    saturation: float = 1.0,
) -> NDArray[np.uint8]:
    """Map linear radiance to 8-bit sRGB codes.

    The operator maps the luminance L to a display luminance L_d; each channel C becomes
    ``L_d (C / L) ** saturation``. A colour that the display cannot show at this luminance is darkened until it
    can, so that hue and saturation stay. The result is encoded as sRGB.

    Parameters
    ----------
    radiance
        ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)``, linear, finite, >= 0, any scale; RGB with BT.709 primaries.
    operator
        ``"reinhard"``: the global operator of Reinhard et al. 2002, equations 1 to 4. ``"reinhard-local"``:
        their local one, equations 5 to 9 (automatic dodging and burning), with the white of equation 4.
        ``"drago"``: the adaptive logarithm of Drago et al. 2003, equation 4, on luminance relative to its
        log-average. ``"mai"``: the tone curve of Mai et al. 2011, which loses least of the HDR image; here in
        the place of the display-adaptive operator of Mantiuk et al. 2008. ``"filmic"``: Narkowicz's fit of the
        ACES curve. ``"log"``: the logarithm of one plus the luminance relative to its log-average.
        ``"linear"``: nothing but a factor.
    exposure
        Stops by which the scene is brightened before the curve; for ``"mai"``, whose curve adapts to the scene,
        by which the display luminance is. -30 to 30.
    key
        Both Reinhard and filmic: display luminance of the scene's log-average before compression, 0 < key <= 1.
    white
        The luminance that becomes white at exposure 0, in the unit of `radiance`, > 0; by default the largest
        one, for ``"linear"`` the 99th percentile. ``"mai"`` does not use it.
    bias
        Drago: smaller values brighten the dark parts and compress the highlights more, 0 < bias < 1; the paper
        advises 0.7 to 0.9.
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
    _check_parameters(operator, exposure, key, white, bias, saturation)

    scene = luminance(image)
    shown = _display_luminance(operator, scene, 2.0**exposure, key, white, bias)
    codes = np.empty(image.shape, np.uint8)
    for top in range(0, image.shape[0], _ROWS):
        rows = slice(top, top + _ROWS)
        seen = scene[rows, :, None]
        ratio = np.divide(image[rows], seen, out=np.zeros(image[rows].shape), where=seen > 0)
        light = into_gamut(shown(rows)[..., None] * ratio**saturation)
        codes[rows] = np.rint(255.0 * srgb_encode(light)).astype(np.uint8)
    return codes


def srgb_encode(linear: NDArray[Any]) -> NDArray[np.float64]:
    """Return the sRGB code (0..1) of linear light, clipped to 0..1 (IEC 61966-2-1)."""
    light = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def srgb_decode(code: NDArray[Any]) -> NDArray[np.float64]:
    """Return the linear light (0..1) of an sRGB code (0..1), clipped to 0..1 (IEC 61966-2-1)."""
    value = np.clip(np.asarray(code, np.float64), 0.0, 1.0)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def luminance(image: NDArray[Any]) -> NDArray[np.float64]:
    """Return the BT.709 luminance ``(H, W)`` of ``(H, W, C)`` in double precision: float32 could overflow."""
    if image.shape[2] == 1:
        return image[..., 0].astype(np.float64)
    total = np.zeros(image.shape[:2])
    for channel, weight in enumerate(REC709.astype(np.float64)):
        total += weight * image[..., channel].astype(np.float64)
    return total


def log_average(scene: NDArray[np.float64]) -> float:
    """Return the geometric mean of the luminance above 0 (Reinhard et al. 2002, equation 1); 0 if all is black.

    Without the paper's delta: with it, black pixels would make the result depend on the scale of the radiance,
    so they are left out instead.
    """
    lit = scene[scene > 0]
    return float(np.exp(np.log(lit).mean())) if lit.size else 0.0


def into_gamut(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """Darken pixels with a channel above 1, just until they fit; ``(H, W, C)``, >= 0.

    Hue and saturation are kept, luminance gives way. Clipping the channels would turn a bright orange yellow,
    and keeping the luminance would turn it pink.
    """
    return light / np.maximum(light.max(axis=2, keepdims=True), 1.0)


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
    operator: str, exposure: float, key: float, white: float | None, bias: float, saturation: float
) -> None:
    if operator not in get_args(Operator):
        raise ConfigError(f"unknown tone mapping operator {operator!r}; use {', '.join(get_args(Operator))}")
    if not abs(exposure) <= LARGEST_EXPOSURE:
        raise ConfigError(
            f"tone mapping: exposure is in stops, -{LARGEST_EXPOSURE:g} to {LARGEST_EXPOSURE:g}, got {exposure}"
        )
    if not 0 < key <= 1:
        raise ConfigError(f"tone mapping: key must be above 0 and at most 1, got {key}")
    float32 = np.finfo(np.float32)
    if white is not None and not float32.tiny <= white <= float32.max:
        raise ConfigError(f"tone mapping: white must be a positive number that float32 holds, got {white}")
    if not 0 < bias < 1:
        raise ConfigError(f"tone mapping: bias must be above 0 and below 1, got {bias}")
    if not 0 <= saturation <= 10:
        raise ConfigError(f"tone mapping: saturation must be a number from 0 to 10, got {saturation}")


def _display_luminance(
    operator: Operator,
    scene: NDArray[np.float64],
    factor: float,
    key: float,
    white: float | None,
    bias: float,
) -> Callable[[slice], NDArray[np.float64]]:
    """Return the function from a slice of rows to their display luminance."""
    average = log_average(scene)
    if average == 0.0:
        return lambda rows: np.zeros_like(scene[rows])
    burnt = white or float(scene.max())
    if operator == "reinhard-local":
        local = _reinhard2002_local(scene, factor * key / average, burnt, key)
        return lambda rows: local[rows]
    curve: Curve
    if operator == "reinhard":
        curve = _reinhard2002(factor * key / average, burnt)
    elif operator == "drago":
        curve = _drago2003(factor / average, burnt, bias)
    elif operator == "mai":
        curve = _mai2011(scene, factor)
    elif operator == "filmic":
        curve = _narkowicz2015(factor * key / average, burnt)
    elif operator == "log":
        curve = _logarithm(factor / average, burnt)
    else:
        curve = _linear(white or float(np.percentile(scene, LINEAR_WHITE_PERCENTILE)) or burnt, factor)
    return lambda rows: curve(scene[rows])


def _reinhard2002(scale: float, white: float) -> Curve:
    def curve(scene: NDArray[np.float64]) -> NDArray[np.float64]:
        scaled = scale * scene  # equation 2
        burnt = np.minimum(scene, white) / white
        return (scaled + burnt**2) / (1 + scaled)  # equation 4; at and above the white luminance it is 1

    return curve


def _reinhard2002_local(scene: NDArray[np.float64], scale: float, white: float, key: float) -> NDArray[np.float64]:
    """Return the display luminance ``(H, W)``: equation 4 with the luminance around a pixel in its denominator."""
    from scipy.ndimage import gaussian_filter

    scaled = scale * scene
    largest = float(scaled.max())

    def around(size: float) -> NDArray[np.float64]:
        # Equation 5: exp(-(r / (alpha s))²) with alpha = 1 / (2 sqrt(2)) is a Gaussian with sigma s / 4.
        return gaussian_filter(scaled / largest, size / 4, mode="nearest") * largest

    centre = around(LOCAL_SCALES[0])
    adapted = centre.copy()
    flat = np.ones(scene.shape, bool)
    for size, larger in pairwise(LOCAL_SCALES):
        surround = around(larger)
        # Equations 7 and 8: the largest area whose surroundings hold no edge is what the eye adapts to.
        contrast = np.abs(centre - surround) / (2.0**LOCAL_SHARPENING * key / size**2 + centre)
        flat &= contrast < LOCAL_THRESHOLD
        adapted[flat] = centre[flat]
        centre = surround
    burnt = np.minimum(scene, white) / white
    return (scaled + burnt**2) / (1 + adapted)  # equation 9


def _drago2003(scale: float, white: float, bias: float) -> Curve:
    exponent = math.log(bias) / math.log(0.5)
    range_end = scale * white

    def curve(scene: NDArray[np.float64]) -> NDArray[np.float64]:
        scaled = np.minimum(scale * scene, range_end)
        base = np.log(2 + 8 * (scaled / range_end) ** exponent)
        # Equation 4 for a display whose largest luminance is 1.
        return np.log1p(scaled) / base * (math.log(10.0) / math.log1p(range_end))

    return curve


def _mai2011(scene: NDArray[np.float64], factor: float) -> Curve:
    """Return the curve whose slope, in codes per log luminance, goes with the cube root of the histogram.

    That is the paper's closed-form minimum of the squared error of the logarithm that the codes lose.
    """
    lit = np.log10(scene[scene > 0])
    low, high = float(lit.min()), float(lit.max())
    count = math.ceil((high - low) / MAI_BIN) + 1
    edges = low + MAI_BIN * (np.arange(count + 1) - 0.5)
    histogram = np.histogram(lit, edges)[0]
    code = np.concatenate(([0.0], np.cumsum(np.cbrt(histogram))))
    code /= np.interp(high, edges, code)

    def curve(scene: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(divide="ignore"):  # black is -infinity, below the first edge
            return factor * srgb_decode(np.interp(np.log10(scene), edges, code))

    return curve


def _narkowicz2015(scale: float, white: float) -> Curve:
    def filmic(scaled: NDArray[Any]) -> NDArray[np.float64]:
        x = np.minimum(FILMIC_EXPOSURE * scaled, 1e6)  # where the curve is flat
        return np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0)

    end = float(filmic(np.array(scale * white)))
    return lambda scene: filmic(scale * scene) / end


def _logarithm(scale: float, white: float) -> Curve:
    end = math.log1p(scale * white)
    return lambda scene: np.log1p(scale * np.minimum(scene, white)) / end


def _linear(white: float, factor: float) -> Curve:
    return lambda scene: scene / white * factor
