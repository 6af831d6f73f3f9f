"""Method ``baetz2014``: after Baetz et al. 2014.

A stand-in: the original's inner details are not public. Known: the response is calibrated offline, not estimated
from the pair; a saturation mask sees to it that only the pixels that need it come from the auxiliary view. Chosen
here: normalised cross-correlation of 9x9 windows, winner takes all, a left-right check; as mask the map S of
equation 1 of the paper, dark and bright; where no match is confirmed, the radiance of the nearest background
pixel of the row.
"""

from __future__ import annotations

import numpy as np

from stereohdr.config import Baetz2014Config
from stereohdr.disparity import match_windows
from stereohdr.fusion import BOUND_WEIGHT, code_weight, merge_views
from stereohdr.methods.merged import merged_result
from stereohdr.model import Disparity, DisparityFlag, HdrResult, ResponseCurve, StereoPair
from stereohdr.radiance import exposure_map, initial_radiance, luminance
from stereohdr.response import estimate_response
from stereohdr.restoration import fill_from_background
from stereohdr.stage_log import StageLog
from stereohdr.warping import main_view_disparity, warp_backward


def fuse_baetz2014(
    pair: StereoPair,
    config: Baetz2014Config,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
) -> HdrResult:
    """Fuse a pair whose main view is the left one; a stand-in, see the module."""
    main, auxiliary = pair.main_photo, pair.auxiliary_photo
    t_m, t_a = pair.exposures
    max_disparity = config.search_range(main.width)

    with log.stage("response"):
        if response is None:
            response = estimate_response(pair, config=config.response, max_disparity=max_disparity)
            log.warn("method 'baetz2014' expects a calibrated response; without one it is estimated from the pair")

    with log.stage("radiance"):
        R_m = initial_radiance(main, response, exposure=t_m)
        R_a = initial_radiance(auxiliary, response, exposure=t_a)
        log.keep(main_radiance=R_m, auxiliary_radiance=R_a)

    with log.stage("exposure map"):
        S = exposure_map(main, config=config.exposure_map)
        log.keep(exposure_map=S)

    with log.stage("disparity"):
        if disparity is None:
            D_m, D_a = match_windows(
                luminance(R_a),
                luminance(R_m),
                max_disparity=max_disparity,
                config=config.matching,
                threads=threads,
            )
        else:
            D_m, D_a = main_view_disparity(disparity), disparity
        log.keep(main_disparity=D_m.values, auxiliary_disparity=D_a.values)

    with log.stage("warping"):
        R_w, arrived = warp_backward(R_a, D_m)
        w_a, _ = warp_backward(code_weight(auxiliary, shorter=t_a < t_m), D_m)
        log.keep(warped=R_w, arrived=arrived)

    with log.stage("filling"):
        holes = S & (D_m.flags != DisparityFlag.MATCHED)
        R_f, filled = fill_from_background(R_w, D_m, holes)
        w_f, _ = fill_from_background(w_a, D_m, holes)
        log.keep(holes=holes, filled=R_f)

    with log.stage("fusion"):  # the auxiliary view inside the mask, the main view outside
        mask = S[..., None]
        w_m = code_weight(main, shorter=t_m < t_a)
        w_m = np.where(mask, np.minimum(w_m, np.float32(BOUND_WEIGHT)), w_m)
        R, share = merge_views(R_m, R_f, w_m, np.where(mask, w_f, np.float32(0)))
        log.keep(share=share)

    return merged_result(
        "baetz2014",
        config,
        radiance=R,
        share=share,
        exposure_map=S,
        filled=filled,
        of_main=D_m,
        of_auxiliary=D_a,
        max_disparity=max_disparity,
        response=response,
    )
