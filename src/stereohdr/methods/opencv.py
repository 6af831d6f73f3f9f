"""Method ``opencv``: what one would script today with OpenCV. Needs the extra ``opencv``.

A stand-in for such a script, not after a paper: grey photos, the auxiliary one brought to the brightness of the
main one by histogram matching; StereoSGBM with the values of OpenCV's samples; `remap` of the auxiliary codes;
MergeDebevec with the response. OpenCV's stereo and merge take 8 bits, so deeper codes are reduced for them;
pixels without a disparity keep the main view's radiance in full depth.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import OpencvConfig, OpencvStereoConfig
from stereohdr.errors import MissingDependencyError
from stereohdr.fusion import NEGLIGIBLE_WEIGHT
from stereohdr.methods.merged import merged_result
from stereohdr.model import RESPONSE_KNOTS, Disparity, DisparityFlag, HdrResult, Photo, ResponseCurve, StereoPair
from stereohdr.radiance import code_luma, exposure_map, initial_radiance
from stereohdr.response import estimate_response
from stereohdr.stage_log import StageLog
from stereohdr.warping import auxiliary_view_disparity, main_view_disparity

if TYPE_CHECKING:
    from types import ModuleType

SMALLEST_WIDTH = 32
"""StereoSGBM refuses narrower images; they are padded."""

CLIPPED_WEIGHT = 1e-6
"""What MergeDebevec gives to a pixel that is clipped in all channels; else it takes the mean hat weight."""


def fuse_opencv(
    pair: StereoPair,
    config: OpencvConfig,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
) -> HdrResult:
    """Fuse a pair whose main view is the left one; the number of threads is OpenCV's own affair.

    Raises
    ------
    MissingDependencyError
        OpenCV is not installed.
    """
    cv2 = _opencv()
    main, auxiliary = pair.main_photo, pair.auxiliary_photo
    t_m, t_a = pair.exposures
    max_disparity = config.search_range(main.width)

    with log.stage("response"):
        response = response or estimate_response(pair, config=config.response, max_disparity=max_disparity)

    with log.stage("radiance"):
        R_m = initial_radiance(main, response, exposure=t_m)
        S = exposure_map(main, config=config.exposure_map)
        log.keep(main_radiance=R_m, exposure_map=S)

    with log.stage("disparity"):
        if disparity is None:
            matched = _histogram_matched(_grey(auxiliary), _grey(main))
            D_m = _sgbm(cv2, _grey(main), matched, max_disparity, config.stereo)
            D_a = auxiliary_view_disparity(D_m)
        else:
            D_m, D_a = main_view_disparity(disparity), disparity
        log.keep(main_disparity=D_m.values, auxiliary_disparity=D_a.values)

    with log.stage("warping"):
        y, x = np.indices(D_m.values.shape, dtype=np.float32)
        warped = cv2.remap(_codes8(auxiliary), x - D_m.values, y, cv2.INTER_LINEAR).reshape(main.codes.shape)
        arrived = (D_m.flags == DisparityFlag.MATCHED) & (x >= D_m.values)
        log.keep(warped_codes=warped, arrived=arrived)

    with log.stage("fusion"):
        views = [_codes8(main), warped]
        times = np.array([t_m, t_a], dtype=np.float32)
        table = response.exposure_table(RESPONSE_KNOTS - 1).T.astype(np.float32)
        merged = cv2.createMergeDebevec().process(views, times, np.ascontiguousarray(table[:, None]))
        w_m, w_a = (np.minimum(view, 255 - view).mean(axis=2) + CLIPPED_WEIGHT for view in views)
        share = w_a / (w_m + w_a)
        W = np.where(arrived & (share >= NEGLIGIBLE_WEIGHT), share, 0.0).astype(np.float32)
        R = np.where(W[..., None] > 0, merged.reshape(R_m.shape), R_m)
        log.keep(weight=W)

    return merged_result(
        "opencv",
        config,
        radiance=R,
        share=W[..., None],
        exposure_map=S,
        of_main=D_m,
        of_auxiliary=D_a,
        max_disparity=max_disparity,
        response=response,
    )


def _opencv() -> ModuleType:
    try:
        import cv2  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingDependencyError("method 'opencv' needs OpenCV; install stereohdr[opencv]") from error
    return cv2


def _codes8(photo: Photo) -> NDArray[np.uint8]:
    """Return the codes ``(H, W, C)`` with white at 255."""
    return np.rint(photo.codes * (255.0 / photo.white)).astype(np.uint8)


def _grey(photo: Photo) -> NDArray[np.uint8]:
    return np.rint(code_luma(photo)).astype(np.uint8)


def _histogram_matched(image: NDArray[np.uint8], template: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return `image` with its codes replaced so that its histogram becomes that of `template`."""
    of_image, of_template = (
        np.cumsum(np.bincount(grey.ravel(), minlength=RESPONSE_KNOTS)) / grey.size for grey in (image, template)
    )
    return np.interp(of_image, of_template, np.arange(RESPONSE_KNOTS)).round().astype(np.uint8)[image]


def _sgbm(
    cv2: ModuleType,
    main: NDArray[np.uint8],
    auxiliary: NDArray[np.uint8],
    max_disparity: int,
    config: OpencvStereoConfig,
) -> Disparity:
    """Return StereoSGBM's disparity of the main (left) view; ``NOT_COMPUTED`` where it finds none."""
    disparities = 16 * (max_disparity // 16 + 1)
    # StereoSGBM leaves out as many columns on the left as it searches disparities: padding brings them back.
    pad = disparities + max(0, SMALLEST_WIDTH - main.shape[1])
    left, right = (cv2.copyMakeBorder(view, 0, 0, pad, 0, cv2.BORDER_REPLICATE) for view in (main, auxiliary))
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=disparities,
        blockSize=config.block_size,
        P1=config.small_penalty * config.block_size**2,
        P2=config.large_penalty * config.block_size**2,
        disp12MaxDiff=config.tolerance,
        uniquenessRatio=config.uniqueness,
        speckleWindowSize=config.speckle_size,
        speckleRange=config.speckle_range,
    )
    values = matcher.compute(left, right)[:, pad:].astype(np.float32) / 16
    found = (values >= 0) & (values <= max_disparity)
    flags = np.where(found, DisparityFlag.MATCHED, DisparityFlag.NOT_COMPUTED).astype(np.uint8)
    return Disparity(np.where(found, values, np.float32(0)), flags)
