# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that writes the world's map into a small file."""

from __future__ import annotations

import os

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty

from . import native
from .compressed_map import SUFFIX
from .images import ImageStore
from .messages import Messages
from .world import read_world


class SKYTREE_OT_compress_hdri(bpy.types.Operator):
    bl_idname = "skytree.compress_hdri"
    bl_label = "Compress HDRI"
    bl_description = (
        "Write the world's map as the blocks of a kd-tree into a small file, which Skytree lights from alone"
    )

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default=f"*{SUFFIX}", options={"HIDDEN"})
    kilobytes: IntProperty(
        name="Kilobytes", description="Size of the file: as many blocks are made as fit", default=48, min=1
    )
    split_criterion: EnumProperty(
        name="Split",
        description="Which block is split next, and where",
        items=[
            ("SSE", "Squared Error", "The paper's measure: most detail where there is most light"),
            ("MIN_VARIANCE", "Minimum Variance", "More detail in the shadows"),
        ],
    )

    @classmethod
    def poll(cls, context):
        return context.scene is not None and context.scene.world is not None

    def invoke(self, context, event):
        self.filepath = self.filepath or f"{context.scene.world.name}{SUFFIX}"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        messages = Messages()
        environment = read_world(context.scene.world, ImageStore(), messages)
        if environment.expression is None:
            self.report({"ERROR"}, next(iter(messages), ("", "The world shows no image to compress"))[1])
            return {"CANCELLED"}
        path = bpy.path.ensure_ext(bpy.path.abspath(self.filepath), SUFFIX)
        try:
            made = native.core().CompressedMap(
                environment.pixels(), 1024 * self.kilobytes, self.split_criterion
            )
            made.save(path)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        name = os.path.basename(path)
        self.report({"INFO"}, f"{name}: {made.block_count} blocks in {made.nbytes} bytes")
        return {"FINISHED"}


def register():
    bpy.utils.register_class(SKYTREE_OT_compress_hdri)


def unregister():
    bpy.utils.unregister_class(SKYTREE_OT_compress_hdri)
