"""One row of a quality table: one contender on one scene, with every metric."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereohdr import HdrResult, StereoHdrWarning
from stereohdr.bench.contenders import best_known_response, ceiling_radiance, run_contender
from stereohdr.bench.published import published_score
from stereohdr.datasets.scene import EvaluationScene, channel_mask, luminance_mask, visible_in_auxiliary
from stereohdr.metrics import aligning_scale, log2_error, log2_rmse
from stereohdr.metrics.hdrvdp2 import HdrVdp2Result, hdrvdp2
from stereohdr.metrics.protocol import Protocol
from stereohdr.metrics.pu21 import pu21_psnr, pu21_ssim
from stereohdr.metrics.radiometric import response_rmse
from stereohdr.metrics.stereo import bad_share
from stereohdr.model import DisparityFlag
from stereohdr.radiance import initial_radiance

SMALLEST_GAP_Q = 1.0
"""Points of Q that perfect stereo must gain over the main view alone for a share of it to mean anything."""

SMALLEST_GAP_PU = 1.0
"""The same in dB of PU21-PSNR."""


@dataclass(frozen=True)
class Row:
    """Scores of one contender on one scene; None where a score does not exist."""

    scene: str
    method: str
    q: float | None = None
    """HDR-VDP-2.2.1 Q, 100 is best."""
    qv: float | None = None
    """Q with the reference put where the auxiliary view sees nothing."""
    q_mos: float | None = None
    """Q_MOS of 2.2.0."""
    pu21_psnr: float | None = None
    """dB."""
    pu21_ssim: float | None = None
    log2_rmse: float | None = None
    """Stops, all pixels."""
    log2_rmse_s: float | None = None
    """Stops, in S."""
    log2_rmse_sx_visible: float | None = None
    """Stops, where any channel is out of range and the auxiliary view sees the pixel."""
    bad1: float | None = None
    """Share (0..1) of the estimated, visible auxiliary pixels that are off by more than 1 px."""
    bad2: float | None = None
    """Off by more than 2 px."""
    bad2_sx: float | None = None
    """The same for pixels whose partner in the main view is in Sx."""
    response_rmse: float | None = None
    """RMS of ln X, codes 5 to 250."""
    gap_closed_q: float | None = None
    """Share of what perfect visible stereo gains in Q, with the same response; None below 1 point."""
    gap_closed_pu: float | None = None
    """The same for PU21-PSNR, None below 1 dB."""
    mv_only_q: float | None = None
    """Q of the main view alone with the same response."""
    mv_only_pu21_psnr: float | None = None
    """PU21-PSNR of the main view alone with the same response, dB."""
    published_q: float | None = None
    """The paper's own score on its own images."""
    seconds: float | None = None
    """Wall time of the method."""
    peak_mib: float | None = None
    """Peak memory of the process until the method is done, scene and interpreter included, MiB."""
    protocol: str = ""
    """Conditions of the comparison."""
    error: str = ""
    """Why there are no scores."""

    @classmethod
    def from_json(cls, content: dict) -> Row:
        """Return a row from a dictionary; unknown keys are ignored."""
        names = {field.name for field in fields(cls)}
        return cls(**{key: value for key, value in content.items() if key in names})


def score(
    scene: EvaluationScene,
    label: str,
    *,
    protocol: Protocol | None = None,
    threads: int | None = None,
    pictures: Path | None = None,
    run: Callable[..., HdrResult] = run_contender,
) -> Row:
    """Run one contender on one scene and score it.

    Parameters
    ----------
    scene, label
        What is run.
    protocol
        Conditions of the comparison.
    threads
        Threads to use; scores do not depend on it.
    pictures
        Existing folder for ``<scene>_<method>.png``, none by default.
    run
        What runs the contender.
    """
    protocol = protocol or Protocol()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        start = time.perf_counter()
        result = run(scene, label, threads=threads)
        seconds = time.perf_counter() - start
        peak = peak_mib()
        return _scored(scene, label, result, protocol, threads, seconds, peak, pictures)


def _scored(
    scene: EvaluationScene,
    label: str,
    result: HdrResult,
    protocol: Protocol,
    threads: int | None,
    seconds: float,
    peak: float | None,
    pictures: Path | None,
) -> Row:
    main = scene.pair.main_photo

    def vdp(test: NDArray[np.float64], reference: NDArray[np.float64]) -> HdrVdp2Result:
        return hdrvdp2(
            test,
            reference,
            encoding=protocol.encoding_for(test.shape[2]),
            pixels_per_degree=protocol.pixels_per_degree,
            threads=threads,
        )

    shown, reference, report = protocol.show(result.radiance, scene.reference, main=main)
    seen = vdp(shown, reference)
    psnr = pu21_psnr(shown, reference)
    error = log2_error(shown, reference)
    visible = visible_in_auxiliary(scene)

    main_radiance = initial_radiance(main, result.response, exposure=scene.pair.exposures[0])
    mv_shown = protocol.show(main_radiance, scene.reference, main=main)[0]
    mv_q, mv_psnr = vdp(mv_shown, reference).q, pu21_psnr(mv_shown, reference)
    gap_q = gap_pu = None
    ceiling = ceiling_radiance(scene, main_radiance, "C3")
    if ceiling is not None:
        ceiling_shown = protocol.show(ceiling, scene.reference, main=main)[0]
        gap_q = _gap_closed(seen.q, mv_q, vdp(ceiling_shown, reference).q, SMALLEST_GAP_Q)
        gap_pu = _gap_closed(psnr, mv_psnr, pu21_psnr(ceiling_shown, reference), SMALLEST_GAP_PU)

    bad1, bad2, bad2_sx = _disparity_scores(scene, result)
    known_response = best_known_response(scene)
    if pictures is not None:
        _draw(pictures / f"{scene.name}_{label}.png", scene, result, seen, main_radiance)
    return Row(
        scene=scene.name,
        method=label,
        q=seen.q,
        qv=None if visible is None else vdp(np.where(visible[..., None], shown, reference), reference).q,
        q_mos=seen.q_mos,
        pu21_psnr=_finite(psnr),
        pu21_ssim=pu21_ssim(shown, reference),
        log2_rmse=log2_rmse(error),
        log2_rmse_s=_finite(log2_rmse(error, luminance_mask(scene))),
        log2_rmse_sx_visible=(
            None if visible is None else _finite(log2_rmse(error, channel_mask(scene) & visible))
        ),
        bad1=bad1,
        bad2=bad2,
        bad2_sx=bad2_sx,
        response_rmse=None if known_response is None else response_rmse(result.response, known_response),
        gap_closed_q=gap_q,
        gap_closed_pu=gap_pu,
        mv_only_q=mv_q,
        mv_only_pu21_psnr=_finite(mv_psnr),
        published_q=published_score(scene.name, label),
        seconds=seconds,
        peak_mib=peak,
        protocol=report,
    )


def _gap_closed(score: float, main_only: float, ceiling: float, smallest: float) -> float | None:
    gap = ceiling - main_only
    return (score - main_only) / gap if math.isfinite(gap) and gap > smallest else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _disparity_scores(
    scene: EvaluationScene, result: HdrResult
) -> tuple[float | None, float | None, float | None]:
    """Return bad1, bad2, and bad2 where the partner is in Sx."""
    truth = scene.disparity_auxiliary
    if truth is None:
        return None, None, None
    visible = truth.flags == DisparityFlag.MATCHED
    partner_in_sx = visible & _seen_from_auxiliary(scene, channel_mask(scene))
    return (
        _finite(bad_share(result.disparity, truth, threshold=1, region=visible)),
        _finite(bad_share(result.disparity, truth, threshold=2, region=visible)),
        _finite(bad_share(result.disparity, truth, threshold=2, region=partner_in_sx)),
    )


def _seen_from_auxiliary(scene: EvaluationScene, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return for each auxiliary pixel whether its true partner in the main view is in `mask`."""
    assert scene.disparity_auxiliary is not None
    height, width = mask.shape
    shift = np.rint(scene.disparity_auxiliary.values).astype(np.intp)
    column = np.arange(width) + (shift if scene.pair.main == "left" else -shift)
    inside = (column >= 0) & (column < width)
    return inside & mask[np.arange(height)[:, None], np.clip(column, 0, width - 1)]


def peak_mib() -> float | None:
    """Return the peak memory of this process so far in MiB; None where the system does not tell."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        return int(status.partition("VmHWM:")[2].split()[0]) / 2**10
    except (OSError, IndexError, ValueError):  # not Linux, where `ru_maxrss` would hold the parent's memory, too
        pass
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def _draw(
    path: Path,
    scene: EvaluationScene,
    result: HdrResult,
    seen: HdrVdp2Result,
    main_radiance: NDArray[np.float32],
) -> None:
    from stereohdr.io.images import write_png
    from stereohdr.pictures import (
        contact_sheet,
        heat,
        source_colours,
        tonemap_together,
        visibility_picture,
    )

    main = scene.pair.main_photo
    scale, mv_scale = (
        np.float32(aligning_scale(image, scene.reference, main)) for image in (result.radiance, main_radiance)
    )
    truth, alone, fused = tonemap_together([scene.reference, main_radiance * mv_scale, result.radiance * scale])
    tiles = [
        ("reference", truth),
        ("main view only", alone),
        (result.method, fused),
        (f"seen by HDR-VDP-2: Q {seen.q:.1f}", visibility_picture(seen.p_map, scene.reference)),
        ("disparity of the auxiliary view", heat(result.disparity.values, high=scene.max_disparity)),
        ("source: grey main, green auxiliary, others filled", source_colours(result.source)),
    ]
    write_png(path, contact_sheet(tiles, columns=3, title=f"{scene.name}: {result.method}"))


def as_json(row: Row) -> dict:
    """Return a row as a dictionary of strings, numbers and None."""
    return asdict(row)
