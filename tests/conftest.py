"""Shared scenes and pairs: small, procedural, seeded."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from stereohdr import Photo, StereoPair

settings.register_profile("ci", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
settings.load_profile("ci")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real image pairs that may lie beside the project."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the folder of real image pairs is not beside this checkout")
    return SHARED_DATA


def smooth_codes(rng: np.random.Generator, height: int, width: int, channels: int = 3) -> np.ndarray:
    """Return a smooth random picture, float 0..255, that looks like blobs."""
    coarse = rng.uniform(0, 255, (height // 6 + 3, width // 6 + 3, channels))
    y = np.linspace(0, coarse.shape[0] - 1.001, height)
    x = np.linspace(0, coarse.shape[1] - 1.001, width)
    y0, x0 = y.astype(int), x.astype(int)
    fy, fx = (y - y0)[:, None, None], (x - x0)[None, :, None]
    top = coarse[y0][:, x0] * (1 - fx) + coarse[y0][:, x0 + 1] * fx
    bottom = coarse[y0 + 1][:, x0] * (1 - fx) + coarse[y0 + 1][:, x0 + 1] * fx
    return top * (1 - fy) + bottom * fy


def make_pair(
    height: int = 40,
    width: int = 64,
    *,
    channels: int = 3,
    disparity: int = 5,
    times: tuple[float, float] = (0.04, 0.16),
    dtype: type = np.uint8,
    white: int | None = None,
    seed: int = 3,
) -> StereoPair:
    """Return a fronto-parallel textured wall seen by a gamma 2.2 camera at two exposures, MV left."""
    rng = np.random.default_rng(seed)
    texture = smooth_codes(rng, height, width + disparity, channels)
    texture += rng.uniform(-20, 20, texture.shape)
    scene = 12.0 * (np.clip(texture, 3, 255) / 255.0) ** 2.2
    white = white or int(np.iinfo(dtype).max)

    def expose(radiance: np.ndarray, time: float) -> np.ndarray:
        return np.rint(np.clip(radiance * time, 0, 1) ** (1 / 2.2) * white).astype(dtype)

    left = Photo(expose(scene[:, :width], times[0]), times[0], white, name="left")
    right = Photo(expose(scene[:, disparity:], times[1]), times[1], white, name="right")
    return StereoPair(left, right)


@pytest.fixture
def pair() -> StereoPair:
    """A wall at disparity 5, exposures 1:4, 64x40 RGB, 8 bit."""
    return make_pair()


@pytest.fixture(scope="session")
def small_scene():
    """The room at 120x90, over- and under-exposed in the main view, ratio 16, with all truth."""
    from stereohdr.datasets.scene import EvaluationScene
    from stereohdr.simulation import Camera, expose_pair, room

    scene = room(width=120, height=90)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    left, right = scene.radiance_left / scale, scene.radiance_right / scale
    camera = Camera()
    return EvaluationScene(
        name="small-room",
        pair=expose_pair(left, right, (2.0, 0.125), camera, 3),
        reference=left,
        reference_clipped=np.zeros((90, 120), bool),
        max_disparity=scene.max_disparity,
        disparity_main=scene.disparity_left,
        disparity_auxiliary=scene.disparity_right,
        response=camera.response_curve(3),
        kind="procedural",
    )


@pytest.fixture(scope="session")
def world():
    """A textured world for rectification, made once."""
    from stereo_rigs import World

    return World()
