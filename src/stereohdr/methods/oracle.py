"""Method ``oracle``: the paper's fusion, given the true disparity and response: what perfect stereo brings."""

from __future__ import annotations

from dataclasses import replace

from stereohdr.config import OracleConfig
from stereohdr.errors import ConfigError
from stereohdr.methods.paper import fuse_paper
from stereohdr.model import Disparity, HdrResult, ResponseCurve, StereoPair
from stereohdr.stage_log import StageLog
from stereohdr.warping import without_occluded


def fuse_oracle(
    pair: StereoPair,
    config: OracleConfig,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
) -> HdrResult:
    """Run method ``paper`` on a known disparity, trusting every warped pixel; occluded ones are not warped.

    Raises
    ------
    ConfigError
        No disparity is given.
    """
    if disparity is None:
        raise ConfigError(
            "method 'oracle' needs the true disparity of the auxiliary view; give fuse(..., disparity=...), "
            "or choose a method that estimates it"
        )
    if response is None:
        log.warn("method 'oracle' expects the true response; without one it is estimated from the pair")
    visible = without_occluded(disparity)
    result = fuse_paper(pair, config, response=response, disparity=visible, log=log, threads=threads)
    return replace(result, method="oracle", disparity=disparity)
