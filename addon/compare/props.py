# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the comparison, saved with the scene as scene.skytree_compare."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..properties import BLOCK_PROBABILITIES, SPLIT_CRITERIA
from ..viewport import clock as viewport_clock
from .methods import METHODS, REFERENCE

MODES = (
    ("OFF", "Off", "The viewport shows the scene's own setting"),
    ("SPLIT", "Split", "A on the left, B on the right of a line that can be dragged"),
    ("SIDE", "Side by Side", "The same middle part of the picture twice, A on the left and B on the right"),
    ("FLIP", "Flip", "One at a time: the Flip key or button changes between A and B"),
    ("DIFFERENCE", "Difference", "Absolute difference of A and B, brightened"),
)
CLOCKS = (
    ("SAMPLES", "Equal Samples", "Both take the same number of samples per pixel"),
    ("TIME", "Equal Time", "Both take the same time on the same number of threads"),
)


class SkytreeCompareSide(bpy.types.PropertyGroup):
    method: EnumProperty(
        name="Method",
        items=(*METHODS, REFERENCE),
        default="SCENE",
        description="How light is sampled on this side",
        update=viewport_clock.redraw_all,
    )
    block_count: IntProperty(
        name="Blocks",
        default=1024,
        min=1,
        soft_max=8192,
        max=1 << 20,
        description="Blocks of this side's kd-tree",
        update=viewport_clock.redraw_all,
    )
    split_criterion: EnumProperty(
        name="Split",
        items=SPLIT_CRITERIA,
        default="SSE",
        description="Which block is split next",
        update=viewport_clock.redraw_all,
    )
    block_probability: EnumProperty(
        name="Probability",
        items=BLOCK_PROBABILITIES,
        default="FITTED",
        description="With which probability a block is chosen",
        update=viewport_clock.redraw_all,
    )


class SkytreeCompareSettings(bpy.types.PropertyGroup):
    mode: EnumProperty(
        name="Compare",
        items=MODES,
        default="OFF",
        description="What the rendered viewport shows",
        update=viewport_clock.redraw_all,
    )
    a: PointerProperty(type=SkytreeCompareSide, name="A")
    b: PointerProperty(type=SkytreeCompareSide, name="B")
    clock: EnumProperty(
        name="Clock",
        items=CLOCKS,
        default="SAMPLES",
        description="What is equal for both sides",
        update=viewport_clock.redraw_all,
    )
    samples: IntProperty(
        name="Samples",
        default=64,
        min=1,
        soft_max=4096,
        max=1 << 20,
        description="Samples per pixel of both sides",
        update=viewport_clock.redraw_all,
    )
    seconds: FloatProperty(
        name="Time",
        default=2.0,
        min=0.01,
        soft_max=60.0,
        max=86400.0,
        unit="TIME_ABSOLUTE",
        description="Time of each side: in a report of the device (all threads together, or the GPU), "
        "in a view on the clock",
        update=viewport_clock.redraw_all,
    )
    reference_samples: IntProperty(
        name="Reference Samples",
        default=1024,
        min=2,
        soft_max=65536,
        max=1 << 20,
        description="Samples per pixel of the reference, whose own error is taken into account",
    )
    split: FloatProperty(
        name="Split",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        description="Where the line stands",
        update=viewport_clock.redraw_all,
    )
    show_b: BoolProperty(
        name="Show B",
        default=False,
        description="Which of the two Flip shows",
        update=viewport_clock.redraw_all,
    )
    gain: FloatProperty(
        name="Gain",
        default=2.0,
        min=0.01,
        soft_max=64.0,
        max=4096.0,
        description="By how much the difference is brightened",
        update=viewport_clock.redraw_all,
    )
    show_figures: BoolProperty(
        name="Figures",
        default=True,
        description="Show error figures in the view, once there is a reference",
        update=viewport_clock.redraw_all,
    )
    show_plot: BoolProperty(
        name="Convergence Plot",
        default=True,
        description="Show error against samples in the view, once there is a reference",
        update=viewport_clock.redraw_all,
    )
    plot_axis: EnumProperty(
        name="Against",
        items=(("SAMPLES", "Samples", "Samples per pixel"), ("TIME", "Time", "Seconds of rendering")),
        default="SAMPLES",
        description="What the plot's horizontal axis counts",
        update=viewport_clock.redraw_all,
    )
    folder: StringProperty(
        name="Report",
        default="//skytree_compare/",
        subtype="DIR_PATH",
        description="Folder that the report is written into",
    )


CLASSES = (SkytreeCompareSide, SkytreeCompareSettings)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.skytree_compare = PointerProperty(type=SkytreeCompareSettings, name="Skytree Compare")


def unregister():
    del bpy.types.Scene.skytree_compare
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
