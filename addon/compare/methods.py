# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be compared: ways to choose the directions of light samples, with their settings and their
names."""

from __future__ import annotations

from dataclasses import dataclass

from ..environments import SamplerSettings

METHODS = (
    ("SCENE", "Scene's Setting", "The sampler and settings that the scene renders with"),
    ("KDTREE", "Kd-tree", "Blocks of a kd-tree, with settings of its own"),
    ("INVERSION", "Inversion", "Marginal and conditional distributions of all texels, inverted"),
    ("ALIAS", "Alias Table", "Walker's alias table over all texels"),
    ("UNIFORM", "Uniform", "Uniform directions: no importance sampling of the map"),
    ("BSDF", "BSDF Only", "No light samples at all: the map is found by the rays that surfaces reflect"),
)
REFERENCE = ("REFERENCE", "Captured Reference", "The reference of this view: press Capture Reference first")
LABELS = {"KDTREE": "kd-tree", "INVERSION": "inversion", "ALIAS": "alias table", "UNIFORM": "uniform"}
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
    """How light is sampled; `light_sampling` off leaves BSDF samples alone."""

    sampler: SamplerSettings
    light_sampling: bool = True

    @property
    def label(self) -> str:
        if not self.light_sampling:
            return "BSDF only"
        name = LABELS[self.sampler.sampler]
        if self.sampler.sampler != "KDTREE":
            return name
        split, probability = SHORT[self.sampler.split_criterion], SHORT[self.sampler.block_probability]
        count = "auto" if self.sampler.auto_blocks else self.sampler.block_count
        return f"{name} {count}, {split} / {probability}"

    @property
    def settings(self) -> dict:
        """What a report says about it, beside figures of the sampler."""
        if not self.light_sampling:
            return {"method": "BSDF"}
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
    (compare.props.SkytreeCompareSide), `scene_settings` is scene.skytree."""
    if choice.method == "SCENE":
        return Method(SamplerSettings.of(scene_settings))
    if choice.method == "BSDF":
        return Method(SamplerSettings("UNIFORM"), light_sampling=False)
    if choice.method == "KDTREE":
        tree = (choice.block_count, choice.split_criterion, choice.block_probability)
        return Method(SamplerSettings("KDTREE", *tree))
    return Method(SamplerSettings(choice.method))
