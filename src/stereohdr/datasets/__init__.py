"""Scenes to measure methods on: Middlebury sets, POLAR, Boreal, folders with a manifest, simulated ones."""

from stereohdr.datasets.boreal import read_boreal
from stereohdr.datasets.brackets import StereoBracket, bracket_reference, bracket_scene, rectified_bracket
from stereohdr.datasets.ground_truth import known_disparities, read_disparity, warped_by_truth
from stereohdr.datasets.manifest import manifest_scene
from stereohdr.datasets.middlebury import (
    ExposurePair,
    MiddleburyFolder,
    exposure_scene,
    same_exposure_pair,
    two_view_pair,
)
from stereohdr.datasets.polar import read_polar
from stereohdr.datasets.registry import benchmark_scenes, load_scene
from stereohdr.datasets.scene import EvaluationScene, channel_mask, luminance_mask, visible_in_auxiliary
from stereohdr.datasets.simulated import SETTINGS, SameExposurePair, procedural_scene, reexposed_scene

__all__ = [
    "SETTINGS",
    "EvaluationScene",
    "ExposurePair",
    "MiddleburyFolder",
    "SameExposurePair",
    "StereoBracket",
    "benchmark_scenes",
    "bracket_reference",
    "bracket_scene",
    "channel_mask",
    "exposure_scene",
    "known_disparities",
    "load_scene",
    "luminance_mask",
    "manifest_scene",
    "procedural_scene",
    "read_boreal",
    "read_disparity",
    "read_polar",
    "rectified_bracket",
    "reexposed_scene",
    "same_exposure_pair",
    "two_view_pair",
    "visible_in_auxiliary",
    "warped_by_truth",
]
