"""HDR-VDP-2 from two images to maps and scores."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ConfigError, InputError
from stereohdr.metrics.hdrvdp2 import contrast_sensitivity, masking, optics, receptors
from stereohdr.metrics.hdrvdp2.encodings import linear_channels, warn_if_relative
from stereohdr.metrics.hdrvdp2.options import GEOMETRIC_MEAN, HdrVdp2Options
from stereohdr.metrics.hdrvdp2.quality import PlaneError, quality_220, quality_221
from stereohdr.metrics.hdrvdp2.resize import resized
from stereohdr.metrics.hdrvdp2.spectral import channel_responses
from stereohdr.metrics.hdrvdp2.steerable import SMALLEST_SIDE, steerable_pyramid
from stereohdr.strips import available_threads

VERSION = "2.2.1"

_DIFFERENT = 0.001
"""Relative difference above which a pixel counts for the quality."""


_STRIP_PIXELS = 16384
"""Pixels of a plane that are compared together: few enough to stay in the processor's cache. Fixed, because the
order of sums depends on it."""


@dataclass(frozen=True)
class HdrVdp2Result:
    """Maps and scores of `hdrvdp2`."""

    p_map: NDArray[np.float64] = field(repr=False)
    """``(H, W)``: probability, 0 to 1, that the difference at a pixel is seen."""
    c_map: NDArray[np.float64] = field(repr=False)
    """``(H, W)``: difference in units of the detection threshold, >= 0."""
    p_det: float
    """Probability that any difference is seen: the maximum of `p_map`."""
    c_max: float
    """Maximum of `c_map`."""
    q: float
    """Quality of version 2.2.1: 100 for identical images, no lower bound."""
    q_mos: float
    """Quality of version 2.2.0 as a mean opinion score, 0 worst to 100 best (2.2.1 has none)."""
    plane_errors: tuple[PlaneError, ...] = field(repr=False)
    """What `quality_221`, `quality_220` and `quality_213` are computed from."""


@dataclass(frozen=True)
class _Percept:
    """What the visual system makes of one image."""

    adaptation: NDArray[np.float64]
    """L_a, ``(H, W)`` in cd/m^2."""
    bands: list[NDArray[np.float64]]
    """Steerable pyramid of the achromatic response."""


@dataclass(frozen=True)
class _BandFactors:
    """What the planes of one band share, each ``(rows, columns)``."""

    sensitivity: masking.BandSensitivity
    total_activity: NDArray[np.float64]
    """Sum of the mutual activity over the orientations."""
    different: NDArray[np.float64]
    """Share of different pixels."""


def hdrvdp2(
    test: NDArray[Any],
    reference: NDArray[Any],
    *,
    encoding: str,
    pixels_per_degree: float,
    options: HdrVdp2Options | None = None,
    threads: int | None = None,
) -> HdrVdp2Result:
    """Compare two images as an observer would, by HDR-VDP-2 version 2.2.1.

    Parameters
    ----------
    test, reference
        ``(H, W)`` or ``(H, W, C)``, the same shape, both sides at least 17 pixels; units by `encoding`.
        Pixels that are NaN count as 1e-5 cd/m^2, with a warning.
    encoding
        ``luminance``, ``luma-display``, ``sRGB-display``, ``rgb-bt.709``, ``XYZ`` or ``generic``, see `ENCODINGS`.
    pixels_per_degree
        Angular resolution, > 0: about 30 for a desktop display, see `pixels_per_degree`. Scores depend on it.
    options
        Observer and display.
    threads
        Threads to use; None takes all that are available. Does not change the result.

    Returns
    -------
    Maps and scores.

    Raises
    ------
    InputError
        Different shapes, images that are too small, or values that the encoding does not allow.
    ConfigError
        Unknown encoding, `pixels_per_degree` not positive, or options that do not fit the image.

    Warns
    -----
    StereoHdrWarning
        NaN pixels, or a test image so dark that it is probably not in cd/m^2.

    Notes
    -----
    Q reacts most to the worst artefact, moves with the absolute scale of the images and with
    `pixels_per_degree`, and is comparable only under the same protocol. Images of ``H W`` pixels need about
    500 bytes per pixel.

    References
    ----------
    Mantiuk, Kim, Rempel and Heidrich, HDR-VDP-2, ACM Transactions on Graphics 30(4), 2011,
    doi:10.1145/2010324.1964935.

    Examples
    --------
    >>> import numpy as np
    >>> flat = np.full((32, 32), 100.0)
    >>> hdrvdp2(flat, flat, encoding="luminance", pixels_per_degree=30).q
    100.0
    """
    options = options or HdrVdp2Options()
    if not (pixels_per_degree > 0 and math.isfinite(pixels_per_degree)):
        raise ConfigError(f"pixels_per_degree must be > 0, got {pixels_per_degree!r}")
    if np.shape(test) != np.shape(reference):
        raise InputError(
            f"the images must have the same shape, got test {np.shape(test)} and reference {np.shape(reference)}"
        )
    test_channels = linear_channels(test, encoding, name="test")
    reference_channels = linear_channels(reference, encoding, name="reference")
    warn_if_relative(test_channels, encoding)
    height, width = test_channels.shape[1:]
    if min(height, width) < SMALLEST_SIDE:
        raise InputError(
            f"HDR-VDP-2 needs images of at least {SMALLEST_SIDE} x {SMALLEST_SIDE} pixels, got {height} x {width}"
        )
    responses = _responses(len(test_channels), encoding, options)
    surrounds = _surrounds(reference_channels, options)

    with ThreadPoolExecutor(threads or available_threads()) as pool:

        def perceive(channels: NDArray[np.float64]) -> _Percept:
            return _perceive(channels, responses, surrounds, pixels_per_degree, options)

        seen_test, seen_reference = pool.map(perceive, (test_channels, reference_channels))
        different = _difference_mask(test_channels, reference_channels)
        del test_channels, reference_channels
        _filter_base_bands(seen_test, seen_reference, pixels_per_degree)
        detection, errors = _compare(seen_test, seen_reference, different, pixels_per_degree, options, pool)
        del seen_test, seen_reference
        c_map = np.abs(steerable_pyramid(height, width).collapse(detection, map_planes=pool.map))

    if options.do_spatial_pooling:
        c_map *= c_map.sum() / (c_map.max() + 1e-12)
    p_map = -np.expm1(math.log(0.5) * c_map)
    return HdrVdp2Result(
        p_map=p_map,
        c_map=c_map,
        p_det=float(p_map.max()),
        c_max=float(c_map.max()),
        q=quality_221(errors),
        q_mos=quality_220(errors)[1],
        plane_errors=errors,
    )


def _responses(channels: int, encoding: str, options: HdrVdp2Options) -> NDArray[np.float64]:
    """Return ``(C, 3)``: L cones, M cones and rods per unit of each channel."""
    if encoding != "generic":
        if options.spectral_responses is not None:
            raise ConfigError(f"spectral_responses belongs to the encoding 'generic', got {encoding!r}")
        return channel_responses(channels, options.rgb_display)
    if options.spectral_responses is None or len(options.spectral_responses) != channels:
        raise ConfigError(
            f"the encoding 'generic' needs spectral_responses with one row for each of the {channels} channels, "
            f"got {options.spectral_responses!r}"
        )
    return np.array(options.spectral_responses)


def _surrounds(reference: NDArray[np.float64], options: HdrVdp2Options) -> list[float]:
    """Return the light around the image for each channel."""
    given = options.surrounds
    if len(given) not in (1, len(reference)):
        raise ConfigError(f"surround_l must have 1 or {len(reference)} numbers, got {options.surround_l!r}")
    if len(given) == 1:
        given = given * len(reference)
    surrounds = []
    for value, channel in zip(given, reference, strict=True):
        if value == GEOMETRIC_MEAN:
            if channel.min() < 0:
                raise InputError(
                    "surround_l = -1 needs a reference inside the gamut of BT.709: a channel has negative values"
                )
            with np.errstate(divide="ignore"):  # a black pixel makes the mean zero
                value = float(np.exp(np.log(channel).mean()))
        surrounds.append(value)
    return surrounds


def _perceive(
    channels: NDArray[np.float64],
    responses: NDArray[np.float64],
    surrounds: list[float],
    pixels_per_degree: float,
    options: HdrVdp2Options,
) -> _Percept:
    """Return what the eye makes of an image of linear channels, ``(C, H, W)``."""
    l_cone, m_cone, rod = (np.zeros(channels.shape[1:]) for _ in range(3))
    for channel, surround, (to_l, to_m, to_rod) in zip(channels, surrounds, responses, strict=True):
        if options.do_mtf:
            channel = optics.scattered(channel, pixels_per_degree, surround)
        l_cone += to_l * channel
        m_cone += to_m * channel
        rod += to_rod * channel
    tables = receptors.response_tables(options.peak_sensitivity, options.rod_sensitivity)
    response = receptors.achromatic_response(l_cone, m_cone, rod, tables)
    l_cone += m_cone
    return _Percept(l_cone, steerable_pyramid(*response.shape).build(response))


def _difference_mask(test: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 where any channel, ``(C, H, W)``, differs, else 0: ``(H, W)``."""
    mask = np.zeros(test.shape[1:], dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):  # 0/0 compares as not different
        for one, other in zip(test, reference, strict=True):
            mask |= np.abs(one - other) / other > _DIFFERENT
    return mask.astype(np.float64)


def _band_frequency(band: int, pixels_per_degree: float) -> float:
    """Return the nominal frequency of a band of the pyramid in cycles per degree."""
    return 0.5 * pixels_per_degree * 2.0**-band


def _filter_base_bands(test: _Percept, reference: _Percept, pixels_per_degree: float) -> None:
    """Weight the base bands, in place, by the contrast sensitivity of each image's mean luminance."""
    frequency = _band_frequency(len(reference.bands) - 1, pixels_per_degree)
    surround = float(reference.bands[-1].mean())
    for percept in (test, reference):
        luminance = float(percept.adaptation.mean())

        def transfer(rho: NDArray[np.float64], luminance: float = luminance) -> NDArray[np.float64]:
            return contrast_sensitivity.neural_sensitivity(rho, luminance)

        base = percept.bands[-1][0]
        height, width = base.shape
        # The base band reaches to the diagonal of its frequency square.
        sampling = 2.0 * math.sqrt(2.0) * frequency
        base[:] = optics.surround_filter((height, width), sampling, transfer).apply(base, surround)


def _compare(
    test: _Percept,
    reference: _Percept,
    different: NDArray[np.float64],
    pixels_per_degree: float,
    options: HdrVdp2Options,
    pool: ThreadPoolExecutor,
) -> tuple[list[NDArray[np.float64]], tuple[PlaneError, ...]]:
    """Return the pyramid of visible differences, and the error of each of its planes."""
    bands = range(len(test.bands))
    planes = [(band, orientation) for band in bands for orientation in range(len(test.bands[band]))]
    activity = [np.zeros_like(band) for band in test.bands]  # stays zero without masking

    def measure(plane: tuple[int, int]) -> None:
        band, orientation = plane
        activity[band][orientation] = masking.mutual_activity(
            test.bands[band][orientation], reference.bands[band][orientation]
        )

    if options.do_masking:
        list(pool.map(measure, planes))
    luminance = receptors.log_luminance((test.adaptation + reference.adaptation) / 2.0)

    def describe(band: int) -> _BandFactors:
        height, width = test.bands[band].shape[1:]
        if band == bands[-1]:
            sensitivity = np.ones((height, width))  # it was filtered already
        else:
            table = contrast_sensitivity.sensitivity_table(_band_frequency(band, pixels_per_degree))
            sensitivity = table.at(resized(luminance, (height, width)))
        return _BandFactors(
            sensitivity=masking.band_sensitivity(sensitivity, gain=2.0**band),
            total_activity=activity[band].sum(axis=0),
            different=resized(different, (height, width)),
        )

    factors = list(pool.map(describe, bands))
    detection = [np.empty_like(band) for band in test.bands]

    def detect(plane: tuple[int, int]) -> PlaneError:
        band, orientation = plane
        gain = 2.0**band
        own = activity[band][orientation]
        one, other = test.bands[band][orientation], reference.bands[band][orientation]
        sensitivity, total = factors[band].sensitivity, factors[band].total_activity
        neighbours = masking.neighbour_activity(activity, band, orientation, gain=gain)
        squares = 0.0
        step = max(1, _STRIP_PIXELS // own.shape[1])
        for start in range(0, own.shape[0], step):
            rows = slice(start, start + step)
            mask = None
            if options.do_masking:
                mask = masking.masking_signal(own[rows], total[rows], neighbours[rows], gain=gain)
                mask *= sensitivity.masking[rows]
            difference = masking.masked_difference(
                one[rows], other[rows], sensitivity.transducer[rows], mask, gain=gain
            )
            detection[band][orientation, rows] = masking.detection_signal(difference, gain=gain)
            difference *= factors[band].different[rows]
            difference *= difference
            squares += float(difference.sum())
        error = math.sqrt(squares) / own.size
        return PlaneError(band, orientation, _band_frequency(band, pixels_per_degree), error)

    return detection, tuple(pool.map(detect, planes))
