"""The stages whose speed is measured one by one, on what a pair gives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np

from stereohdr.config import CensusConfig, PaperConfig
from stereohdr.disparity import estimate_disparity
from stereohdr.disparity.census import census_transform
from stereohdr.disparity.semiglobal import match_semiglobal
from stereohdr.model import StereoPair
from stereohdr.pipeline import fuse
from stereohdr.radiance import clip_to_common_interval, initial_radiance, luminance
from stereohdr.restoration import edge_preserving_filter, poisson_edit
from stereohdr.segmentation import segment_photo

SGM_PATHS = 8


@dataclass(frozen=True)
class StageCall:
    """A stage and what it is called with."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    operations: int = 0
    """Elementary steps, for stages that do not just pass data through: comparisons of codes, steps of a path."""

    def __call__(self) -> Any:
        """Call the stage."""
        return self.function(*self.arguments, **self.options)


def matching_calls(pair: StereoPair, disparities: int, threads: int) -> list[StageCall]:
    """Return the stages of method ``robust`` that match: the census of both views, and semi-global matching."""
    result = fuse(pair, "mv-only", threads=threads)
    radiance = [
        initial_radiance(photo, result.response, exposure=time)
        for photo, time in zip((pair.main_photo, pair.auxiliary_photo), pair.exposures, strict=True)
    ]
    seen = clip_to_common_interval(radiance[0], radiance[1], result.response, exposures=pair.exposures)
    views = tuple(luminance(view) for view in seen)

    def both_census(*images: Any) -> list[Any]:
        return [census_transform(image, threads=threads) for image in images]

    comparisons = 2 * views[0].size * (CensusConfig().window ** 2 - 1)
    guide = np.log(views[0])
    return [
        StageCall("census of both views", both_census, views, operations=comparisons),
        StageCall(
            "semi-global matching, both maps",
            match_semiglobal,
            (*both_census(*views), guide),
            {"disparities": (0, disparities - 1), "threads": threads},
            operations=SGM_PATHS * disparities * guide.size,
        ),
    ]


def paper_calls(pair: StereoPair, disparities: int, threads: int) -> list[StageCall]:
    """Return the heavy stages of method ``paper``."""
    config = PaperConfig(max_disparity=disparities - 1)
    stages = fuse(pair, "paper", config, keep_stages=True, threads=threads).stages
    R_m, R_a = stages["main_radiance"], stages["auxiliary_radiance"]
    valid = stages["arrived"] & ~stages["rejected"]
    matching = (luminance(R_a), luminance(R_m), stages["auxiliary_segments"], stages["auxiliary_interest"])
    guide = R_m / np.float32(1000)
    return [
        StageCall("lattice and segments of one view", segment_photo, (pair.main_photo,)),
        StageCall(
            "matching in 35x35 segments",
            estimate_disparity,
            matching,
            {"max_disparity": disparities - 1, "threads": threads},
        ),
        StageCall("domain transform", edge_preserving_filter, (R_m, guide), {"threads": threads}),
        StageCall(
            "Poisson editing",
            poisson_edit,
            (stages["filtered"], valid, stages["holes"], R_m),
            {"threads": threads},
        ),
    ]


def array_bytes(thing: Any) -> int:
    """Return the size of all arrays in an array, a sequence or a dataclass."""
    if isinstance(thing, np.ndarray):
        return thing.nbytes
    if isinstance(thing, (tuple, list)):
        return sum(array_bytes(part) for part in thing)
    if is_dataclass(thing):
        return sum(array_bytes(getattr(thing, part.name)) for part in fields(thing))
    return 0
