"""What a result says about itself: the closing summary and the JSON document."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from stereohdr.io.files import atomic_path
from stereohdr.memory import size_text
from stereohdr.model import HdrResult, Photo, SourceFlag, StereoPair

RADIANCE_SCALE = "relative: exposure over exposure time in seconds, exposure 1 gives the mid code"
"""The scale of radiance, as files state it."""


def exposure_text(seconds: float) -> str:
    """Return an exposure time as photographers write it: ``1/60 s``, ``2 s``."""
    if seconds < 0.3 and abs(1 / seconds - round(1 / seconds)) < 0.001 / seconds:
        return f"1/{round(1 / seconds)} s"
    return f"{seconds:g} s"


def source_shares(result: HdrResult) -> dict[str, float]:
    """Return the share (0..1) of the pixels with each `SourceFlag`, by its name in lower case."""
    counts = np.bincount(result.source.ravel(), minlength=len(SourceFlag))
    return {flag.name.lower(): float(counts[flag] / result.source.size) for flag in SourceFlag}


def attributes(result: HdrResult) -> dict[str, Any]:
    """Return what an HDR file should carry: software, method, exposure times, views, scale, versions, geometry."""
    geometry: dict[str, Any] = {}
    if result.rectification is not None:
        geometry = {
            "rectifiedFrom": result.rectification["source"],
            "disparityOffset": result.rectification["disparity_offset"],
        }
    return {
        "software": f"stereohdr {result.versions.get('stereohdr', '')}".strip(),
        "method": result.method,
        "mainView": result.main,
        "disparityView": result.main if result.main_disparity else "left" if result.main == "right" else "right",
        "exposureTimeMain": result.exposures[0],
        "exposureTimeAuxiliary": result.exposures[1],
        "radianceScale": RADIANCE_SCALE,
        "versions": ", ".join(f"{name} {version}" for name, version in result.versions.items()),
        **geometry,
    }


def layers(result: HdrResult) -> dict[str, np.ndarray]:
    """Return what an OpenEXR file of the result can carry besides the image, by channel name.

    ``disparity.Z`` is in pixels: of the main view if the method makes it, else of the auxiliary view, 0 where
    unknown (the attribute ``disparityView`` says whose); ``source.I`` holds `SourceFlag`; ``confidence.Y``, 0..1,
    is there if the method gives one. All are ``(H, W)``.
    """
    disparity = result.main_disparity or result.disparity
    planes: dict[str, np.ndarray] = {"disparity.Z": disparity.values, "source.I": result.source}
    return planes if result.confidence is None else {**planes, "confidence.Y": result.confidence}


def document(result: HdrResult, pair: StereoPair) -> dict[str, Any]:
    """Return everything but the pixels, ready for JSON."""
    return {
        "software": attributes(result)["software"],
        "method": result.method,
        "main": result.main,
        "exposure_times": {"main": result.exposures[0], "auxiliary": result.exposures[1]},
        "exposure_ratio": pair.exposure_ratio,
        "size": [result.source.shape[1], result.source.shape[0]],
        "channels": pair.left.channels,
        "left": pair.left.name,
        "right": pair.right.name,
        "config": asdict(result.config),
        "statistics": dict(result.statistics),
        "source_shares": source_shares(result),
        "seconds": dict(result.seconds),
        "warnings": list(result.warnings),
        "versions": dict(result.versions),
        "rectification": None if result.rectification is None else dict(result.rectification),
        "response": result.response.log_exposure.tolist(),
    }


def rectification_text(report: Mapping[str, Any]) -> str:
    """Return how a pair was rectified and how well its rows agree, see `Rectification.report`."""
    origin = {"calibration": "by calibration", "pictures": "from the pictures"}.get(
        report["source"], "by calibrated lenses and the pictures"
    )
    if report["dy_median"] is None:
        return f"{origin}; too few matches to measure how well"
    return (
        f"{origin}; rows agree to {report['dy_median']:.2f} px (median of {report['held_out']} matches, 95 % "
        f"within {report['dy_p95']:.2f}), disparity {report['disparity_min']:.0f} to "
        f"{report['disparity_max']:.0f} px"
    )


def memory_text(statistics: Mapping[str, float]) -> str:
    """Return how a large pair was matched within a limit of memory, see `MemoryPlan.statistics`."""
    how = (
        "in strips, coarse to fine"
        if statistics["coarse_to_fine"]
        else f"in {statistics['matching_strips']:g} strips"
    )
    return f"about {size_text(int(statistics['memory_estimate']))} at most; matched {how}"


def write_text(path: str | Path, content: str) -> None:
    """Write a text file, whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(content, encoding="utf-8")


def write_json(path: str | Path, content: dict[str, Any]) -> None:
    """Write a JSON document, whole or not at all."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def summary(result: HdrResult, pair: StereoPair) -> list[str]:
    """Return the closing lines of a run, for people."""

    def view(photo: Photo) -> str:
        iso = f", ISO {photo.iso:g}" if photo.iso else ""
        aperture = f", f/{photo.f_number:g}" if photo.f_number else ""
        return f"{photo.name} at {exposure_text(photo.exposure_time or 0)}{iso}{aperture}"

    def percent(name: str) -> str:
        return f"{100 * result.statistics[name]:.1f} %"

    colour = "grey" if pair.left.channels == 1 else "RGB"
    height, width = result.source.shape
    lines = [
        f"method     {result.method}, result in the {result.main} view",
        f"main       {view(pair.main_photo)}",
        f"auxiliary  {view(pair.auxiliary_photo)}",
        f"exposure   ratio {pair.exposure_ratio:.3g}",
        f"size       {width}x{height} {colour}, white level {pair.left.white}",
        f"clipped    {percent('clipped_share')} of the main view is under- or over-exposed",
    ]
    if result.rectification is not None:
        lines.append(f"rectified  {rectification_text(result.rectification)}")
    if "interest_share" in result.statistics:
        s = result.statistics
        lines += [
            f"interest   {percent('interest_share')} in segments that need the auxiliary view",
            f"disparity  {s['disparity_min']:g} to {s['disparity_max']:g} px "
            f"(searched 0 to {s['disparity_searched']:g})",
            f"holes      {percent('occluded_share')} without a match, {percent('rejected_share')} rejected",
        ]
    if "matched_share" in result.statistics:
        s = result.statistics
        lines += [
            f"disparity  {s['disparity_min']:.1f} to {s['disparity_max']:.1f} px "
            f"(searched {s['disparity_searched_from']:g} to {s['disparity_searched']:g})",
            f"matched    {percent('matched_share')} of the main view; {percent('occluded_share')} hidden from the "
            f"auxiliary view, {percent('rejected_share')} matched but rejected",
        ]
    if result.statistics.get("matching_strips", 1) > 1:
        lines.append(f"memory     {memory_text(result.statistics)}")
    shares = source_shares(result)
    sources = ", ".join(f"{name.replace('_', ' ')} {100 * share:.1f} %" for name, share in shares.items() if share)
    timings = ", ".join(f"{name} {value:.2f}" for name, value in result.seconds.items())
    total = sum(result.seconds.values())
    return [*lines, f"source     {sources}", f"seconds    {total:.2f} ({timings})"]
