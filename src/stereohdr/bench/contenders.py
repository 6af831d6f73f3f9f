"""What is compared: the methods, the paper's ablations, and two ceilings made from the reference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereohdr import DisparityFlag, HdrResult, fuse
from stereohdr.config import FuseConfig, PaperConfig, RobustConfig
from stereohdr.datasets.scene import EvaluationScene, channel_mask, visible_in_auxiliary
from stereohdr.errors import ConfigError
from stereohdr.methods import available_methods, get_method
from stereohdr.metrics import aligning_scale
from stereohdr.model import ResponseCurve

CEILINGS = {
    "C3": "ceiling: the reference where a channel is out of range and the auxiliary view sees the pixel",
    "C2": "ceiling: the reference where a channel is out of range",
}
"""Contenders that look at the reference; the rest is the main view with the response estimated from the pair."""

NEEDS_TRUTH = {"oracle"}
"""Methods that are given the true disparity."""

TRUE_RESPONSE = {"oracle", "baetz2014"}
"""Methods that are given the true response (or the bracket's): the original of the latter calibrates offline."""


@dataclass(frozen=True)
class Variant:
    """Parts of method ``paper`` that an ablation of Table 2 exchanges or leaves out."""

    sift: bool = False
    """The conventional response, from SIFT matches."""
    rejection: bool = True
    poisson: bool = True

    @property
    def label(self) -> str:
        """Return the name in tables."""
        parts = ("sift", self.sift), ("no-rejection", not self.rejection), ("no-poisson", not self.poisson)
        return "-".join(["paper", *(name for name, on in parts if on)])

    def config(self) -> PaperConfig:
        """Return the method's configuration."""
        config = PaperConfig()
        return replace(
            config,
            response=replace(config.response, samples="sift" if self.sift else "cdf"),
            rejection=replace(config.rejection, enabled=self.rejection),
            poisson=replace(config.poisson, enabled=self.poisson),
        )


def _robust_variants() -> dict[str, RobustConfig]:
    """Return method ``robust`` with one step left out or replaced at a time."""
    full = RobustConfig()
    return {
        "robust-survey-response": replace(full, response_rounds=1, toe=False),
        "robust-no-toe": replace(full, toe=False),
        "robust-one-run": replace(full, two_way=replace(full.two_way, runs=1)),
        "robust-4-paths": replace(full, semiglobal=replace(full.semiglobal, paths=4)),
        "robust-weak-penalties": replace(
            full, semiglobal=replace(full.semiglobal, small_penalty=5, large_penalty=25)
        ),
        "robust-no-agreement": replace(
            full, agreement=replace(full.agreement, codes=255.0, slack=10.0, borrowed_slack=10.0, support=0)
        ),
        "robust-no-borrowing": replace(
            full, highlights=replace(full.highlights, borrowed_level_error=100.0, borrowed_gradient_error=100.0)
        ),
        "robust-no-prior": replace(full, highlights=replace(full.highlights, prior_correlation=100.0)),
        "robust-no-colour": replace(full, highlights=replace(full.highlights, colour_error=100.0)),
        "robust-matched-only": replace(full, shadows=replace(full.shadows, alone_share=0.0)),
    }


ROBUST_VARIANTS = _robust_variants()
"""Ablations of method ``robust``: what each step brings."""

VARIANTS = {
    variant.label: variant
    for variant in (
        Variant(),
        Variant(sift=True),
        Variant(rejection=False),
        Variant(poisson=False),
        Variant(rejection=False, poisson=False),
        Variant(sift=True, poisson=False),
        Variant(sift=True, rejection=False),
        Variant(sift=True, rejection=False, poisson=False),
    )
}
"""The eight rows of Table 2, in its order."""


def contender_config(label: str) -> FuseConfig:
    """Return the configuration of a contender, without the scene's search range.

    Raises
    ------
    ConfigError
        There is no contender of that name; the message lists them.
    """
    if label in VARIANTS:
        return VARIANTS[label].config()
    if label in ROBUST_VARIANTS:
        return ROBUST_VARIANTS[label]
    if label in CEILINGS:
        return FuseConfig()
    if label not in available_methods():
        variants = [v for v in (*VARIANTS, *ROBUST_VARIANTS) if v != "paper"]
        known = [*available_methods(), *variants, *CEILINGS]
        raise ConfigError(f"unknown method {label!r}; known are {', '.join(known)}")
    return get_method(label).config_type()


def best_known_response(scene: EvaluationScene) -> ResponseCurve | None:
    """Return the true response, else the one of the reference's bracket, else None."""
    return scene.response or scene.reference_response


def run_contender(scene: EvaluationScene, label: str, *, threads: int | None = None) -> HdrResult:
    """Run one contender on one scene.

    Returns
    -------
    Its result; ceilings come without disparity and source flags of their own.

    Raises
    ------
    ConfigError
        Unknown contender, or the scene lacks the truth that it needs.
    """
    config = replace(contender_config(label), max_disparity=scene.max_disparity)
    if label in CEILINGS:
        return _ceiling(scene, label, config)
    if label in NEEDS_TRUTH and scene.disparity_auxiliary is None:
        raise ConfigError(f"{label} needs the true disparity, and scene {scene.name} has none")
    return fuse(
        scene.pair,
        "paper" if label in VARIANTS else "robust" if label in ROBUST_VARIANTS else label,
        config,
        response=best_known_response(scene) if label in TRUE_RESPONSE else None,
        disparity=scene.disparity_auxiliary if label in NEEDS_TRUTH else None,
        checks=False,
        keep_stages=False,
        threads=threads,
    )


def ceiling_radiance(
    scene: EvaluationScene, main_radiance: NDArray[np.float32], label: str
) -> NDArray[np.float32] | None:
    """Return the main view with the reference put where a channel is out of range; None without ground truth.

    Parameters
    ----------
    scene
        The scene.
    main_radiance
        ``(H, W, C)`` initial radiance of the main view.
    label
        ``C3`` (only where the auxiliary view sees the pixel) or ``C2``.
    """
    replaced = channel_mask(scene)
    if label == "C3":
        visible = visible_in_auxiliary(scene)
        if visible is None:
            return None
        replaced = replaced & visible
    scale = aligning_scale(main_radiance, scene.reference, scene.pair.main_photo)
    return np.where(replaced[..., None], scene.reference / np.float32(scale), main_radiance)


def _ceiling(scene: EvaluationScene, label: str, config: FuseConfig) -> HdrResult:
    main_only = fuse(scene.pair, "mv-only", config, checks=False)
    radiance = ceiling_radiance(scene, main_only.radiance, label)
    if radiance is None:
        raise ConfigError(f"{label} needs the true disparity, and scene {scene.name} has none")
    nothing = np.full(main_only.source.shape, DisparityFlag.NOT_COMPUTED, np.uint8)
    return replace(
        main_only, radiance=radiance, method=label, disparity=replace(main_only.disparity, flags=nothing)
    )
