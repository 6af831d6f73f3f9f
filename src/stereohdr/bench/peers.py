"""Stereo matching by others, to compare speed with: OpenCV's StereoSGBM, and Pandora where it is installed."""

from __future__ import annotations

import logging
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import OpencvStereoConfig
from stereohdr.errors import MissingDependencyError

GreyView = NDArray[np.uint8]
"""``(H, W)``."""


def opencv_matcher(left: GreyView, right: GreyView, disparities: int, *, threads: int) -> Callable[[], Any]:
    """Return a call of OpenCV's `StereoSGBM` in MODE_HH: all eight paths, the map of the left view.

    Raises
    ------
    MissingDependencyError
        OpenCV is not installed.
    """
    try:
        import cv2  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingDependencyError(
            "bench speed measures in units of OpenCV's StereoSGBM; install stereohdr[opencv]"
        ) from error
    cv2.setNumThreads(threads)
    config = OpencvStereoConfig()
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=-(-disparities // 16) * 16,
        blockSize=config.block_size,
        P1=config.small_penalty * config.block_size**2,
        P2=config.large_penalty * config.block_size**2,
        disp12MaxDiff=config.tolerance,
        uniquenessRatio=config.uniqueness,
        mode=cv2.StereoSGBM_MODE_HH,
    )
    return lambda: matcher.compute(left, right)


def pandora_matcher(left: GreyView, right: GreyView, disparities: int) -> Callable[[], Any] | None:
    """Return a call of CNES' Pandora: census, SGM, sub-pixel, both views' maps and their cross-check.

    None where ``pandora`` or its plugin ``pandora_plugin_libsgm`` is not installed.
    """
    if find_spec("pandora") is None or find_spec("pandora_plugin_libsgm") is None:
        return None
    import pandora  # pyright: ignore[reportMissingImports]
    import xarray  # pyright: ignore[reportMissingImports]
    from pandora.img_tools import add_disparity  # pyright: ignore[reportMissingImports]
    from pandora.state_machine import PandoraMachine  # pyright: ignore[reportMissingImports]

    logging.getLogger("transitions.core").setLevel(logging.ERROR)
    pandora.import_plugin()

    def dataset(image: GreyView, interval: tuple[int, int]) -> Any:
        height, width = image.shape
        attributes = {"crs": None, "transform": None, "valid_pixels": 0, "no_data_mask": 1, "no_data_img": -9999}
        content = xarray.Dataset(
            {"im": (["row", "col"], image.astype(np.float32))},
            coords={"row": np.arange(height), "col": np.arange(width)},
            attrs=attributes,
        )
        return add_disparity(content, interval, None)

    views = dataset(left, (1 - disparities, 0)), dataset(right, (0, disparities - 1))
    machine = PandoraMachine()
    steps = {
        "matching_cost": {"matching_cost_method": "census", "window_size": 5},
        "optimization": {"optimization_method": "sgm"},
        "disparity": {"disparity_method": "wta", "invalid_disparity": "NaN"},
        "refinement": {"refinement_method": "vfit"},
        "validation": {"validation_method": "cross_checking_accurate"},
    }
    return lambda: pandora.run(machine, *views, {"pipeline": steps})
