# SPDX-License-Identifier: GPL-3.0-or-later
"""Kd-tree importance sampling of environment maps, its rivals, and a small path tracer.

    image = skytree_core.read_image("sky.exr")
    sampler = skytree_core.KdTreeSampler(image)
    directions, pdf = sampler.sample(numpy.random.default_rng(0).random((1000, 3)))

Method: Ergun, Kurt and Ozturk, "Real-time Kd-tree Based Importance Sampling of Environment Maps", SCCG 2012.
World axes are Blender's: +Z up, and a direction meets the texel that Cycles shows there.
"""

try:
    from ._native import (
        AliasSampler,
        BrdfKdTree,
        BrdfTable,
        BuildCancelled,
        CompressedMap,
        Device,
        EnvironmentSampler,
        FilteredMap,
        HierarchySampler,
        InversionSampler,
        KdTreeSampler,
        MapStatistics,
        NdKdTreeSampler,
        RankFit,
        RenderSession,
        Scene,
        UniformSampler,
        cuda_problem,
        devices,
        fit_rank_model,
        harmonic_coefficients,
        harmonic_irradiance,
        rank_probabilities,
    )
except ModuleNotFoundError as error:
    if error.name != f"{__name__}._native":
        raise
    from ._missing import explain

    raise ImportError(explain()) from None
from .image import read_image
from .related import resampled, stratified

__version__ = "0.1.0"

__all__ = [
    "AliasSampler",
    "BrdfKdTree",
    "BrdfTable",
    "BuildCancelled",
    "CompressedMap",
    "Device",
    "EnvironmentSampler",
    "FilteredMap",
    "HierarchySampler",
    "InversionSampler",
    "KdTreeSampler",
    "MapStatistics",
    "NdKdTreeSampler",
    "RankFit",
    "RenderSession",
    "Scene",
    "UniformSampler",
    "cuda_problem",
    "devices",
    "fit_rank_model",
    "harmonic_coefficients",
    "harmonic_irradiance",
    "rank_probabilities",
    "read_image",
    "resampled",
    "stratified",
]
