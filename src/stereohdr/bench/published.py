"""The paper's own numbers (Park et al. 2017, Tables 1 and 2: HDR-VDP-2), on its own images.

The paper does not state pixels per degree, scale or which of the two scores it prints, so its values cannot be
compared with ours; rankings can.
"""

from __future__ import annotations

TABLE1: dict[tuple[str, str], dict[str, float]] = {
    ("Art", "normal-long"): {"lin2009": 92.05, "baetz2014": 92.76, "paper": 94.87},
    ("Aloe", "normal-long"): {"lin2009": 91.51, "baetz2014": 92.81, "paper": 94.30},
    ("Moebius", "normal-long"): {"lin2009": 92.27, "baetz2014": 92.44, "paper": 92.76},
    ("Art", "short-long"): {"lin2009": 79.23, "baetz2014": 84.95, "paper": 92.64},
    ("Aloe", "short-long"): {"lin2009": 78.89, "baetz2014": 83.81, "paper": 90.57},
    ("Moebius", "short-long"): {"lin2009": 82.43, "baetz2014": 86.26, "paper": 92.71},
    ("Jumble", "short-long"): {"lin2009": 38.81, "baetz2014": 45.56, "paper": 58.01},
}
"""Scene and exposure setting to score by method."""

TABLE2: dict[str, dict[str, float]] = {
    "paper": {"Art": 92.64, "Aloe": 90.57, "Moebius": 92.71, "Jumble": 58.01},
    "paper-sift": {"Art": 86.61, "Aloe": 81.69, "Moebius": 87.25, "Jumble": 52.95},
    "paper-no-rejection": {"Art": 84.91, "Aloe": 86.25, "Moebius": 84.56, "Jumble": 41.93},
    "paper-no-poisson": {"Art": 86.44, "Aloe": 86.66, "Moebius": 87.78, "Jumble": 49.57},
    "paper-no-rejection-no-poisson": {"Art": 82.48, "Aloe": 85.81, "Moebius": 82.63, "Jumble": 36.22},
    "paper-sift-no-poisson": {"Art": 82.26, "Aloe": 78.18, "Moebius": 85.90, "Jumble": 49.88},
    "paper-sift-no-rejection": {"Art": 81.34, "Aloe": 78.35, "Moebius": 84.68, "Jumble": 38.84},
    "paper-sift-no-rejection-no-poisson": {"Art": 78.17, "Aloe": 77.95, "Moebius": 81.87, "Jumble": 35.96},
}
"""Variant of the method to score by scene, short-long."""


def published_score(scene: str, method: str) -> float | None:
    """Return the paper's HDR-VDP-2 score for a scene named ``<Scene>-<setting>``, None if it has none."""
    for (name, setting), scores in TABLE1.items():
        if scene.startswith(name) and scene.endswith(setting) and method in scores:
            return scores[method]
    if scene.endswith("short-long"):
        for name, score in TABLE2.get(method, {}).items():
            if scene.startswith(name):
                return score
    return None
