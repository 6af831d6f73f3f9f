"""Method ``mv-only``: the main view's initial radiance, without stereo. What every method has to beat."""

from __future__ import annotations

import numpy as np

from stereohdr.config import FuseConfig
from stereohdr.errors import ResponseError
from stereohdr.model import Disparity, HdrResult, ResponseCurve, SourceFlag, StereoPair
from stereohdr.radiance import exposure_map, initial_radiance
from stereohdr.response import estimate_response
from stereohdr.stage_log import StageLog


def fuse_mv_only(
    pair: StereoPair,
    config: FuseConfig,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
) -> HdrResult:
    """Return the main view's initial radiance; pixels of S are flagged as without information."""
    main = pair.main_photo
    with log.stage("response"):
        if response is None:
            try:
                response = estimate_response(pair)
            except ResponseError:
                response = ResponseCurve.srgb(main.channels)
                log.warn("the response cannot be estimated from this pair; the sRGB curve is assumed")
    with log.stage("radiance"):
        radiance = initial_radiance(main, response, exposure=pair.exposures[0])
        S = exposure_map(main, config=config.exposure_map)
        log.keep(main_radiance=radiance, exposure_map=S)
    flags = np.where(S, SourceFlag.NO_INFORMATION, SourceFlag.MEASURED).astype(np.uint8)
    nothing = np.zeros(S.shape, dtype=np.float32)
    return HdrResult(
        radiance=radiance,
        source=flags,
        weight=nothing,
        disparity=Disparity(nothing.copy(), np.zeros(S.shape, dtype=np.uint8)),
        response=response,
        method="mv-only",
        config=config,
        statistics={"clipped_share": float(S.mean()), "no_information_share": float(S.mean())},
    )
