"""Bringing two views onto common rows: from a calibration, or from nothing but the pictures."""

from stereohdr.rectification.calibration import Board, BoardCalibration, BoardView, calibrate_stereo, find_board
from stereohdr.rectification.calibration_files import read_calibration, write_calibration
from stereohdr.rectification.geometry import Rectification, StereoCalibration
from stereohdr.rectification.lenses import CameraModel
from stereohdr.rectification.pair import RectifiedPair, doubts, rectified_photos, rectify_pair
from stereohdr.rectification.unrectify import unrectified

__all__ = [
    "Board",
    "BoardCalibration",
    "BoardView",
    "CameraModel",
    "Rectification",
    "RectifiedPair",
    "StereoCalibration",
    "calibrate_stereo",
    "doubts",
    "find_board",
    "read_calibration",
    "rectified_photos",
    "rectify_pair",
    "unrectified",
    "write_calibration",
]
