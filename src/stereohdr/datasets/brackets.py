"""Stereo brackets as recorded (several exposures of each camera), and references made of brackets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stereohdr.datasets.scene import EvaluationScene
from stereohdr.errors import FileFormatError, InputError
from stereohdr.io import read_photo
from stereohdr.io.metadata import parse_exposure_time
from stereohdr.merging import merge_bracket
from stereohdr.model import Photo, ResponseCurve, StereoPair, View
from stereohdr.response.bracket import estimate_bracket_response

if TYPE_CHECKING:
    from stereohdr.rectification import RectifiedPair


@dataclass(frozen=True, eq=False)
class StereoBracket:
    """All exposures that two cameras took of one scene, as recorded.

    Raises
    ------
    InputError
        A view has no photo.
    """

    name: str
    """What messages call it."""
    left: tuple[Photo, ...]
    """Photos of the left camera, shortest exposure first."""
    right: tuple[Photo, ...]
    """Photos of the right camera, shortest exposure first."""
    response: ResponseCurve | None = None
    """The cameras' response, where it is known."""
    rectified: bool = False
    """Whether corresponding points lie on the same row, the left one to the right of the right one."""

    def __post_init__(self) -> None:
        for side in ("left", "right"):
            photos: tuple[Photo, ...] = getattr(self, side)
            if not photos:
                raise InputError(f"{self.name}: there is no photo of the {side} camera; check the folder")
            ordered = tuple(sorted(photos, key=lambda photo: photo.exposure_time or 0.0))
            object.__setattr__(self, side, ordered)

    def view(self, side: View) -> tuple[Photo, ...]:
        """Return the photos of one camera, shortest exposure first."""
        return self.left if side == "left" else self.right

    def photo(self, side: View, exposure_time: float) -> Photo:
        """Return the photo of one camera at one exposure time (seconds, to 1 %).

        Raises
        ------
        InputError
            There is none.
        """
        times = [photo.exposure_time or 0.0 for photo in self.view(side)]
        nearest = int(np.argmin(np.abs(np.array(times) - exposure_time)))
        if abs(times[nearest] - exposure_time) > 0.01 * exposure_time:
            known = ", ".join(f"{time:g}" for time in times)
            raise InputError(
                f"{self.name}: the {side} camera has no photo at {exposure_time:g} s; there are {known} s"
            )
        return self.view(side)[nearest]


def bracket_scene(
    brackets: StereoBracket,
    *,
    main: View,
    exposures: tuple[float, float],
    max_disparity: int,
    name: str | None = None,
) -> EvaluationScene:
    """Make a scene of two photos of a rectified stereo bracket; the MV's whole bracket is the reference.

    Parameters
    ----------
    brackets
        Rectified.
    main
        The camera that is the MV.
    exposures
        Exposure times ``(main, auxiliary)`` in seconds.
    max_disparity
        Pixels.
    name
        Name of the scene, that of the bracket by default.

    Raises
    ------
    InputError
        The bracket is not rectified, or has no such photo.
    """
    if not brackets.rectified:
        raise InputError(
            f"{brackets.name}: the two views are not rectified (corresponding points lie on different rows), so "
            f"no stereo method can use them yet; see rectified_bracket"
        )
    auxiliary: View = "right" if main == "left" else "left"
    photos = {main: brackets.photo(main, exposures[0]), auxiliary: brackets.photo(auxiliary, exposures[1])}
    pair = StereoPair(photos["left"], photos["right"], main)
    reference, clipped, response = bracket_reference(brackets.view(main), brackets.response)
    return EvaluationScene(
        name=name or brackets.name,
        pair=pair,
        reference=reference,
        reference_clipped=clipped,
        max_disparity=max_disparity,
        response=brackets.response,
        reference_response=response,
        description=f"{brackets.name}, {len(brackets.view(main))} exposures of the main view as reference",
    )


def rectified_bracket(
    brackets: StereoBracket, *, main: View, exposures: tuple[float, float]
) -> tuple[StereoBracket, RectifiedPair]:
    """Rectify a stereo bracket from two of its photos, all photos of a camera in the same way.

    Parameters
    ----------
    brackets
        Not rectified.
    main
        The camera that is the MV.
    exposures
        Exposure times ``(main, auxiliary)`` in seconds of the two photos whose features tell the geometry.

    Returns
    -------
    The rectified bracket, and the two photos as rectified with the numbers that say how well.

    Raises
    ------
    InputError
        There are no such photos, or they do not tell the geometry, see `stereohdr.rectification.rectify_pair`.
    MissingDependencyError
        OpenCV is not installed.
    """
    from stereohdr.rectification import rectify_pair
    from stereohdr.rectification.resampling import resampled_photo

    t_left, t_right = exposures if main == "left" else exposures[::-1]
    left, right = brackets.photo("left", t_left), brackets.photo("right", t_right)
    pair = rectify_pair(left, right, main=main, response=brackets.response)
    geometry = pair.rectification

    def resampled(side: View) -> tuple[Photo, ...]:
        return tuple(
            resampled_photo(photo, geometry.view(side), geometry.size, response=brackets.response)[0]
            for photo in brackets.view(side)
        )

    return replace(brackets, left=resampled("left"), right=resampled("right"), rectified=True), pair


def bracket_reference(
    photos: Sequence[Photo], response: ResponseCurve | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_], ResponseCurve]:
    """Merge a bracket into a reference.

    Returns
    -------
    Radiance ``(H, W, C)`` and clipped ``(H, W)`` of `stereohdr.merging.merge_bracket`, and the response that was
    used: `response`, or the one estimated from the bracket.
    """
    curve = estimate_bracket_response(photos) if response is None else response
    radiance, clipped = merge_bracket(photos, response=curve)
    return radiance, clipped, curve


def read_bracket_view(folder: Path, side: View, *, white_level: int) -> tuple[Photo, ...]:
    """Read the photos ``<side>_<time>ms.png`` of one camera.

    Parameters
    ----------
    folder
        Holds the photos; the exposure times in milliseconds are part of their names.
    side
        left or right.
    white_level
        Code at which the sensor clips.

    Returns
    -------
    The photos, exposure times in seconds.

    Raises
    ------
    FileFormatError
        The folder holds no such photo, or a name states no time.
    """
    paths = sorted(folder.glob(f"{side}_*ms.png"))
    if not paths:
        raise FileFormatError(f"{folder}: holds no {side}_<time>ms.png; give the folder of the photos")
    photos = []
    for path in paths:
        text = path.stem.removeprefix(f"{side}_")
        try:
            time = parse_exposure_time(text)
        except InputError as error:
            raise FileFormatError(f"{path}: the name states no exposure time ({error})") from error
        photos.append(read_photo(path, exposure_time=time, white_level=white_level))
    return tuple(photos)
