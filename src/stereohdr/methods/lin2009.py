"""Method ``lin2009``: after Lin and Chang 2009.

A stand-in: the original's inner details are not public. Known: the response from SIFT matches between the views;
stereo matching on radiance; fusion of both views. Chosen here: normalised cross-correlation of 9x9 windows,
winner takes all, a left-right check; fusion everywhere with Debevec's weights, the main view alone where the
check fails.
"""

from __future__ import annotations

from stereohdr.config import Lin2009Config
from stereohdr.disparity import match_windows
from stereohdr.fusion import code_weight, merge_views
from stereohdr.methods.merged import merged_result
from stereohdr.model import Disparity, HdrResult, ResponseCurve, StereoPair
from stereohdr.radiance import exposure_map, initial_radiance, luminance
from stereohdr.response import estimate_response
from stereohdr.stage_log import StageLog
from stereohdr.warping import main_view_disparity, warp_backward


def fuse_lin2009(
    pair: StereoPair,
    config: Lin2009Config,
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
        response = response or estimate_response(pair, config=config.response, max_disparity=max_disparity)

    with log.stage("radiance"):
        R_m = initial_radiance(main, response, exposure=t_m)
        R_a = initial_radiance(auxiliary, response, exposure=t_a)
        S = exposure_map(main, config=config.exposure_map)
        log.keep(main_radiance=R_m, auxiliary_radiance=R_a, exposure_map=S)

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

    with log.stage("fusion"):
        R, share = merge_views(R_m, R_w, code_weight(main, shorter=t_m < t_a), w_a)
        log.keep(share=share)

    return merged_result(
        "lin2009",
        config,
        radiance=R,
        share=share,
        exposure_map=S,
        of_main=D_m,
        of_auxiliary=D_a,
        max_disparity=max_disparity,
        response=response,
    )
