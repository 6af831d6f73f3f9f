"""A textured scene seen by two cameras that are turned, rolled and distorted in a known way."""

import numpy as np
from scipy import ndimage

from stereohdr import Photo
from stereohdr.rectification import CameraModel, StereoCalibration
from stereohdr.rectification.geometry import rotation_matrix

WIDTH, HEIGHT, FOCAL = 360, 270, 360.0
BASELINE = 0.1


def camera(focal=FOCAL, distortion=(), lens="plumb-bob", size=(WIDTH, HEIGHT), centre=None):
    x, y = centre or ((size[0] - 1) / 2, (size[1] - 1) / 2)
    return CameraModel(np.array([[focal, 0, x], [0, focal, y], [0, 0, 1]]), distortion, lens, size)


def degrees(pitch, turn, roll):
    """Return the rotation that takes a camera's frame into the common one."""
    return rotation_matrix(np.radians([pitch, turn, roll]))


def rig(left=(0, 0, 0), right=(0, 0, 0), cameras=None):
    """Return two cameras turned by these angles (pitch, turn, roll in degrees), the right one at x = 0.1 m."""
    from_left, from_right = degrees(*left), degrees(*right)
    one, other = cameras or (camera(), camera())
    return StereoCalibration(one, other, from_right.T @ from_left, from_right.T @ [-BASELINE, 0, 0])


class World:
    """A bumpy, textured wall of which both cameras see every point; radiance over seven stops."""

    def __init__(self, seed=0, near=40.0, far=12.0):
        rng = np.random.default_rng(seed)
        shape = (3 * HEIGHT, 3 * WIDTH)
        texture = sum(
            sigma * ndimage.gaussian_filter(rng.normal(size=shape), sigma, mode="wrap") for sigma in (1.2, 2.5, 6)
        )
        self._texture = ndimage.spline_filter(np.exp2(2.2 * texture / texture.std()))
        bumps = ndimage.gaussian_filter(rng.normal(size=shape), 60, mode="wrap")
        bumps = (bumps - bumps.min()) / np.ptp(bumps)
        self._disparity = far + (near - far) * bumps
        self.tint = np.array([1.0, 0.8, 0.6])

    def disparity(self, x, y):
        """Disparity of the point that the right rectified view (focal length FOCAL) has at (x, y)."""
        return ndimage.map_coordinates(self._disparity, [y + HEIGHT, x + WIDTH], order=1, mode="wrap")

    def radiance(self, side, x, y):
        """Radiance ``(..., 3)`` at positions of a rectified view."""
        if side == "right":
            x = x + self.disparity(x, y)
        at = [y + HEIGHT, x + WIDTH]
        grey = ndimage.map_coordinates(self._texture, at, order=3, mode="wrap", prefilter=False)
        return np.maximum(grey, 0.01)[..., None] * self.tint

    def seen(self, side, model, rotation=None):
        """Radiance ``(H, W, 3)`` that a camera sees whose frame `rotation` takes into the common one."""
        x, y = np.meshgrid(np.arange(model.size[0]), np.arange(model.size[1]))
        rays = model.to_rays(np.stack([x, y], axis=-1).astype(float))
        turned = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
        turned = turned @ (np.eye(3) if rotation is None else rotation).T
        slopes = turned[..., :2] / turned[..., 2:]
        px, py = FOCAL * slopes[..., 0] + (WIDTH - 1) / 2, FOCAL * slopes[..., 1] + (HEIGHT - 1) / 2
        return self.radiance(side, px, py)


def photo(radiance, time, *, bits=8, name="photo", seed=0):
    """Expose with an sRGB response (12 bits: linear), some noise, white at radiance 1 / time."""
    exposure = radiance * time
    exposure = exposure + np.random.default_rng(seed).normal(0, 0.002, exposure.shape)
    share = np.clip(exposure, 0, 1)
    if bits == 12:
        return Photo(np.rint(share * 4095).astype(np.uint16), time, 4095, name=name)
    share = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    return Photo(np.rint(share * 255).astype(np.uint8), time, name=name)


def photographed(world, left=(0, 0, 0), right=(0, 0, 0), cameras=None, times=(0.5, 0.03125), bits=8):
    """Return the photos of both cameras of `rig`, by default at a ratio of 16."""
    one, other = cameras or (camera(), camera())
    return (
        photo(world.seen("left", one, degrees(*left)), times[0], bits=bits, name="left.png", seed=1),
        photo(world.seen("right", other, degrees(*right)), times[1], bits=bits, name="right.png", seed=2),
    )
