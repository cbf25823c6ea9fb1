# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a world that Skytree cannot read into an HDRI that it can: Cycles renders it as a panorama."""

from __future__ import annotations

import math
import os
import tempfile

import bpy
import numpy as np
from bpy.props import IntProperty

from .world_nodes import connect_texture, packed_image


def bake(world, width: int, samples: int) -> np.ndarray:
    """The world as (width / 2, width, 3) linear lat-long map, row 0 at the top. Raises RuntimeError."""
    if "cycles" not in bpy.context.preferences.addons:
        raise RuntimeError("Baking needs Cycles: enable its add-on in the preferences")
    scene = bpy.data.scenes.new("Skytree bake")
    data = bpy.data.cameras.new("Skytree bake")
    camera = bpy.data.objects.new("Skytree bake", data)
    try:
        scene.collection.objects.link(camera)
        scene.camera, scene.world = camera, world
        # The middle of a lat-long map lies in +X.
        camera.rotation_euler = math.radians(90.0), 0.0, math.radians(-90.0)
        data.type = "PANO"
        # Cycles' setting until 4.5, Blender's own from 5.0 on.
        panorama = data if hasattr(data, "panorama_type") else data.cycles
        panorama.panorama_type = "EQUIRECTANGULAR"
        _set_up_cycles(scene, width, samples)
        with tempfile.TemporaryDirectory() as folder:
            scene.render.filepath = os.path.join(folder, "world.exr")
            bpy.ops.render.render(scene=scene.name, write_still=True)
            return _read(scene.render.filepath)
    finally:
        bpy.data.objects.remove(camera)
        bpy.data.cameras.remove(data)
        bpy.data.scenes.remove(scene)


def _set_up_cycles(scene, width: int, samples: int):
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = width, width // 2
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = False
    scene.render.use_compositing = scene.render.use_sequencer = False
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    cycles = scene.cycles
    cycles.samples, cycles.device = samples, "CPU"
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type = "BOX"
    cycles.film_exposure = 1.0


def _read(path: str) -> np.ndarray:
    image = bpy.data.images.load(path)
    try:
        width, height = image.size
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(height, width, -1)[::-1, :, :3]
        return np.ascontiguousarray(pixels)
    finally:
        bpy.data.images.remove(image)


class SKYTREE_OT_bake_world(bpy.types.Operator):
    bl_idname = "skytree.bake_world"
    bl_label = "Bake World to HDRI"
    bl_description = (
        "Render the world with Cycles into an HDRI, packed into this file, and light with that. "
        "The nodes stay in the tree, unlinked"
    )
    bl_options = {"REGISTER", "UNDO"}

    width: IntProperty(
        name="Width",
        default=2048,
        min=64,
        max=16384,
        description="Width of the map; its height is half of it",
    )
    samples: IntProperty(name="Samples", default=16, min=1, max=4096, description="Samples per texel")

    @classmethod
    def poll(cls, context):
        return context.scene is not None and context.scene.world is not None

    def execute(self, context):
        world = context.scene.world
        try:
            pixels = bake(world, self.width, self.samples)
        except RuntimeError as error:
            self.report({"ERROR"}, f"The world was not baked: {error}")
            return {"CANCELLED"}
        if world.node_tree is None or (bpy.app.version < (5, 0, 0) and not world.use_nodes):
            world.use_nodes = True
        connect_texture(world.node_tree).image = packed_image(f"{world.name} baked", pixels)
        self.report(
            {"INFO"}, f'"{world.name}" is lit by its picture of {pixels.shape[1]} x {pixels.shape[0]}'
        )
        return {"FINISHED"}
