# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be compared: ways to choose the directions of light samples, with their settings and their
names."""

from __future__ import annotations

from dataclasses import dataclass

from ..environments import SamplerSettings
from ..related_methods import RELATED, TEACHING

METHODS = (
    ("SCENE", "Scene's Setting", "The sampler and settings that the scene renders with"),
    ("KDTREE", "Kd-tree", "Blocks of a kd-tree, with settings of its own"),
    ("INVERSION", "Inversion", "Marginal and conditional distributions of all texels, inverted"),
    ("ALIAS", "Alias Table", "Walker's alias table over all texels"),
    ("UNIFORM", "Uniform", "Uniform directions: no importance sampling of the map"),
    ("", TEACHING, ""),
    *RELATED,
    ("BSDF", "BSDF Only", "No light samples at all: the map is found by the rays that surfaces reflect"),
)
REFERENCE = ("REFERENCE", "Captured Reference", "The reference of this view: press Capture Reference first")
LABELS = {
    "KDTREE": "kd-tree",
    "INVERSION": "inversion",
    "ALIAS": "alias table",
    "UNIFORM": "uniform",
    "HIERARCHY": "hierarchical",
    "MEDIAN_CUT": "median cut",
    "FILTERED": "filtered (biased)",
}
SHORT = {
    "RANGE": "range",
    "VARIANCE": "variance",
    "SSE": "SSE",
    "MIN_VARIANCE": "min. variance",
    "FITTED": "fitted",
    "EXACT": "exact",
}

# The reference shares no random numbers with what it judges.
REFERENCE_SEEDS = (0x5EED0001, 0x5EED0002)


@dataclass(frozen=True)
class Clock:
    """SAMPLES: both sides take `samples`; TIME: each takes as many as fit into `seconds` of CPU time."""

    kind: str = "SAMPLES"
    samples: int = 64
    seconds: float = 2.0


@dataclass(frozen=True)
class Method:
    """How light is sampled; `light_sampling` off leaves BSDF samples alone, `candidates` above 0 chooses a
    light sample from so many."""

    sampler: SamplerSettings
    light_sampling: bool = True
    candidates: int = 0

    @property
    def label(self) -> str:
        if not self.light_sampling:
            return "BSDF only"
        if self.candidates:
            return f"resampled product, {self.candidates} candidates"
        if self.sampler.sampler == "FILTERED":
            return f"filtered (biased), for {self.sampler.filter_samples} samples"
        if self.sampler.sampler == "MEDIAN_CUT":
            return f"median cut {self.sampler.block_count}"
        name = LABELS[self.sampler.sampler]
        if self.sampler.sampler != "KDTREE":
            return name
        split, probability = SHORT[self.sampler.split_criterion], SHORT[self.sampler.block_probability]
        count = "auto" if self.sampler.auto_blocks else self.sampler.block_count
        return f"{name} {count}, {split} / {probability}"

    @property
    def has_density(self) -> bool:
        """Whether the sampler's pdf says how well light samples fit the map."""
        return self.light_sampling and self.sampler.has_density

    @property
    def settings(self) -> dict:
        """What a report says about it, beside figures of the sampler."""
        if not self.light_sampling:
            return {"method": "BSDF"}
        if self.candidates:
            return {"method": "RESAMPLED", "candidates": self.candidates}
        if self.sampler.sampler == "FILTERED":
            return {"method": "FILTERED", "biased": True, "filter_samples": self.sampler.filter_samples}
        if self.sampler.sampler == "MEDIAN_CUT":
            return {"method": "MEDIAN_CUT", "block_count": self.sampler.block_count}
        if self.sampler.sampler != "KDTREE":
            return {"method": self.sampler.sampler}
        return {
            "method": "KDTREE",
            "block_count": "AUTO" if self.sampler.auto_blocks else self.sampler.block_count,
            "compensation": self.sampler.compensation,
            "split_criterion": self.sampler.split_criterion,
            "block_probability": self.sampler.block_probability,
        }


def method_of(choice, scene_settings) -> Method:
    """`choice` has `method`, `block_count`, `split_criterion` and `block_probability`
    (compare.props.SkytreeCompareSide), `scene_settings` is scene.skytree, whose candidates and filter serve
    both sides."""
    if choice.method == "RESAMPLED" or (choice.method == "SCENE" and scene_settings.sampler == "RESAMPLED"):
        return Method(SamplerSettings(), candidates=scene_settings.candidates)
    if choice.method == "SCENE":
        return Method(SamplerSettings.of(scene_settings))
    if choice.method == "FILTERED":
        return Method(SamplerSettings("FILTERED", filter_samples=scene_settings.filter_samples))
    if choice.method == "MEDIAN_CUT":
        return Method(SamplerSettings("MEDIAN_CUT", choice.block_count))
    if choice.method == "BSDF":
        return Method(SamplerSettings("UNIFORM"), light_sampling=False)
    if choice.method == "KDTREE":
        tree = (choice.block_count, choice.split_criterion, choice.block_probability)
        return Method(SamplerSettings("KDTREE", *tree))
    return Method(SamplerSettings(choice.method))
