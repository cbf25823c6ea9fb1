# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the render settings: those that come with Skytree, and the user's own."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel
from bpy.props import EnumProperty

SUBDIRECTORY = "skytree/render"

# Name, tooltip, settings. "Best" are the defaults.
BUILT_IN = {
    "BEST": (
        "Best",
        "What measured best: blocks and probabilities of least variance, and all estimators",
        {
            "sampler": "KDTREE",
            "block_count": 1024,
            "auto_blocks": False,
            "compensation": 0.5,
            "split_criterion": "MIN_VARIANCE",
            "block_probability": "MIN_VARIANCE",
            "light_rays": 0,
            "control_variate": True,
            "product_sampling": True,
            "learn_visibility": True,
            "adaptive_sampling": True,
            "point_set": "SOBOL",
            "pixel_filter": "BLACKMAN_HARRIS",
            "filter_width": 1.5,
        },
    ),
    "PAPER": (
        "Paper",
        "As in Ergun, Kurt and Ozturk 2012: blocks by squared error, the fitted probability model",
        {
            "sampler": "KDTREE",
            "block_count": 1024,
            "auto_blocks": False,
            "compensation": 0.0,
            "split_criterion": "SSE",
            "block_probability": "FITTED",
            "light_rays": 1,
            "control_variate": False,
            "product_sampling": False,
            "learn_visibility": False,
            "adaptive_sampling": False,
            "point_set": "SOBOL",
        },
    ),
    "INVERSION": (
        "Inversion",
        "The method the paper compares with: inversion of all texels' distribution",
        {
            "sampler": "INVERSION",
            "light_rays": 1,
            "control_variate": False,
            "product_sampling": False,
            "learn_visibility": False,
            "adaptive_sampling": False,
            "point_set": "SOBOL",
        },
    ),
}


class SKYTREE_OT_apply_preset(bpy.types.Operator):
    """Set the render settings to a preset that comes with Skytree"""

    bl_idname = "skytree.apply_preset"
    bl_label = "Apply Skytree Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: EnumProperty(
        name="Preset", items=[(key, label, tip) for key, (label, tip, _) in BUILT_IN.items()]
    )

    @classmethod
    def description(cls, context, properties):
        return BUILT_IN[properties.preset][1]

    def execute(self, context):
        settings = context.scene.skytree
        for name, value in BUILT_IN[self.preset][2].items():
            setattr(settings, name, value)
        return {"FINISHED"}


class SKYTREE_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of one's own"""

    bl_idname = "skytree.preset_add"
    bl_label = "Add Skytree Preset"
    preset_menu = "SKYTREE_PT_presets"
    preset_subdir = SUBDIRECTORY
    preset_defines = ["settings = bpy.context.scene.skytree"]
    preset_values = [
        f"settings.{name}"
        for name in (
            "samples",
            "preview_samples",
            "max_bounces",
            "sampler",
            "block_count",
            "auto_blocks",
            "compensation",
            "split_criterion",
            "block_probability",
            "candidates",
            "filter_samples",
            "light_rays",
            "control_variate",
            "product_sampling",
            "learn_visibility",
            "adaptive_sampling",
            "point_set",
            "pixel_filter",
            "filter_width",
        )
    ]


class SKYTREE_PT_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Skytree Presets"
    preset_subdir = SUBDIRECTORY
    preset_operator = "script.execute_preset"
    preset_add_operator = "skytree.preset_add"

    def draw(self, context):
        column = self.layout.column(align=True)
        for key, (label, _tip, _settings) in BUILT_IN.items():
            column.operator("skytree.apply_preset", text=label).preset = key
        super().draw(context)


CLASSES = (SKYTREE_OT_apply_preset, SKYTREE_OT_preset_add, SKYTREE_PT_presets)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
