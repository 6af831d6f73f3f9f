"""Scenes made by the simulated camera: photos at one exposure exposed again, and procedural scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from stereohdr.datasets.ground_truth import Values, known_disparities
from stereohdr.datasets.scene import EvaluationScene, Kind
from stereohdr.errors import InputError
from stereohdr.model import Disparity, Photo
from stereohdr.radiance import luminance
from stereohdr.simulation import SCENES, Camera, StereoScene, expose_pair, reexpose_codes

SETTINGS: Mapping[str, tuple[float, float]] = {
    "normal-long": (1.0, 4.0),
    "short-long": (1 / 4, 4.0),
    "long-short": (4.0, 1 / 4),
    "short-dark": (1 / 16, 1.0),
}
"""Exposures (MV, AV) relative to the default image. In the first two hardly a pixel of a default Middlebury image
is in S, so they cannot rank stereo methods; the last two can."""

SEED = 2017
"""Seed of the dither of the left view (plus one: of the right view) and of the noise."""

DEFAULT_GAMMA = 2.2
"""Exponent that linearises photos which are exposed again."""


@dataclass(frozen=True, eq=False)
class SameExposurePair:
    """A rectified pair at one exposure, 8 bit, with ground truth.

    Parameters
    ----------
    name
        Name of the scene.
    left, right
        Photos; their exposure time is not needed.
    disparity_left, disparity_right
        ``(H, W)`` float32, pixels, 0 where unknown; or None.
    max_disparity
        Pixels.
    """

    name: str
    left: Photo
    right: Photo
    disparity_left: Values | None
    disparity_right: Values | None
    max_disparity: int


def reexposed_scene(
    pair: SameExposurePair,
    setting: str,
    *,
    camera: Camera | None = None,
    seed: int = SEED,
    name: str | None = None,
) -> EvaluationScene:
    """Take a pair at one exposure as the true radiance, and photograph it at two.

    Parameters
    ----------
    pair
        8-bit photos. Codes are linearised (gamma 2.2, half-code dither); the full well of the simulated camera is
        filled by code 255 at exposure 1.
    setting
        One of `SETTINGS`.
    camera
        sRGB response, full well 12000 e-, read noise 4 e-, 8 bit by default.
    seed
        Seed of the dither and of the noise.
    name
        ``<name>-<setting>`` by default.

    Returns
    -------
    A scene with the left view as MV; its reference is the true radiance.

    Raises
    ------
    InputError
        Unknown setting, or the photos are not 8-bit.
    """
    if setting not in SETTINGS:
        raise InputError(f"unknown exposure setting {setting!r}; known are {', '.join(SETTINGS)}")
    truth = known_disparities(pair.disparity_left, pair.disparity_right)
    left, right = (
        reexpose_codes(cast("NDArray[np.uint8]", photo.codes), gamma=DEFAULT_GAMMA, seed=seed + number)
        for number, photo in enumerate((pair.left, pair.right))
    )
    return _exposed(
        name or f"{pair.name}-{setting}",
        (left, truth[0]),
        (right, truth[1]),
        exposures=SETTINGS[setting],
        camera=camera or Camera(),
        seed=seed,
        max_disparity=pair.max_disparity,
        kind="re-exposed",
        description=f"{pair.name}, re-exposed at {SETTINGS[setting][0]:g} and {SETTINGS[setting][1]:g}",
    )


@dataclass(frozen=True)
class _Procedural:
    scene: Callable[..., StereoScene]
    white_percentile: float
    """Percentile of the MV's luminance that, times 4, fills the pixel at exposure 1."""
    exposures: tuple[float, float]
    """(MV, AV), relative."""


PROCEDURAL: Mapping[str, _Procedural] = {
    # The MV is exposed for the window, the AV for the shadows.
    "room": _Procedural(SCENES["room"], 75, (1 / 8, 2.0)),
    # The MV is exposed for the shadows, so that lamps and lit windows are white.
    "street-night": _Procedural(SCENES["street_night"], 75, (4.0, 1 / 4)),
}
"""Procedural scenes by name; ratio 16."""


def procedural_scene(name: str, *, camera: Camera | None = None, seed: int = SEED) -> EvaluationScene:
    """Render a procedural scene and photograph it.

    Parameters
    ----------
    name
        One of `PROCEDURAL`.
    camera
        The default camera of `reexposed_scene` when None.
    seed
        Seed of the noise.

    Returns
    -------
    A scene with the left view as MV, exact ground truth and the true radiance as reference.

    Raises
    ------
    InputError
        Unknown name.
    """
    if name not in PROCEDURAL:
        raise InputError(f"unknown procedural scene {name!r}; known are {', '.join(PROCEDURAL)}")
    recipe = PROCEDURAL[name]
    scene = recipe.scene()
    white = 4 * np.percentile(luminance(scene.radiance_left), recipe.white_percentile).astype(np.float32)
    return _exposed(
        name,
        (scene.radiance_left / white, scene.disparity_left),
        (scene.radiance_right / white, scene.disparity_right),
        exposures=recipe.exposures,
        camera=camera or Camera(),
        seed=seed,
        max_disparity=scene.max_disparity,
        kind="procedural",
        description=f"procedural, exposed at {recipe.exposures[0]:g} and {recipe.exposures[1]:g}",
    )


def _exposed(
    name: str,
    left: tuple[NDArray[np.float32], Disparity | None],
    right: tuple[NDArray[np.float32], Disparity | None],
    *,
    exposures: tuple[float, float],
    camera: Camera,
    seed: int,
    max_disparity: int,
    kind: Kind,
    description: str,
) -> EvaluationScene:
    pair = expose_pair(left[0], right[0], exposures, camera, seed)
    reference = np.maximum(left[0], np.finfo(np.float32).tiny)
    return EvaluationScene(
        name=name,
        pair=pair,
        reference=reference,
        reference_clipped=np.zeros(reference.shape[:2], bool),
        max_disparity=max_disparity,
        disparity_main=left[1],
        disparity_auxiliary=right[1],
        response=camera.response_curve(reference.shape[2]),
        kind=kind,
        description=description,
    )
