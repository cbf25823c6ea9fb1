# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison in the regions of 3D views: who shows one, what is drawn over it, and the line to drag."""

from __future__ import annotations

import traceback

import bpy
from bpy.app.handlers import persistent
from bpy.props import IntProperty

from ..viewport import clock as viewport_clock
from ..viewport.renderer import ViewportRenderer
from ..viewport.view import free_rectangle, view_of
from . import draw as compare_draw
from . import labels
from .sides import Request
from .view import CompareView

GRAB_PIXELS = 8

# By the address of the region, which is only compared.
_views: dict[int, CompareView] = {}
_handle = None


def view_in(region) -> CompareView | None:
    return _views.get(region.as_pointer()) if region is not None else None


def draw(renderer: ViewportRenderer, context) -> bool:
    """Draws the comparison in place of the renderer's own picture; False where none is wanted."""
    region, scene = context.region, context.scene
    compared = scene.skytree_compare
    view = view_in(region)
    if compared.mode == "OFF" or (view is not None and not view.belongs_to(renderer)):
        _close(region)
        view = None
    if compared.mode == "OFF" or renderer.sync is None or renderer.sync.built is None:
        return False
    seen = view_of(region, context.region_data, context.space_data, scene)
    if seen is None:
        return False
    if view is None:
        _close_vanished()
        view = _views[region.as_pointer()] = CompareView(renderer)
    view.look(Request.of(seen, scene))
    view.wait_for_picture()
    compare_draw.draw_pictures(view, compared.mode, compared.split, compared.show_b, compared.gain)
    if view.busy:
        viewport_clock.watch(view, region)
    return True


def follow(renderer: ViewportRenderer, context):
    """Lets a comparison know of changes of the scene before it is drawn: Blender draws other regions first,
    and samplers are built meanwhile."""
    view, scene = view_in(context.region), context.scene
    if view is None or not view.belongs_to(renderer) or view.request is None:
        return
    if scene.skytree_compare.mode != "OFF":
        view.look(Request.of(view.request.view, scene))
        view.advance()


def forget(renderer: ViewportRenderer):
    """For a renderer that is going to be closed."""
    for pointer, view in list(_views.items()):
        if view.belongs_to(renderer):
            viewport_clock.forget(view)
            view.close()
            del _views[pointer]


def close_all(*_):
    for view in _views.values():
        viewport_clock.forget(view)
        view.close()
    _views.clear()


def _close_vanished():
    """Closes the comparisons of regions that are gone, such as those of a quad view that was left."""
    existing = {region.as_pointer() for region, _ in viewport_clock.regions()}
    for pointer in [pointer for pointer in _views if pointer not in existing]:
        view = _views.pop(pointer)
        viewport_clock.forget(view)
        view.close()


def _close(region):
    view = _views.pop(region.as_pointer(), None)
    if view is not None:
        viewport_clock.forget(view)
        view.close()


def _is_shown(context) -> bool:
    """Whether the region of `context` shows a comparison at this moment."""
    space = context.space_data
    return (
        context.engine == "SKYTREE"
        and space is not None
        and space.type == "VIEW_3D"
        and space.shading.type == "RENDERED"
        and context.scene.skytree_compare.mode != "OFF"
        and view_in(context.region) is not None
    )


def _draw_over():
    try:
        context = bpy.context
        if _is_shown(context):
            view, compared = view_in(context.region), context.scene.skytree_compare
            labels.draw_over(view, compared, _uncovered(context), context.preferences.system.ui_scale)
    except Exception:  # A handler that raises would fill the console at every redraw.
        traceback.print_exc()


def _uncovered(context) -> tuple[int, int, int, int]:
    """x, y, width, height of what headers, sidebars, Blender's own text and its navigation gizmo leave."""
    x, y, width, height = free_rectangle(context.area, context.region)
    space, scale = context.space_data, context.preferences.system.ui_scale
    if space.overlay.show_overlays and space.overlay.show_text:
        height -= round(50 * scale)
    if space.show_gizmo and space.show_gizmo_navigate:
        width -= round(96 * scale)
    return x, y, width, height


class SKYTREE_OT_compare_drag(bpy.types.Operator):
    """Drag the line between A and B"""

    bl_idname = "skytree.compare_drag"
    bl_label = "Drag Comparison Line"
    bl_options = {"INTERNAL", "UNDO"}

    @classmethod
    def poll(cls, context):
        return _is_shown(context) and context.scene.skytree_compare.mode == "SPLIT"

    def invoke(self, context, event):
        self._before = context.scene.skytree_compare.split
        context.window_manager.modal_handler_add(self)
        context.window.cursor_modal_set("MOVE_X")
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        compared, view = context.scene.skytree_compare, view_in(context.region)
        if view is None or event.type in {"ESC", "RIGHTMOUSE"}:
            compared.split = self._before
        elif event.type == "MOUSEMOVE":
            x, _, width, _ = view.request.view.rectangle
            compared.split = (event.mouse_region_x - x) / width
            return {"RUNNING_MODAL"}
        elif not (event.type == "LEFTMOUSE" and event.value == "RELEASE"):
            return {"RUNNING_MODAL"}
        context.window.cursor_modal_restore()
        return {"FINISHED"}


class SKYTREE_OT_compare_flip(bpy.types.Operator):
    """Show the other one of A and B"""

    bl_idname = "skytree.compare_flip"
    bl_label = "Flip A and B"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return context.scene is not None and context.scene.skytree_compare.mode == "FLIP"

    def execute(self, context):
        compared = context.scene.skytree_compare
        compared.show_b = not compared.show_b
        return {"FINISHED"}


class SKYTREE_OT_capture_reference(bpy.types.Operator):
    """Render a reference of each view that compares, in the background; errors are measured against it"""

    bl_idname = "skytree.capture_reference"
    bl_label = "Capture Reference"

    samples: IntProperty(
        name="Samples", min=0, options={"SKIP_SAVE"}, description="Samples per pixel; 0: the scene's setting"
    )

    @classmethod
    def poll(cls, context):
        if not any(view.request is not None for view in _views.values()):
            cls.poll_message_set("Choose Split, Side by Side, Flip or Difference in a rendered view first")
            return False
        return True

    def execute(self, context):
        samples = self.samples or context.scene.skytree_compare.reference_samples
        for region, _area in viewport_clock.regions():
            view = view_in(region)
            if view is not None and view.request is not None:
                view.start_capture(samples)
                viewport_clock.watch(view, region)
        viewport_clock.redraw_all()
        return {"FINISHED"}


class SKYTREE_OT_cancel_reference(bpy.types.Operator):
    """Stop rendering the reference; an earlier one stays"""

    bl_idname = "skytree.cancel_reference"
    bl_label = "Cancel Reference"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return capture_fraction() is not None

    def execute(self, context):
        for view in _views.values():
            view.cancel_capture()
        viewport_clock.redraw_all()
        return {"FINISHED"}


def capture_fraction() -> float | None:
    """How far the references are that are being captured, 0..1; None if none is."""
    fractions = [view.capture.fraction for view in _views.values() if view.capture is not None]
    return min(fractions) if fractions else None


class SKYTREE_GT_compare_line(bpy.types.Gizmo):
    """The line itself is drawn by labels.py; this makes it something that can be grabbed."""

    bl_idname = "SKYTREE_GT_compare_line"

    def draw(self, context):
        pass

    def test_select(self, context, location):
        view = view_in(context.region)
        if view is None:
            return -1
        at = compare_draw.split_position(view, context.scene.skytree_compare.split)
        return 0 if abs(location[0] - at) <= GRAB_PIXELS else -1


class SKYTREE_GGT_compare_line(bpy.types.GizmoGroup):
    bl_idname = "SKYTREE_GGT_compare_line"
    bl_label = "Comparison Line"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SCALE", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, context):
        return SKYTREE_OT_compare_drag.poll(context)

    def setup(self, context):
        line = self.gizmos.new(SKYTREE_GT_compare_line.bl_idname)
        line.target_set_operator(SKYTREE_OT_compare_drag.bl_idname)
        line.use_draw_modal = True


@persistent
def _on_load(*_):
    close_all()


CLASSES = (
    SKYTREE_OT_compare_drag,
    SKYTREE_OT_compare_flip,
    SKYTREE_OT_capture_reference,
    SKYTREE_OT_cancel_reference,
    SKYTREE_GT_compare_line,
    SKYTREE_GGT_compare_line,
)
_keymap_items = []


def register():
    global _handle
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    _handle = bpy.types.SpaceView3D.draw_handler_add(_draw_over, (), "WINDOW", "POST_PIXEL")
    bpy.app.handlers.load_pre.append(_on_load)
    keys = bpy.context.window_manager.keyconfigs.addon
    if keys is not None:  # there are none in background
        keymap = keys.keymaps.new(name="3D View", space_type="VIEW_3D")
        # J as in the Image Editor, where it goes through the render slots.
        item = keymap.keymap_items.new(SKYTREE_OT_compare_flip.bl_idname, "J", "PRESS")
        _keymap_items.append((keymap, item))


def unregister():
    global _handle
    for keymap, item in _keymap_items:
        keymap.keymap_items.remove(item)
    _keymap_items.clear()
    bpy.app.handlers.load_pre.remove(_on_load)
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
    close_all()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
