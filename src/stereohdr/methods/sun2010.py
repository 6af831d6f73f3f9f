"""Method ``sun2010``: after Sun, Mansour and Ward 2010.

A stand-in: the original's inner details are not public. Known: a first matching under an assumed gamma, on log
intensities, with a cross-correlation of adaptively weighted windows; a response fitted to the matched pixels; a
second matching on radiance. Chosen here: 9x9 windows with bilateral weights, winner takes all and a left-right
check instead of a global optimisation; a gamma curve times the exponential of a cubic as response; fusion as in
``lin2009``.
"""

from __future__ import annotations

import numpy as np

from stereohdr.config import Sun2010Config
from stereohdr.disparity import match_windows
from stereohdr.fusion import code_weight, merge_views
from stereohdr.methods.merged import merged_result
from stereohdr.model import Disparity, HdrResult, ResponseCurve, StereoPair
from stereohdr.radiance import exposure_map, initial_radiance, luminance
from stereohdr.response import fit_polynomial_response
from stereohdr.stage_log import StageLog
from stereohdr.warping import main_view_disparity, warp_backward


def fuse_sun2010(
    pair: StereoPair,
    config: Sun2010Config,
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
    S = exposure_map(main, config=config.exposure_map)

    def match(curve: ResponseCurve) -> tuple[Disparity, Disparity]:
        if disparity is not None:
            return main_view_disparity(disparity), disparity
        L_a, L_m = (
            np.log(luminance(initial_radiance(photo, curve, exposure=t)))
            for photo, t in ((auxiliary, t_a), (main, t_m))
        )
        return match_windows(
            L_a,
            L_m,
            max_disparity=max_disparity,
            config=config.matching,
            bilateral=config.bilateral,
            threads=threads,
        )

    if response is None:
        gamma = ResponseCurve.gamma(config.response.initial_gamma, main.channels)
        with log.stage("first disparity"):
            D_first, _ = match(gamma)
            log.keep(first_disparity=D_first.values)
        with log.stage("response"):
            response = fit_polynomial_response(pair, D_first, config=config.response)
            if response is None:
                response = gamma
                log.warn("too few pixels match to fit a response; the assumed gamma curve is kept")

    with log.stage("radiance"):
        R_m = initial_radiance(main, response, exposure=t_m)
        R_a = initial_radiance(auxiliary, response, exposure=t_a)
        log.keep(main_radiance=R_m, auxiliary_radiance=R_a, exposure_map=S)

    with log.stage("disparity"):
        D_m, D_a = match(response)
        log.keep(main_disparity=D_m.values, auxiliary_disparity=D_a.values)

    with log.stage("warping"):
        R_w, arrived = warp_backward(R_a, D_m)
        w_a, _ = warp_backward(code_weight(auxiliary, shorter=t_a < t_m), D_m)
        log.keep(warped=R_w, arrived=arrived)

    with log.stage("fusion"):
        R, share = merge_views(R_m, R_w, code_weight(main, shorter=t_m < t_a), w_a)
        log.keep(share=share)

    return merged_result(
        "sun2010",
        config,
        radiance=R,
        share=share,
        exposure_map=S,
        of_main=D_m,
        of_auxiliary=D_a,
        max_disparity=max_disparity,
        response=response,
    )
