# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that are saved with the scene (scene.skytree) and with materials (material.skytree)."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .related_methods import RELATED, TEACHING
from .viewport import clock as viewport_clock
from .viewport import floating

SAMPLERS = (
    (
        "KDTREE",
        "Kd-tree",
        "Blocks of the map from a kd-tree (Ergun, Kurt, Ozturk 2012): small tables, one look-up a sample",
    ),
    ("INVERSION", "Inversion", "Marginal and conditional distributions of all texels, inverted"),
    ("ALIAS", "Alias Table", "Walker's alias table over all texels"),
    ("UNIFORM", "Uniform", "Uniform directions: no importance sampling of the map"),
    ("", TEACHING, ""),
    *RELATED,
)
SPLIT_CRITERIA = (
    ("RANGE", "Range", "Split the block with the largest difference of radiance"),
    ("VARIANCE", "Variance", "Split the block with the largest variance of radiance"),
    ("SSE", "Squared Error", "Split the block with the largest sum of squared errors, as the paper does"),
    (
        "MIN_VARIANCE",
        "Minimum Variance",
        "Choose block and plane that most reduce the variance of the light samples",
    ),
)
BLOCK_PROBABILITIES = (
    ("FITTED", "Fitted", "The paper's one-parameter model of the sorted probabilities"),
    ("EXACT", "Exact", "Proportional to the power of a block"),
    (
        "MIN_VARIANCE",
        "Minimum Variance",
        "Proportional to the root of solid angle times squared radiance: least variance with constant blocks",
    ),
)
PIXEL_FILTERS = (
    ("BOX", "Box", "Mean over the filter width"),
    ("GAUSSIAN", "Gaussian", "Gaussian"),
    ("BLACKMAN_HARRIS", "Blackman-Harris", "Close to a Gaussian, sharper; the same as Cycles' default"),
)
POINT_SETS = (
    (
        "SOBOL",
        "Sobol",
        "Owen-scrambled Sobol points: well spread after any number of samples. Viewports, Adaptive and "
        "Blue Noise always take these",
    ),
    (
        "CMJ",
        "Multi-Jittered",
        "Correlated multi-jittered points (Kensler 2013), made for the number of Render Samples: only for "
        "final renders without Adaptive and Blue Noise, where every pixel takes just that number",
    ),
)
DEVICES = (
    ("CPU", "CPU", "Render on all threads that Blender may use"),
    ("CUDA", "CUDA", "Render on an NVIDIA GPU; where there is none the CPU renders and a message says so"),
)


def _changed(settings, context):
    """Does nothing, but Blender tells the viewport of a script's change only where there is one."""


class SkytreeSceneSettings(bpy.types.PropertyGroup):
    samples: IntProperty(
        update=_changed,
        name="Samples",
        default=64,
        min=1,
        soft_max=4096,
        max=1 << 20,
        description="Paths per pixel of a final render",
    )
    preview_samples: IntProperty(
        update=_changed,
        name="Preview Samples",
        default=256,
        min=1,
        soft_max=4096,
        max=1 << 20,
        description="Paths per pixel after which the viewport stops refining",
    )
    max_bounces: IntProperty(
        update=_changed,
        name="Max Bounces",
        default=4,
        min=0,
        soft_max=16,
        max=64,
        description="Bounces between surfaces; 0: only the environment as the first surface sees it",
    )
    seed: IntProperty(
        update=_changed,
        name="Seed",
        default=0,
        min=0,
        description="Start of the random numbers: the same seed gives the same picture, to the bit, "
        "for any number of threads",
    )
    blue_noise: BoolProperty(
        name="Blue Noise",
        default=False,
        description="Make the errors of neighbouring pixels differ in final renders too, as they do in the "
        "viewport: noise looks finer at few samples",
    )
    point_set: EnumProperty(
        name="Points",
        items=POINT_SETS,
        default="SOBOL",
        description="Which random numbers the samples of a pixel take in final renders",
    )
    device: EnumProperty(name="Device", items=DEVICES, default="CPU", description="What renders")
    sampler: EnumProperty(
        update=_changed,
        name="Sampler",
        items=SAMPLERS,
        default="KDTREE",
        description="How directions towards the world are chosen",
    )
    block_count: IntProperty(
        update=_changed,
        name="Blocks",
        default=1024,
        min=1,
        soft_max=8192,
        max=1 << 20,
        description="Blocks that the kd-tree cuts the map into; 1024 need about 50 KB for any map",
    )
    auto_blocks: BoolProperty(
        update=_changed,
        name="Auto",
        default=False,
        description="As many blocks, up to 4096, as bring the noise within a few per cent of what more would "
        "give. Needs Minimum Variance for split and probability; the paper's blocks stay 1024",
    )
    compensation: FloatProperty(
        update=_changed,
        name="Compensation",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        description="How much of the map's even light is left to the rays that surfaces reflect, so that "
        "light samples go where the map is brighter than its mean (MIS compensation). Without effect "
        "on fitted probabilities",
    )
    split_criterion: EnumProperty(
        update=_changed,
        name="Split",
        items=SPLIT_CRITERIA,
        default="MIN_VARIANCE",
        description="Which block is split next, and where",
    )
    block_probability: EnumProperty(
        update=_changed,
        name="Probability",
        items=BLOCK_PROBABILITIES,
        default="MIN_VARIANCE",
        description="With which probability a block is chosen",
    )
    candidates: IntProperty(
        update=_changed,
        name="Candidates",
        default=8,
        min=1,
        soft_max=64,
        max=1024,
        description="Resampled Product: directions that one light sample is chosen from",
    )
    filter_samples: IntProperty(
        update=_changed,
        name="Filter Samples",
        default=64,
        min=1,
        soft_max=4096,
        max=1 << 20,
        description="Filtered: samples per pixel that the blur is made for; fewer are blurred more",
    )
    light_rays: IntProperty(
        update=_changed,
        name="Light Rays",
        default=0,
        min=0,
        max=4,
        description="Rays to the world from the first surface that a path meets; mirrors take one. 0: as "
        "many as pay, four where light does not bounce and two where it does, until Adaptive has measured it",
    )
    control_variate: BoolProperty(
        update=_changed,
        name="Diffuse Control Variate",
        default=True,
        description="Only the difference from the unshadowed world's light on diffuse surfaces is sampled, "
        "where pilot paths find that this is less noisy; the picture converges to the same",
    )
    product_sampling: BoolProperty(
        update=_changed,
        name="Product Sampling",
        default=True,
        description="On glossy surfaces light samples go where both world and reflection are bright, with "
        "kd-trees of least variance; the picture converges to the same",
    )
    learn_visibility: BoolProperty(
        update=_changed,
        name="Learn Visibility",
        default=True,
        description="Final renders on the CPU, from 16 samples on: what shadow rays meet at first steers "
        "later samples, for rooms lit through windows; open scenes find nothing to learn and stay as "
        "they are",
    )
    adaptive_sampling: BoolProperty(
        update=_changed,
        name="Adaptive",
        default=True,
        description="Final renders on the CPU, from 3 samples on: after a part of the samples the rest "
        "goes where the picture is still noisy, the same number in all. Pixels stay unbiased",
    )
    pixel_filter: EnumProperty(
        update=_changed,
        name="Pixel Filter",
        items=PIXEL_FILTERS,
        default="BLACKMAN_HARRIS",
        description="How samples are weighted around a pixel's centre",
    )
    filter_width: FloatProperty(
        update=_changed,
        name="Width",
        default=1.5,
        min=0.01,
        soft_max=4.0,
        max=10.0,
        precision=2,
        subtype="PIXEL",
        description="Whole width of the pixel filter, in pixels",
    )
    floating_preview: BoolProperty(
        name="Floating Preview",
        default=False,
        description="Show Skytree's picture in a corner of the 3D views, whatever they show themselves",
        update=viewport_clock.redraw_all,
    )
    floating_corner: EnumProperty(
        name="Corner",
        items=floating.CORNERS,
        default="LOWER_RIGHT",
        description="Where the floating preview lies",
        update=viewport_clock.redraw_all,
    )
    floating_size: FloatProperty(
        name="Size",
        default=35.0,
        min=10.0,
        max=100.0,
        subtype="PERCENTAGE",
        description="Share of the 3D view's width and height that the floating preview takes",
        update=viewport_clock.redraw_all,
    )


class SkytreeMaterialSettings(bpy.types.PropertyGroup):
    use_ward: BoolProperty(
        update=_changed,
        name="Anisotropic Ward",
        default=False,
        description="Show this material with Ward's anisotropic reflection model instead of its nodes "
        "(Skytree alone knows this setting)",
    )
    ward_alpha_x: FloatProperty(
        update=_changed,
        name="Alpha X",
        default=0.5,
        min=0.001,
        max=1.0,
        precision=3,
        description="Standard deviation of the surface slope along the tangent",
    )
    ward_alpha_y: FloatProperty(
        update=_changed,
        name="Alpha Y",
        default=0.1,
        min=0.001,
        max=1.0,
        precision=3,
        description="Standard deviation of the surface slope across the tangent",
    )
    ward_rotation: FloatProperty(
        update=_changed,
        name="Rotation",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        description="Turns of the tangent about the normal",
    )
    ward_color: FloatVectorProperty(
        update=_changed,
        name="Color",
        subtype="COLOR",
        size=3,
        default=(0.8, 0.8, 0.8),
        min=0.0,
        max=1.0,
        description="Reflectance",
    )
    use_table: BoolProperty(
        update=_changed,
        name="Tabulated BRDF",
        default=False,
        description="Show this material by a table of its reflectance, sampled by a kd-tree, instead of its "
        "nodes (Skytree alone knows this setting)",
    )
    table_source: EnumProperty(
        update=_changed,
        name="Table",
        default="GGX",
        items=[
            ("GGX", "GGX", "The model of Blender's Glossy BSDF, as a table"),
            ("WARD", "Ward", "Ward's anisotropic model, as a table"),
            ("MERL", "MERL File", "A measured material: a .binary file of the MERL BRDF database"),
        ],
        description="What the table holds",
    )
    table_file: StringProperty(
        update=_changed,
        name="File",
        subtype="FILE_PATH",
        description="A .binary file of the MERL BRDF database",
    )
    table_alpha_x: FloatProperty(
        update=_changed,
        name="Alpha X",
        default=0.2,
        min=0.01,
        max=1.0,
        precision=3,
        description="Roughness along the tangent (the square of Blender's roughness)",
    )
    table_alpha_y: FloatProperty(
        update=_changed,
        name="Alpha Y",
        default=0.2,
        min=0.01,
        max=1.0,
        precision=3,
        description="Roughness across the tangent; different from Alpha X the table has four dimensions and "
        "takes a second to make",
    )
    table_rotation: FloatProperty(
        update=_changed,
        name="Rotation",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        description="Turns of the tangent about the normal",
    )
    table_color: FloatVectorProperty(
        update=_changed,
        name="Color",
        subtype="COLOR",
        size=3,
        default=(1.0, 1.0, 1.0),
        min=0.0,
        max=1.0,
        description="Factor on the table's reflectance",
    )


CLASSES = (SkytreeSceneSettings, SkytreeMaterialSettings)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.skytree = PointerProperty(type=SkytreeSceneSettings, name="Skytree")
    bpy.types.Material.skytree = PointerProperty(type=SkytreeMaterialSettings, name="Skytree")


def unregister():
    del bpy.types.Material.skytree
    del bpy.types.Scene.skytree
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
