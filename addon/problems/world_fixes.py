# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators behind the Fix buttons of the World panel's warnings."""

from __future__ import annotations

import os

import bpy
from bpy.props import EnumProperty, StringProperty

from .. import compressed_map
from ..images import read_pixels
from ..map_figures import repaired
from .bake_world import SKYTREE_OT_bake_world
from .world_nodes import bundled_maps, packed_image, show_image

_items: list[tuple[str, str, str]] = []


def _bundled_items(self, context):
    # Blender does not keep the strings of dynamic enumerations: they must live here.
    _items[:] = [(name, name.title(), f"Light the scene by Blender's {name}") for name in bundled_maps()]
    return _items or [("NONE", "None", "This Blender brings no HDRIs along")]


class SKYTREE_OT_add_hdri(bpy.types.Operator):
    bl_idname = "skytree.add_hdri"
    bl_label = "Add HDRI"
    bl_description = "Light the world by one of the HDRIs that Blender brings along"
    bl_options = {"REGISTER", "UNDO"}

    name: EnumProperty(name="HDRI", items=_bundled_items)

    @classmethod
    def poll(cls, context):
        return context.scene is not None

    def execute(self, context):
        path = bundled_maps().get(self.name)
        if path is None:
            self.report({"ERROR"}, "This Blender brings no HDRIs along; open one of your own")
            return {"CANCELLED"}
        show_image(context.scene, bpy.data.images.load(path, check_existing=True))
        return {"FINISHED"}


class SKYTREE_OT_open_hdri(bpy.types.Operator):
    bl_idname = "skytree.open_hdri"
    bl_label = "Open HDRI"
    bl_description = "Choose an image file and light the world by it"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(
        default="*.exr;*.hdr;*.pic;*.tif;*.tiff;*.png;*.jpg;*.jpeg;*.skymap", options={"HIDDEN"}
    )

    @classmethod
    def poll(cls, context):
        return context.scene is not None

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        try:
            image = bpy.data.images.load(self.filepath, check_existing=True)
        except RuntimeError as error:
            self.report({"ERROR"}, f"{os.path.basename(self.filepath)} was not opened: {error}")
            return {"CANCELLED"}
        if compressed_map.is_compressed(image):
            try:
                compressed_map.decode(image, bpy.path.abspath(self.filepath))
            except ValueError as error:
                bpy.data.images.remove(image)
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        elif not all(image.size):
            bpy.data.images.remove(image)
            self.report({"ERROR"}, f"{self.filepath} is not an image that Blender can open")
            return {"CANCELLED"}
        show_image(context.scene, image)
        return {"FINISHED"}


class SKYTREE_OT_repair_hdri(bpy.types.Operator):
    bl_idname = "skytree.repair_hdri"
    bl_label = "Repair HDRI"
    bl_description = (
        "Replace texels that are negative, infinite or not a number by the mean of their neighbours, "
        "in a copy that is packed into this file"
    )
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.scene is not None and context.scene.world is not None

    def execute(self, context):
        world = context.scene.world
        count = 0
        for node in world.node_tree.nodes if world.node_tree else ():
            if node.type == "TEX_ENVIRONMENT" and node.image is not None:
                try:
                    pixels = read_pixels(node.image)[..., :3]
                except ValueError:
                    continue
                if pixels.shape[2] == 3 and (mended := repaired(pixels)).tobytes() != pixels.tobytes():
                    node.image = packed_image(f"{node.image.name} repaired", mended)
                    count += 1
        if not count:
            self.report({"INFO"}, "There was nothing to repair")
            return {"CANCELLED"}
        return {"FINISHED"}


class SKYTREE_OT_use_uniform(bpy.types.Operator):
    bl_idname = "skytree.use_uniform"
    bl_label = "Sample Uniformly"
    bl_description = "Use the uniform sampler, which needs no tables, for a map that is even anyway"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        context.scene.skytree.sampler = "UNIFORM"
        return {"FINISHED"}


CLASSES = (
    SKYTREE_OT_bake_world,
    SKYTREE_OT_add_hdri,
    SKYTREE_OT_open_hdri,
    SKYTREE_OT_repair_hdri,
    SKYTREE_OT_use_uniform,
)
