"""Method ``paper``: Park, Ji, Kang, Jung and Ko, Sensors 2017, 17, 1473; reads like its Figure 1."""

from __future__ import annotations

from functools import partial

import numpy as np

from stereohdr.config import PaperConfig
from stereohdr.disparity import estimate_disparity
from stereohdr.fusion import blend, source_flags, weight_map
from stereohdr.model import Disparity, HdrResult, ResponseCurve, SourceFlag, StereoPair
from stereohdr.radiance import exposure_map, initial_radiance, luminance
from stereohdr.response import estimate_response
from stereohdr.restoration import edge_preserving_filter, fill_holes, poisson_edit, reject_uncertain
from stereohdr.segmentation import auxiliary_interest, main_interest, segment_photo
from stereohdr.stage_log import StageLog
from stereohdr.strips import run_together
from stereohdr.warping import warp_forward


def fuse_paper(
    pair: StereoPair,
    config: PaperConfig,
    *,
    response: ResponseCurve | None,
    disparity: Disparity | None,
    log: StageLog,
    threads: int | None,
) -> HdrResult:
    """Fuse a pair whose main view is the left one. Comments name the paper's symbols."""
    main, auxiliary = pair.main_photo, pair.auxiliary_photo
    t_m, t_a = pair.exposures
    max_disparity = config.search_range(main.width)

    with log.stage("response"):
        response = response or estimate_response(pair, config=config.response)

    with log.stage("radiance"):  # R_m^i, R_a^i
        R_m = initial_radiance(main, response, exposure=t_m)
        R_a = initial_radiance(auxiliary, response, exposure=t_a)
        L_m, L_a = luminance(R_m), luminance(R_a)
        log.keep(main_radiance=R_m, auxiliary_radiance=R_a)

    with log.stage("exposure map"):  # S
        S = exposure_map(main, config=config.exposure_map)
        log.keep(exposure_map=S)

    with log.stage("segmentation"):  # G_m, G_a
        segment = partial(segment_photo, lattice=config.lattice, merging=config.merging)
        segmented = run_together(partial(segment, main), partial(segment, auxiliary), threads=threads)
        (G_m, cells_m), (G_a, cells_a) = segmented
        log.keep(main_superpixels=cells_m, auxiliary_superpixels=cells_a)
        log.keep(main_segments=G_m, auxiliary_segments=G_a)

    with log.stage("interest region"):
        interest = main_interest(G_m, S)
        interest_a = auxiliary_interest(interest, max_disparity=max_disparity)
        log.keep(main_interest=interest, auxiliary_interest=interest_a)

    with log.stage("disparity"):  # D_a
        D_a = disparity or estimate_disparity(
            L_a,
            L_m,
            G_a,
            interest_a,
            max_disparity=max_disparity,
            census=config.census,
            candidates=config.candidates,
            aggregation=config.aggregation,
            threads=threads,
        )
        log.keep(auxiliary_disparity=D_a.values)

    with log.stage("warping"):  # R_a^w
        R_w, arrived = warp_forward(R_a, D_a)
        log.keep(warped=R_w, arrived=arrived)

    with log.stage("rejection"):  # Omega
        valid = reject_uncertain(L_m, luminance(R_w), arrived, config=config.rejection)
        rejected = arrived & ~valid
        holes = interest & ~valid
        log.keep(rejected=rejected, holes=holes)

    with log.stage("filling"):  # R_a^h
        R_h = fill_holes(R_w, valid, holes, R_m, G_m)
        log.keep(filled=R_h)

    with log.stage("edge-preserving filter"):  # R_a^e
        guide = R_m / np.float32(1000)  # the filter's sigma_r is meant for exposure per millisecond
        known = np.where((valid | holes)[..., None], R_h, R_m)  # what is undefined must not bleed into holes
        smooth = edge_preserving_filter(known, guide, config=config.edge_filter, threads=threads)
        R_e = np.where(holes[..., None], smooth, R_h)
        log.keep(filtered=R_e)

    with log.stage("Poisson editing"):  # R_a^f
        R_f, unbounded = R_e, np.zeros_like(holes)
        if config.poisson.enabled:
            R_f, unbounded = poisson_edit(R_e, valid, holes, R_m, threads=threads)
        log.keep(restored=R_f)

    with log.stage("fusion"):  # W, R
        wanted = weight_map(S, guide, config=config.edge_filter, threads=threads)
        defined = valid | (holes & ~unbounded)
        W = np.where(defined, wanted, np.float32(0.0))
        R = blend(R_m, R_f, W, lowest=np.minimum(R_m.min(axis=(0, 1)), R_a.min(axis=(0, 1))))
        log.keep(smoothed_exposure_map=wanted, weight=W)

    source = source_flags(weight=W, wanted_weight=wanted, exposure_map=S, valid=valid, rejected=rejected)
    matched = D_a.values[D_a.valid]
    return HdrResult(
        radiance=R,
        source=source,
        weight=W,
        disparity=D_a,
        response=response,
        method="paper",
        config=config,
        statistics={
            "clipped_share": float(S.mean()),
            "interest_share": float(interest.mean()),
            "occluded_share": float((interest & ~arrived).mean()),
            "rejected_share": float((interest & rejected).mean()),
            "no_information_share": float((source == SourceFlag.NO_INFORMATION).mean()),
            "disparity_searched": float(max_disparity),
            "disparity_min": float(matched.min()) if matched.size else 0.0,
            "disparity_max": float(matched.max(initial=0)),
        },
    )
