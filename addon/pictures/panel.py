# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the pictures of the map and of the overlay, and pictures as images."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import IntProperty

from ..problems.panel import wrapped
from . import map_pictures


class _PicturePanel:
    bl_label = "Pictures of the Map"
    COMPAT_ENGINES = {"SKYTREE"}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES and context.scene.world is not None

    def draw(self, context):
        settings, layout = context.scene.skytree_overlay, self.layout
        layout.row().prop(settings, "picture", expand=True)
        map_pictures.follow(context.scene, settings.picture)
        icon = map_pictures.icon(settings.picture)
        if icon:
            layout.template_icon(icon, scale=min(max(context.region.width / 24.0, 6.0), 16.0))
            column = layout.column(align=True)
            column.scale_y = 0.8
            characters = max(round(context.region.width / (7.5 * context.preferences.system.ui_scale)), 20)
            for line in wrapped(caption(settings.picture, map_pictures.current()), characters):
                column.label(text=line)
        elif map_pictures.problem():
            layout.label(text=map_pictures.problem(), icon="ERROR")
        else:
            current = map_pictures.current()
            needs_tree = current is not None and settings.picture != "EXPOSURE"
            text = "The world has no map, or no kd-tree samples it" if needs_tree else "Drawing"
            layout.label(text=text, icon="INFO")
        layout.operator("skytree.picture_image", icon="IMAGE_DATA")


def caption(kind: str, current) -> str:
    """What a picture shows, in the words of a panel."""
    if kind == "EXPOSURE":
        return "Stops about the map's median. Grey: share of the sphere; orange: share of the light."
    sampler = current.built.sampler if current is not None else None
    if not hasattr(sampler, "block_count"):
        return ""
    if kind == "PDF":
        return (
            f"Probabilities of the {sampler.block_count} blocks in descending order. Dots: of the map; "
            f"line: the fitted model, alpha {sampler.alpha:.3g}."
        )
    return f"Above: the map with its {sampler.block_count} blocks. Below: rebuilt from the blocks alone."


class SKYTREE_WORLD_PT_pictures(_PicturePanel, bpy.types.Panel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "world"
    bl_parent_id = "SKYTREE_WORLD_PT_sampler"


class SKYTREE_VIEW_PT_pictures(_PicturePanel, bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Skytree"
    bl_options = {"DEFAULT_CLOSED"}


class SKYTREE_VIEW_PT_overlay(bpy.types.Panel):
    bl_label = "Sampler Overlay"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Skytree"

    @classmethod
    def poll(cls, context):
        return context.engine == "SKYTREE"

    def draw(self, context):
        settings, layout = context.scene.skytree_overlay, self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column(heading="Show")
        column.prop(settings, "show_blocks")
        row = column.row()
        row.active = settings.show_blocks
        row.prop(settings, "opacity")
        column.prop(settings, "show_samples")
        row = column.row()
        row.active = settings.show_samples
        row.prop(settings, "sample_count")
        layout.prop(settings, "place")
        if settings.place == "ORIGIN":
            layout.prop(settings, "radius")
        if context.scene.skytree.sampler == "KDTREE":
            layout.prop(context.scene.skytree, "block_count")
        elif settings.show_blocks:
            layout.label(text="Only the kd-tree has blocks", icon="INFO")


class SKYTREE_OT_picture_image(bpy.types.Operator):
    """Make an image of this picture, larger, to look at in the Image Editor and to save"""

    bl_idname = "skytree.picture_image"
    bl_label = "Picture to Image"

    size: IntProperty(name="Size", default=2048, min=64, max=8192, description="Width and height, pixels")

    @classmethod
    def poll(cls, context):
        current = map_pictures.current()
        return current is not None and current.built.image is not None

    def execute(self, context):
        kind = context.scene.skytree_overlay.picture
        pixels = map_pictures.picture(map_pictures.current().built, kind, self.size, self.size)
        if pixels is None:
            self.report({"ERROR"}, "Only the kd-tree has this picture: choose it under Light Sampling")
            return {"CANCELLED"}
        name = f"Skytree {kind.title()}"
        old = bpy.data.images.get(name)
        if old is not None:
            bpy.data.images.remove(old)
        image = bpy.data.images.new(name, self.size, self.size)
        rgba = np.ones((self.size, self.size, 4), np.float32)
        rgba[..., :3] = pixels[::-1]
        image.pixels.foreach_set(rgba.ravel())
        image.update()
        self.report({"INFO"}, f'The picture is the image "{name}"')
        return {"FINISHED"}


CLASSES = (
    SKYTREE_WORLD_PT_pictures,
    SKYTREE_VIEW_PT_overlay,
    SKYTREE_VIEW_PT_pictures,
    SKYTREE_OT_picture_image,
)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
