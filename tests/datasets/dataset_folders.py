"""Folders of image data as users have them, written by our own writers: small walls at one disparity."""

import imagecodecs
import numpy as np

from stereohdr.io.images import write_png
from stereohdr.simulation import Camera, expose

from conftest import smooth_codes

CAMERA = Camera(response="gamma", noise=False)


class Wall:
    """A textured wall, ``(height, width, 3)``, seen by cameras side by side; 1 is white at one second."""

    def __init__(self, height, width, disparity, seed=4):
        rng = np.random.default_rng(seed)
        self.disparity, self.width = disparity, width
        texture = smooth_codes(rng, height, width + 2 * disparity)
        texture += rng.uniform(-10, 10, texture.shape)
        self.texture = 4.0 * (np.clip(texture, 12, 255) / 255) ** 2.2

    def radiance(self, shift):
        """Radiance seen by a camera that is `shift` disparities to the right of the first one."""
        start = round(shift * self.disparity)
        return self.texture[:, start : start + self.width]

    def codes(self, shift, time):
        return expose(self.radiance(shift), time, CAMERA, seed=0).codes.astype(np.uint8)

    def write_truth(self, folder, factor):
        stored = np.full((*self.texture.shape[:1], self.width), self.disparity * factor, np.uint8)
        stored[:2, :3] = 0
        for view in (1, 5):
            write_png(folder / f"disp{view}.png", stored)


def write_official(folder, wall, factor, illumination=1, times=(0.25, 1.0, 4.0)):
    """Write ``Illum/Exp/view`` with views 1 and 5, full `wall.disparity` apart."""
    for exposure, time in enumerate(times):
        there = folder / f"Illum{illumination}" / f"Exp{exposure}"
        there.mkdir(parents=True)
        (there / "exposure_ms.txt").write_text(f"{1000 * time:g}\n")
        for view in (1, 5):
            write_png(there / f"view{view}.png", wall.codes((view - 1) / 4, time))
    wall.write_truth(folder, factor)


def write_deep_png(path, codes):
    path.write_bytes(imagecodecs.png_encode(np.asarray(codes, np.uint16)))


ART_WIDTH = 260
"""Columns of what `write_art` writes: more than the search range of full size."""


def write_art(data):
    """Write ``middlebury2005_full/Art`` below `data`: a flat folder, 1110 rows, 24 px between views 1 and 5."""
    folder = data / "middlebury2005_full" / "Art"
    folder.mkdir(parents=True)
    wall = Wall(1110, ART_WIDTH, 24)
    for view, exposure, time in ((1, 0, 0.25), (1, 1, 1.0), (2, 1, 1.0), (2, 2, 4.0), (5, 1, 1.0)):
        name = f"view{view}_Illum1_Exp{exposure}_{round(1000 * time)}ms.png"
        write_png(folder / name, wall.codes((view - 1) / 4, time))
    (folder / "exposure_ms.txt").write_text("250\n1000\n4000\n")
    wall.write_truth(folder, 1)
    return folder
