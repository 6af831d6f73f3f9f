"""What the methods that merge the main view with a warped auxiliary view say about their result."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import FuseConfig
from stereohdr.fusion import merge_flags
from stereohdr.model import Disparity, DisparityFlag, HdrResult, ResponseCurve, SourceFlag


def merged_result(
    method: str,
    config: FuseConfig,
    *,
    radiance: NDArray[np.float32],
    share: NDArray[np.float32],
    exposure_map: NDArray[np.bool_],
    filled: NDArray[np.bool_] | None = None,
    of_main: Disparity,
    of_auxiliary: Disparity,
    max_disparity: int,
    response: ResponseCurve,
) -> HdrResult:
    """Collect the result of a merge.

    Parameters
    ----------
    method, config, response
        As in `HdrResult`.
    radiance, share
        ``(H, W, C)`` float32 from `merge_views`; the weight is the mean share over the channels.
    exposure_map, filled
        ``(H, W)`` bool, see `merge_flags`.
    of_main, of_auxiliary
        Disparities of both views; the result carries the auxiliary view's.
    max_disparity
        d_max, pixels.
    """
    weight = share.mean(axis=2, dtype=np.float32)
    source = merge_flags(weight, exposure_map=exposure_map, filled=filled)
    matched = of_auxiliary.values[of_auxiliary.flags == DisparityFlag.MATCHED]
    return HdrResult(
        radiance=radiance,
        source=source,
        weight=weight,
        disparity=of_auxiliary,
        response=response,
        method=method,
        config=config,
        statistics={
            "clipped_share": float(exposure_map.mean()),
            "occluded_share": float((of_main.flags != DisparityFlag.MATCHED).mean()),
            "no_information_share": float((source == SourceFlag.NO_INFORMATION).mean()),
            "disparity_searched": float(max_disparity),
            "disparity_min": float(matched.min()) if matched.size else 0.0,
            "disparity_max": float(matched.max(initial=0)),
        },
    )
