"""Simulated cameras and scenes with exact ground truth."""

from stereohdr.simulation.camera import Camera, expose, expose_pair, reexpose_codes
from stereohdr.simulation.scenes import SCENES, StereoScene, poles, room, slanted_plane, street_night

__all__ = [
    "SCENES",
    "Camera",
    "StereoScene",
    "expose",
    "expose_pair",
    "poles",
    "reexpose_codes",
    "room",
    "slanted_plane",
    "street_night",
]
