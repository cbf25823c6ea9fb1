# SPDX-License-Identifier: GPL-3.0-or-later
"""A preview that floats: Skytree's picture of a 3D view in its corner, whatever the view itself shows."""

from __future__ import annotations

import traceback

import bpy
from bpy.app.handlers import persistent

from . import clock as viewport_clock
from . import display_transform, gpu_draw
from .hooks import draw_problem
from .renderer import RenderSettings, ViewportRenderer
from .view import View, free_rectangle, view_of

MARGIN = 12
FRAME_COLOR = (0.0, 0.0, 0.0, 0.8)
LABEL_SIZE = 11.0

CORNERS = (
    ("LOWER_LEFT", "Lower Left", "Lower left corner of the view"),
    ("LOWER_RIGHT", "Lower Right", "Lower right corner of the view"),
    ("UPPER_LEFT", "Upper Left", "Upper left corner of the view"),
    ("UPPER_RIGHT", "Upper Right", "Upper right corner of the view"),
)

_renderers: dict[int, ViewportRenderer] = {}  # by the region's address, which is only compared
_handle = None


def renderers() -> list[ViewportRenderer]:
    return list(_renderers.values())


def close_all():
    for renderer in _renderers.values():
        viewport_clock.forget(renderer)
        renderer.close()
    _renderers.clear()


def placed(free: tuple[int, int, int, int], corner: str, size: float) -> tuple[int, int, int, int]:
    """x, y, width, height of the preview in the free part of a region; `size` is its share of either side."""
    x, y, width, height = free
    own_width, own_height = max(round(width * size), 1), max(round(height * size), 1)
    left = x + MARGIN if corner.endswith("LEFT") else x + width - own_width - MARGIN
    low = y + MARGIN if corner.startswith("LOWER") else y + height - own_height - MARGIN
    return left, low, own_width, own_height


def small_view(view: View, width: int, height: int) -> View:
    """The same view on a smaller film of another shape: cut at its edges, never stretched."""
    projection = list(view.projection)
    ratio = (width / height) / (view.width / view.height)
    row = 0 if ratio < 1.0 else 1
    scale = 1.0 / ratio if ratio < 1.0 else ratio
    for column in range(4):
        projection[4 * row + column] *= scale
    return View(view.camera_to_world, tuple(projection), width, height)


def _draw():
    try:
        context = bpy.context
        scene = context.scene
        if not scene.skytree.floating_preview:
            close_all()
            return
        shown_already = context.space_data.shading.type == "RENDERED" and scene.render.engine == "SKYTREE"
        if shown_already or context.region_data is None:
            _forget_region(context.region)
        else:
            _draw_in(context, scene)
    except Exception:  # A handler that raises would fill the console at every redraw.
        traceback.print_exc()


def _draw_in(context, scene):
    region = context.region
    renderer = _renderers.get(region.as_pointer())
    if renderer is None:
        _close_vanished()
        renderer = _renderers[region.as_pointer()] = ViewportRenderer()
        renderer.update(context.evaluated_depsgraph_get(), context.space_data)
    renderer.show_and_hide(context.evaluated_depsgraph_get(), context.space_data)
    free = free_rectangle(context.area, region)
    x, y, width, height = placed(free, scene.skytree.floating_corner, scene.skytree.floating_size / 100.0)
    view = view_of(region, context.region_data, context.space_data, scene)
    if view is not None:
        renderer.look(small_view(view, width, height), RenderSettings.of(scene))
    renderer.wait_for_picture()
    gpu_draw.rectangle(x - 1, y - 1, width + 2, height + 2, FRAME_COLOR)
    if renderer.picture is not None:
        renderer.draw(
            colors=gpu_draw.VIEW_TRANSFORM,
            view_transform=display_transform.view_transform(scene),
            at=(x, y, width, height),
        )
    gpu_draw.label(x, y + height - LABEL_SIZE - 8, f"Skytree  {renderer.status_line()}", LABEL_SIZE)
    draw_problem(renderer.problem, width, x, y)
    if renderer.busy:
        viewport_clock.watch(renderer, region)


def _forget_region(region):
    renderer = _renderers.pop(region.as_pointer(), None)
    if renderer is not None:
        viewport_clock.forget(renderer)
        renderer.close()


def _close_vanished():
    existing = {region.as_pointer() for region, _ in viewport_clock.regions()}
    for pointer in [pointer for pointer in _renderers if pointer not in existing]:
        renderer = _renderers.pop(pointer)
        viewport_clock.forget(renderer)
        renderer.close()


@persistent
def _on_update(scene, depsgraph=None):
    if not _renderers or depsgraph is None:
        return
    for region, area in viewport_clock.regions():
        renderer = _renderers.get(region.as_pointer())
        if renderer is not None:
            renderer.update(depsgraph, area.spaces.active)
            viewport_clock.watch(renderer, region)


@persistent
def _on_replaced(*_):
    # Undo and loading replace all datablocks: what was read from them names nothing any more.
    close_all()


_HANDLERS = (
    ("depsgraph_update_post", _on_update),
    ("frame_change_post", _on_update),
    ("load_pre", _on_replaced),
    ("undo_pre", _on_replaced),
    ("redo_pre", _on_replaced),
)


class SKYTREE_VIEW_PT_floating(bpy.types.Panel):
    bl_label = "Floating Preview"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Skytree"

    def draw_header(self, context):
        self.layout.prop(context.scene.skytree, "floating_preview", text="")

    def draw(self, context):
        settings = context.scene.skytree
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.active = settings.floating_preview
        column.prop(settings, "floating_corner")
        column.prop(settings, "floating_size")
        column.prop(settings, "preview_samples", text="Samples")


def register():
    global _handle
    bpy.utils.register_class(SKYTREE_VIEW_PT_floating)
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)
    _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def unregister():
    global _handle
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    close_all()
    display_transform.clear()
    viewport_clock.stop()
    bpy.utils.unregister_class(SKYTREE_VIEW_PT_floating)
