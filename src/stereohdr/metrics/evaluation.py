"""All metrics of one comparison under one protocol."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import ConfigError, MissingDependencyError, StereoHdrWarning
from stereohdr.metrics.colorvideovdp import cvvdp_jod
from stereohdr.metrics.hdrvdp2 import HdrVdp2Result, hdrvdp2
from stereohdr.metrics.protocol import Protocol
from stereohdr.metrics.pu21 import pu21_psnr, pu21_ssim
from stereohdr.metrics.radiometric import log2_error, log2_rmse, share_off
from stereohdr.model import Photo

METRICS = ("hdrvdp2", "pu21", "log2", "cvvdp")
"""What can be asked for; ``cvvdp`` needs the extra of that name."""

DEFAULT_METRICS = ("hdrvdp2", "pu21", "log2")


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of one comparison.

    Parameters
    ----------
    scores
        By metric, ready for JSON; an infinite PSNR (equal images) is None.
    report
        The protocol in one line.
    hdrvdp2
        Everything of HDR-VDP-2, if it was asked for.
    """

    scores: dict[str, Any]
    report: str
    hdrvdp2: HdrVdp2Result | None


def evaluate(
    test: NDArray[Any],
    reference: NDArray[Any],
    *,
    protocol: Protocol | None = None,
    metrics: Collection[str] = DEFAULT_METRICS,
    main: Photo | None = None,
    threads: int | None = None,
) -> Evaluation:
    """Compare an HDR image with a reference.

    Parameters
    ----------
    test, reference
        ``(H, W, C)`` radiance of the same view, finite, >= 0.
    protocol
        Viewing conditions and scales.
    metrics
        Some of `METRICS`.
    main
        The photo of the view; see `Protocol.show`.
    threads
        Threads to use; does not change a score.

    Raises
    ------
    ConfigError
        Unknown metric.
    InputError
        Images that cannot be compared.

    Warns
    -----
    StereoHdrWarning
        A metric was left out because its package is not installed.
    """
    protocol = protocol or Protocol()
    unknown = [name for name in metrics if name not in METRICS]
    if unknown or not metrics:
        raise ConfigError(f"unknown metric {', '.join(unknown) or '(none)'}; use some of {', '.join(METRICS)}")
    shown_test, shown_reference, report = protocol.show(test, reference, main=main)
    channels = test.shape[2]
    scores: dict[str, Any] = {}
    vdp: HdrVdp2Result | None = None
    if "hdrvdp2" in metrics:
        with warnings.catch_warnings():
            # Its hint that the image may not be in cd/m2 does not apply: the protocol has seen to that.
            warnings.simplefilter("ignore", StereoHdrWarning)
            vdp = hdrvdp2(
                shown_test,
                shown_reference,
                encoding=protocol.encoding_for(channels),
                pixels_per_degree=protocol.pixels_per_degree,
                threads=threads,
            )
        scores["hdrvdp2"] = {"q": vdp.q, "q_mos": vdp.q_mos, "p_det": vdp.p_det, "c_max": vdp.c_max}
    if "pu21" in metrics:
        psnr = pu21_psnr(shown_test, shown_reference)
        scores["pu21_psnr"] = psnr if np.isfinite(psnr) else None
        scores["pu21_ssim"] = pu21_ssim(shown_test, shown_reference)
    if "log2" in metrics:
        error = log2_error(shown_test, shown_reference)
        scores["log2_rmse"] = log2_rmse(error)
        scores["share_off_third_stop"] = share_off(error)
    if "cvvdp" in metrics:
        try:
            scores["cvvdp_jod"] = cvvdp_jod(
                shown_test, shown_reference, pixels_per_degree=protocol.pixels_per_degree
            )
        except MissingDependencyError as error:
            warnings.warn(f"cvvdp left out: {error}", StereoHdrWarning, stacklevel=2)
    used = replace(protocol, encoding=protocol.encoding_for(channels))
    scores["protocol"] = {**asdict(used), "report": report}
    return Evaluation(scores, report, vdp)
