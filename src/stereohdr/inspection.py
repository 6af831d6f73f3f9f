"""What a photo holds, and whether two of them make a usable pair: `stereohdr info`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stereohdr.checks import check_exposure_order, check_same_camera, doubtful_white_level, unusable_view
from stereohdr.config import ExposureMapConfig
from stereohdr.errors import InputError
from stereohdr.io.raw import clip_level
from stereohdr.model import Photo, ResponseCurve, StereoPair
from stereohdr.radiance import code_luma
from stereohdr.response.exposure_ratio import RatioEstimate, estimate_exposure_ratio

LEAST_OVERLAP = 0.05
"""Share of the scene that both views must expose well; below it neither response nor disparity can be found."""

LITTLE_OVERLAP = 0.2
"""Below this share of the scene a user should know."""

RATIO_SLACK = 0.5
"""Stops by which the exposures may differ from what the photos say, for a known response."""

DEEP_DARK = 1.0
"""Luma (of 255) below which photos of more than 8 bits are black: 16 codes of 12 bits. In 8-bit photos it is the
threshold of the exposure map."""

RANKS = 1001
"""Ranks at which the brightness of the two views is compared."""


@dataclass(frozen=True)
class PhotoFacts:
    """What was read of one photo; shares are 0..1 of its pixels."""

    name: str
    width: int
    height: int
    channels: int
    bits: int
    """Bits that the white level needs."""
    white_level: int
    """After the black level was taken off."""
    highest_code: int
    clips_at: int
    """The code at which samples pile up; the white level where none does."""
    linear: bool
    camera: str | None
    exposure_time: float | None
    """Seconds."""
    exposure_source: str | None
    """``given``, ``file`` or ``estimated``."""
    f_number: float | None
    iso: float | None
    exposure_value: float | None
    """EV at ISO 100: log2(f_number^2 / time) - log2(ISO / 100); None unless all three are known."""
    black_share: float
    """Luma too low to tell anything: below 5 of 255, in photos of more than 8 bits below 1 of 255."""
    white_share: float
    """Some channel within 5 of 255 of where it clips."""
    note: str | None
    """What a user should know."""


@dataclass(frozen=True)
class PairFacts:
    """Whether two photos can be fused; shares are 0..1 of the scene, compared by rank of brightness."""

    exposure_ratio: float | None
    """Longer over shorter effective exposure as stated; None when an exposure is unknown."""
    estimated_ratio: float | None
    """The same, from the photos alone; None when they have nothing in common."""
    estimate_assumes: str | None
    """``linear`` (the photos say so) or ``srgb`` (assumed: the estimate may be far off)."""
    overlap: float
    """Well exposed in both views."""
    white_in_both: float
    """Over-exposed in both views: lost."""
    black_in_both: float
    """Under-exposed in both views: lost."""
    usable: bool
    problems: tuple[str, ...]
    """Why it is not usable."""
    notes: tuple[str, ...]
    """What a user should know."""


def photo_facts(photo: Photo) -> PhotoFacts:
    """Return what is known of a photo."""
    config = ExposureMapConfig()
    clips_at = clip_level(photo.codes, photo.white)
    near_white = photo.codes >= clips_at * (config.over_threshold / 255)
    value = None
    if photo.exposure_time is not None and photo.f_number is not None and photo.iso is not None:
        value = math.log2(photo.f_number**2 / photo.exposure_time) - math.log2(photo.iso / 100)
    return PhotoFacts(
        name=photo.name,
        width=photo.width,
        height=photo.height,
        channels=photo.channels,
        bits=photo.white.bit_length(),
        white_level=photo.white,
        highest_code=int(photo.codes.max()),
        clips_at=clips_at,
        linear=photo.linear,
        camera=photo.camera,
        exposure_time=photo.exposure_time,
        exposure_source=photo.exposure_source,
        f_number=photo.f_number,
        iso=photo.iso,
        exposure_value=value,
        black_share=float((code_luma(photo) < _dark_luma(photo)).mean()),
        white_share=float(near_white.any(axis=-1).mean()),
        note=doubtful_white_level([photo]),
    )


def pair_facts(left: Photo, right: Photo, *, response: ResponseCurve | None = None) -> PairFacts:
    """Return whether two photos make a usable pair. They need not be rectified.

    Parameters
    ----------
    left, right
        Photos; exposures may be unknown.
    response
        Known response of the camera, for the estimate of the ratio.
    """
    problems: list[str] = []
    notes: list[str] = []
    overlap, white, black = _shared_exposure(left, right)
    estimate = _estimate(left, right, response)
    ratio = None
    if left.exposure_time is not None and right.exposure_time is not None:
        times = (left.exposure_time, right.exposure_time)
        ratio = max(times) / min(times)
    try:
        pair = StereoPair(left, right)
        ratio = pair.exposure_ratio
        check_exposure_order(pair)
        notes.append(check_same_camera(pair, response) or "")
        problems.append(unusable_view(pair) or "")
    except InputError as error:
        problems.append(str(error))
    if overlap < LEAST_OVERLAP:
        problems.append(
            f"only {100 * overlap:.1f} % of the scene is well exposed in both views; choose exposures closer "
            f"together"
        )
    elif overlap < LITTLE_OVERLAP:
        notes.append(
            f"little of the scene ({100 * overlap:.0f} %) is well exposed in both views; exposures closer "
            f"together make matching easier"
        )
    if ratio is not None and estimate is not None and estimate.assumed != "srgb":
        said = max(estimate.ratio, 1 / estimate.ratio)
        if abs(math.log2(said / ratio)) > RATIO_SLACK:
            notes.append(f"the exposures say a ratio of {ratio:.3g}, the photos {said:.3g}; check the times")
    problems = [text for text in problems if text]
    return PairFacts(
        exposure_ratio=ratio,
        estimated_ratio=None if estimate is None else max(estimate.ratio, 1 / estimate.ratio),
        estimate_assumes=None if estimate is None else estimate.assumed,
        overlap=overlap,
        white_in_both=white,
        black_in_both=black,
        usable=not problems,
        problems=tuple(problems),
        notes=tuple(text for text in notes if text),
    )


def _estimate(left: Photo, right: Photo, response: ResponseCurve | None) -> RatioEstimate | None:
    try:
        return estimate_exposure_ratio(left, right, response=response)
    except InputError:
        return None


def _shared_exposure(left: Photo, right: Photo) -> tuple[float, float, float]:
    """Return the shares of the scene that are well exposed, white and black in both views.

    The views see nearly the same scene, so equal ranks of brightness are taken for equal places.
    """
    ranks = np.linspace(0, 1, RANKS)
    lumas = [np.quantile(code_luma(photo), ranks) for photo in (left, right)]
    white = [luma > ExposureMapConfig().over_threshold for luma in lumas]
    black = [luma < _dark_luma(photo) for luma, photo in zip(lumas, (left, right), strict=True)]
    neither = ~(white[0] | black[0] | white[1] | black[1])
    return float(neither.mean()), float((white[0] & white[1]).mean()), float((black[0] & black[1]).mean())


def _dark_luma(photo: Photo) -> float:
    return ExposureMapConfig().under_threshold if photo.white <= 255 else DEEP_DARK
