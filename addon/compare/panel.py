# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison in the 3D view's sidebar and in the Render properties."""

from __future__ import annotations

import bpy

from ..problems.panel import wrapped
from . import background
from .region import capture_fraction


class _ComparePanel:
    bl_label = "Compare"
    COMPAT_ENGINES = {"SKYTREE"}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        compared = context.scene.skytree_compare
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        _draw_progress(layout)
        layout.prop(compared, "mode", text="Viewport")
        column = layout.column()
        if compared.mode == "SPLIT":
            column.prop(compared, "split")
        elif compared.mode == "FLIP":
            shown = "B" if compared.show_b else "A"
            column.operator(
                "skytree.compare_flip", text=f"Flip (shows {shown}, key J)", icon="ARROW_LEFTRIGHT"
            )
        elif compared.mode == "DIFFERENCE":
            column.prop(compared, "gain")
        for name in ("a", "b"):
            _draw_side(layout, getattr(compared, name), context.scene.skytree, name.upper())
        column = layout.column()
        column.prop(compared, "clock")
        column.prop(compared, "samples" if compared.clock == "SAMPLES" else "seconds")


def _draw_progress(layout):
    """Of a report that is being made: at the top, since the panel that started it may be closed."""
    report = background.current()
    if report is None or report.done:
        return
    row = layout.row(align=True)
    row.label(text=f"Report: {report.progress.text}, {100 * report.progress.fraction:.0f} %", icon="TIME")
    row.operator("skytree.cancel_report", text="", icon="X")


def _draw_side(layout, side, settings, name: str):
    column = layout.column()
    column.prop(side, "method", text=name)
    if side.method == "KDTREE":
        for setting in ("block_count", "split_criterion", "block_probability"):
            column.prop(side, setting)
    elif side.method == "MEDIAN_CUT":
        column.prop(side, "block_count")
    elif side.method == "RESAMPLED":
        column.prop(settings, "candidates")
    elif side.method == "FILTERED":
        column.prop(settings, "filter_samples")


class _ReferencePanel:
    bl_label = "Reference"

    def draw(self, context):
        compared = context.scene.skytree_compare
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(compared, "reference_samples", text="Samples")
        fraction = capture_fraction()
        if fraction is None:
            layout.operator("skytree.capture_reference", icon="RENDER_STILL")
        else:
            row = layout.row(align=True)
            row.label(text=f"Capturing: {100 * fraction:.0f} %", icon="RENDER_STILL")
            row.operator("skytree.cancel_reference", text="", icon="X")
        column = layout.column(heading="Show")
        column.prop(compared, "show_figures")
        column.prop(compared, "show_plot")
        row = layout.row()
        row.active = compared.show_plot
        row.prop(compared, "plot_axis", expand=True)


class _ReportPanel:
    bl_label = "Report"

    def draw(self, context):
        compared = context.scene.skytree_compare
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(compared, "folder", text="Folder")
        layout.operator("skytree.compare_report", icon="FILE_TICK")
        report = background.current()
        if report is not None and report.page is not None:
            layout.operator("skytree.open_report", icon="URL")
        elif report is not None and report.problem:
            for line in wrapped(report.problem):
                layout.label(text=line, icon="ERROR" if line == wrapped(report.problem)[0] else "BLANK1")


class _InView:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Skytree"


class _InRender:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}


class SKYTREE_VIEW_PT_compare(_InView, _ComparePanel, bpy.types.Panel):
    pass


class SKYTREE_VIEW_PT_compare_reference(_InView, _ReferencePanel, bpy.types.Panel):
    bl_parent_id = "SKYTREE_VIEW_PT_compare"


class SKYTREE_VIEW_PT_compare_report(_InView, _ReportPanel, bpy.types.Panel):
    bl_parent_id = "SKYTREE_VIEW_PT_compare"
    bl_options = {"DEFAULT_CLOSED"}


class SKYTREE_RENDER_PT_compare(_InRender, _ComparePanel, bpy.types.Panel):
    pass


class SKYTREE_RENDER_PT_compare_reference(_InRender, _ReferencePanel, bpy.types.Panel):
    bl_parent_id = "SKYTREE_RENDER_PT_compare"


class SKYTREE_RENDER_PT_compare_report(_InRender, _ReportPanel, bpy.types.Panel):
    bl_parent_id = "SKYTREE_RENDER_PT_compare"


CLASSES = (
    SKYTREE_VIEW_PT_compare,
    SKYTREE_VIEW_PT_compare_reference,
    SKYTREE_VIEW_PT_compare_report,
    SKYTREE_RENDER_PT_compare,
    SKYTREE_RENDER_PT_compare_reference,
    SKYTREE_RENDER_PT_compare_report,
)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
