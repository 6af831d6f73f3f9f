"""Checks on a pair that need its pixels: unusable views, exposures that contradict the brightness."""

from __future__ import annotations

import numpy as np

from stereohdr.config import ExposureMapConfig
from stereohdr.errors import ExposureError
from stereohdr.model import StereoPair
from stereohdr.radiance import code_luma, exposure_map


def unusable_view(pair: StereoPair) -> str | None:
    """Return a sentence about a view without a single well-exposed pixel, None if both have some."""
    for photo in (pair.main_photo, pair.auxiliary_photo):
        if exposure_map(photo).all():
            config = ExposureMapConfig()
            luma = code_luma(photo)
            dark = bool((luma < config.under_threshold).all())
            bright = bool((luma > config.over_threshold).all())
            state = "black" if dark else "white" if bright else "black or white"
            return f"{photo.name}: every pixel is {state}, so stereo cannot use it"
    return None


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
    short, long = (photos[i] for i in np.argsort(exposures))
    levels = np.linspace(0.05, 0.95, 19)
    dark, bright = (np.quantile(code_luma(photo), levels) for photo in (short, long))
    config = ExposureMapConfig()
    clipped = (np.maximum(dark, bright) < config.under_threshold) | (
        np.minimum(dark, bright) > config.over_threshold
    )
    difference = (bright - dark)[~clipped]
    if difference.size and difference.mean() <= 0:
        raise ExposureError(
            f"the exposures contradict the photos: {long.name} should be the brighter one "
            f"({max(exposures):g} s against {min(exposures):g} s), but {short.name} is at least as bright; "
            f"check that exposures and photos are in the same order, left then right"
        )
