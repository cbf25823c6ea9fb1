# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels in the Render, World and Material properties, and Blender's own panels that work with this
engine."""

from __future__ import annotations

import bpy

from . import status
from .devices import cuda_problem
from .engine import SkytreeRenderEngine
from .native import CoreUnavailableError
from .presets import SKYTREE_PT_presets

ENGINE = SkytreeRenderEngine.bl_idname

# Panels that belong to another engine but show what is the same for ours: the surface's nodes.
_SHARED_PANELS = {
    "EEVEE_WORLD_PT_surface",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_context_material",
    "MATERIAL_PT_preview",
}
# Panels of settings that this engine does not look at.
_EXCLUDED_PANELS = {
    "RENDER_PT_simplify",
    "RENDER_PT_freestyle",
    "VIEWLAYER_PT_filter",
    "VIEWLAYER_PT_layer_passes",
    "VIEWLAYER_PT_freestyle",
    "VIEWLAYER_PT_freestyle_lineset",
    "MATERIAL_PT_freestyle_line",
    "DATA_PT_camera_dof",
    "DATA_PT_camera_dof_aperture",
    "DATA_PT_light",
    "DATA_PT_area",
    "DATA_PT_spot",
}


class _Panel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES


class _RenderPanel(_Panel):
    bl_context = "render"


class _WorldPanel(_Panel):
    bl_context = "world"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.scene is not None


def _column(layout):
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout.column()


class SKYTREE_RENDER_PT_sampling(_RenderPanel, bpy.types.Panel):
    bl_label = "Sampling"

    def draw_header_preset(self, context):
        SKYTREE_PT_presets.draw_panel_header(self.layout)

    def draw(self, context):
        settings = context.scene.skytree
        column = _column(self.layout)
        column.prop(settings, "samples", text="Render Samples")
        column.prop(settings, "preview_samples", text="Viewport Samples")
        column.prop(settings, "adaptive_sampling")
        column.prop(settings, "seed")
        column.prop(settings, "blue_noise")
        points = column.column()
        points.active = not (settings.adaptive_sampling or settings.blue_noise)
        points.prop(settings, "point_set")


class SKYTREE_RENDER_PT_light_paths(_RenderPanel, bpy.types.Panel):
    bl_label = "Light Paths"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        column = _column(self.layout)
        column.prop(context.scene.skytree, "max_bounces")
        column.prop(context.scene.skytree, "light_rays")
        column.prop(context.scene.skytree, "control_variate")
        column.prop(context.scene.skytree, "product_sampling")
        column.prop(context.scene.skytree, "learn_visibility")


class SKYTREE_RENDER_PT_film(_RenderPanel, bpy.types.Panel):
    bl_label = "Film"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        settings = context.scene.skytree
        column = _column(self.layout)
        column.prop(context.scene.render, "film_transparent", text="Transparent")
        column.prop(settings, "pixel_filter")
        column.prop(settings, "filter_width")


class SKYTREE_RENDER_PT_device(_RenderPanel, bpy.types.Panel):
    bl_label = "Device"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        settings = context.scene.skytree
        render = context.scene.render
        column = _column(self.layout)
        column.prop(settings, "device")
        if settings.device == "CUDA":
            problem = _cuda_problem()
            if problem:
                column.label(text=f"{problem}: the CPU renders", icon="INFO")
        column.prop(render, "threads_mode")
        row = column.column()
        row.enabled = render.threads_mode == "FIXED"
        row.prop(render, "threads")


def _cuda_problem() -> str | None:
    try:
        return cuda_problem()
    except CoreUnavailableError as error:
        return str(error)


class SKYTREE_WORLD_PT_sampler(_WorldPanel, bpy.types.Panel):
    bl_label = "Light Sampling"

    def draw(self, context):
        settings = context.scene.skytree
        column = _column(self.layout)
        column.prop(settings, "sampler")
        if settings.sampler == "MEDIAN_CUT":
            column.prop(settings, "block_count")
        elif settings.sampler == "RESAMPLED":
            column.prop(settings, "candidates")
        elif settings.sampler == "FILTERED":
            column.prop(settings, "filter_samples")
            column.label(text="Biased: blurred at any number of samples", icon="ERROR")


class SKYTREE_WORLD_PT_kdtree(_WorldPanel, bpy.types.Panel):
    bl_label = "Kd-tree"
    bl_parent_id = "SKYTREE_WORLD_PT_sampler"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.scene.skytree.sampler == "KDTREE"

    def draw_header_preset(self, context):
        SKYTREE_PT_presets.draw_panel_header(self.layout)

    def draw(self, context):
        settings = context.scene.skytree
        column = _column(self.layout)
        column.prop(settings, "auto_blocks")
        count = column.column()
        count.active = not settings.auto_blocks
        count.prop(settings, "block_count")
        column.prop(settings, "split_criterion")
        column.prop(settings, "block_probability")
        compensation = column.column()
        compensation.active = settings.block_probability != "FITTED"
        compensation.prop(settings, "compensation")


class SKYTREE_WORLD_PT_figures(_WorldPanel, bpy.types.Panel):
    bl_label = "Last Build"
    bl_parent_id = "SKYTREE_WORLD_PT_sampler"

    def draw(self, context):
        grid = self.layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        rows = figures(status.last)
        if not rows:
            self.layout.label(text="Render once to see figures of the sampler", icon="INFO")
        for label, value in rows:
            grid.label(text=label)
            grid.label(text=value)
        self.layout.operator("skytree.compress_hdri", icon="FILE_TICK")


class SKYTREE_WORLD_PT_messages(_WorldPanel, bpy.types.Panel):
    bl_label = "Messages of the Last Render"
    bl_parent_id = "SKYTREE_WORLD_PT_sampler"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and len(status.last.messages) > 0

    def draw(self, context):
        column = self.layout.column(align=True)
        for severity, text in status.last.messages:
            column.label(text=text, icon="INFO" if severity == "INFO" else "ERROR")


def figures(last: status.Status) -> list[tuple[str, str]]:
    """(label, value) pairs of the sampler that was last used."""
    rows = []
    if not last.sampler:
        return rows
    width, height = last.map_size
    rows.append(("Map", f"{width} x {height}" if width else "one colour"))
    if last.blocks is not None:
        rows.append(("Blocks", str(last.blocks)))
    if last.alpha is not None:
        rows.append(("Alpha", f"{last.alpha:.4g}"))
    if last.fit_error is not None:
        rows.append(("Fit error", f"{last.fit_error:.3g}"))
    if last.nbytes is not None:
        rows.append(("Memory", _bytes(last.nbytes)))
    if last.inversion_nbytes and last.nbytes:
        ratio = last.inversion_nbytes / last.nbytes
        rows.append(("Inversion tables", f"{_bytes(last.inversion_nbytes)} ({ratio:.3g} x)"))
    if last.build_seconds is not None:
        rows.append(("Build", f"{last.build_seconds * 1000.0:.1f} ms"))
    return rows


def _bytes(count: int) -> str:
    if count < 1 << 20:
        return f"{count / 1024.0:.1f} KB"
    return f"{count / (1 << 20):.1f} MB"


class SKYTREE_MATERIAL_PT_ward(_Panel, bpy.types.Panel):
    bl_label = "Anisotropic Ward"
    bl_context = "material"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.material is not None

    def draw_header(self, context):
        self.layout.prop(context.material.skytree, "use_ward", text="")

    def draw(self, context):
        settings = context.material.skytree
        column = _column(self.layout)
        column.enabled = settings.use_ward
        for name in ("ward_color", "ward_alpha_x", "ward_alpha_y", "ward_rotation"):
            column.prop(settings, name)


class SKYTREE_MATERIAL_PT_table(_Panel, bpy.types.Panel):
    bl_label = "Tabulated BRDF"
    bl_context = "material"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.material is not None

    def draw_header(self, context):
        self.layout.prop(context.material.skytree, "use_table", text="")

    def draw(self, context):
        settings = context.material.skytree
        column = _column(self.layout)
        column.enabled = settings.use_table
        column.prop(settings, "table_source")
        if settings.table_source == "MERL":
            names = ("table_file", "table_color")
        else:
            names = ("table_color", "table_alpha_x", "table_alpha_y", "table_rotation")
        for name in names:
            column.prop(settings, name)


CLASSES = (
    SKYTREE_RENDER_PT_sampling,
    SKYTREE_RENDER_PT_light_paths,
    SKYTREE_RENDER_PT_film,
    SKYTREE_RENDER_PT_device,
    SKYTREE_WORLD_PT_sampler,
    SKYTREE_WORLD_PT_kdtree,
    SKYTREE_WORLD_PT_figures,
    SKYTREE_WORLD_PT_messages,
    SKYTREE_MATERIAL_PT_ward,
    SKYTREE_MATERIAL_PT_table,
)


def _blenders_panels():
    for panel in _subclasses(bpy.types.Panel):
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if not isinstance(engines, set) or _is_ours(panel):
            continue
        if panel.__name__ in _SHARED_PANELS or (
            "BLENDER_RENDER" in engines and panel.__name__ not in _EXCLUDED_PANELS
        ):
            yield panel


def _is_ours(panel) -> bool:
    return panel.__module__.startswith(__package__ + ".")


def _subclasses(cls):
    for subclass in cls.__subclasses__():
        yield subclass
        yield from _subclasses(subclass)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    for panel in _blenders_panels():
        panel.COMPAT_ENGINES.add(ENGINE)


def unregister():
    for panel in _subclasses(bpy.types.Panel):
        # Also those that other add-ons registered since; ours keep theirs for the next time.
        if not _is_ours(panel) and isinstance(getattr(panel, "COMPAT_ENGINES", None), set):
            panel.COMPAT_ENGINES.discard(ENGINE)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
