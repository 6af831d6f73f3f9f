"""What a benchmark needs of a scene, and the masks in which errors are told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError
from stereohdr.model import Disparity, DisparityFlag, Photo, ResponseCurve, StereoPair
from stereohdr.radiance import exposure_map

Kind = Literal["real", "re-exposed", "procedural"]

CHANNEL_LIMITS = (5, 248)
"""Codes (of 255) below the first, and from the second on, are out of range (mask Sx): sensors bend near white."""


@dataclass(frozen=True, eq=False)
class EvaluationScene:
    """A pair of photos with what is known to be true of it.

    Raises
    ------
    InputError
        An array does not have the size of the photos, the reference is not positive and finite, or the largest
        disparity is out of range.
    """

    name: str
    """Name in tables and on the command line."""
    pair: StereoPair
    """The input of the methods; its main view (MV) is where the result is compared."""
    reference: NDArray[np.float32]
    """``(H, W, C)`` radiance of the MV, linear, positive, of any scale."""
    reference_clipped: NDArray[np.bool_]
    """``(H, W)``, True where the reference is a bound only: no measurement exists in some channel."""
    max_disparity: int
    """Largest disparity that methods are told to search, pixels, 1 to W - 1."""
    disparity_main: Disparity | None = None
    """Ground truth in the MV's pixels; see `stereohdr.datasets.ground_truth.known_disparities` for the flags."""
    disparity_auxiliary: Disparity | None = None
    """Ground truth in the auxiliary view's (AV's) pixels."""
    response: ResponseCurve | None = None
    """The true response of the camera, where it is known (simulated cameras, calibrated ones)."""
    reference_response: ResponseCurve | None = None
    """The response, estimated from the bracket, with which a real reference was merged: the best that is known
    where `response` is None."""
    kind: Kind = "real"
    """``real``: photos at two exposures; ``re-exposed``: photos at one exposure, linearised and exposed again by
    the simulated camera; ``procedural``: rendered and exposed by it."""
    description: str = ""
    """One line on where it comes from."""

    def __post_init__(self) -> None:
        photo = self.pair.main_photo
        size = (photo.height, photo.width)
        reference = np.asarray(self.reference)
        arrays = [("reference", reference.shape, photo.codes.shape)]
        arrays.append(("reference_clipped", np.shape(self.reference_clipped), size))
        for which, disparity in (("main", self.disparity_main), ("auxiliary", self.disparity_auxiliary)):
            if disparity is not None:
                arrays.append((f"disparity_{which}", disparity.values.shape, size))
                arrays.append((f"disparity_{which}.flags", disparity.flags.shape, size))
        for what, shape, expected in arrays:
            if shape != expected:
                raise InputError(f"scene {self.name}: {what} has shape {shape}, the photos call for {expected}")
        if not (np.isfinite(reference).all() and (reference > 0).all()):
            raise InputError(f"scene {self.name}: the reference must be positive and finite everywhere")
        if not 1 <= self.max_disparity < photo.width:
            raise InputError(
                f"scene {self.name}: the largest disparity must be 1 to {photo.width - 1} pixels, "
                f"got {self.max_disparity}"
            )


def luminance_mask(scene: EvaluationScene) -> NDArray[np.bool_]:
    """Return the mask S, ``(H, W)`` bool: MV pixels that the paper's luminance rule calls out of range."""
    return exposure_map(scene.pair.main_photo)


def channel_mask(scene: EvaluationScene) -> NDArray[np.bool_]:
    """Return the mask Sx, ``(H, W)`` bool: MV pixels with any channel out of range, see `CHANNEL_LIMITS`."""
    return any_channel_out_of_range(scene.pair.main_photo)


def any_channel_out_of_range(photo: Photo) -> NDArray[np.bool_]:
    """Return ``(H, W)`` bool, True where a code is beyond `CHANNEL_LIMITS` (scaled for deeper codes)."""
    low, high = (limit * photo.white / 255 for limit in CHANNEL_LIMITS)
    return np.any((photo.codes < low) | (photo.codes >= high), axis=2)


def visible_in_auxiliary(scene: EvaluationScene) -> NDArray[np.bool_] | None:
    """Return where the auxiliary view sees the MV's surface, ``(H, W)`` bool; None without ground truth.

    Pixels whose disparity is unknown count as not visible.

    Notes
    -----
    The flags of the ground truth say it: from exact geometry in procedural scenes; elsewhere from the frame and a
    cross-check of both disparity maps, see `stereohdr.datasets.ground_truth.known_disparities`.
    """
    if scene.disparity_main is None:
        return None
    return scene.disparity_main.flags == DisparityFlag.MATCHED
