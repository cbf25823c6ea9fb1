# SPDX-License-Identifier: GPL-3.0-or-later
"""The kd-tree in the 3D view: blocks of the map on the surrounding sphere and the directions that it
samples."""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from functools import lru_cache

import bpy
import gpu
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ..viewport import clock as viewport_clock
from . import map_pictures, overlay_geometry

LINE_COLOR = (1.0, 1.0, 1.0, 0.35)
DOT_COLOR = (1.0, 0.35, 0.1, 0.9)
DOT_RADIANS = 0.006

_VERTEX = """
void main()
{
  shade = color;
  gl_Position = ModelViewProjectionMatrix * vec4(pos, 1.0);
}
"""
_FRAGMENT = """
void main()
{
  out_color = shade;
}
"""


class SkytreeOverlaySettings(bpy.types.PropertyGroup):
    show_blocks: BoolProperty(
        name="Blocks",
        default=False,
        description="Draw the blocks of the kd-tree around the scene, coloured by their probability",
        update=viewport_clock.redraw_all,
    )
    opacity: FloatProperty(
        name="Opacity",
        default=0.35,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        description="Of the blocks' colours; their borders stay",
        update=viewport_clock.redraw_all,
    )
    show_samples: BoolProperty(
        name="Samples",
        default=False,
        description="Draw directions that the sampler chooses as dots",
        update=viewport_clock.redraw_all,
    )
    sample_count: IntProperty(
        name="Count",
        default=1024,
        min=1,
        soft_max=8192,
        max=65536,
        description="How many directions",
        update=viewport_clock.redraw_all,
    )
    place: EnumProperty(
        name="Sphere",
        items=(
            (
                "INFINITE",
                "Surrounding",
                "About the viewer, where the background shows the map",
            ),
            ("ORIGIN", "At the Origin", "About the origin, to be seen from outside"),
        ),
        default="INFINITE",
        description="Where the sphere stands",
        update=viewport_clock.redraw_all,
    )
    radius: FloatProperty(
        name="Radius",
        default=5.0,
        min=0.01,
        soft_max=100.0,
        subtype="DISTANCE",
        description="Of the sphere at the origin",
        update=viewport_clock.redraw_all,
    )
    picture: EnumProperty(
        name="Picture",
        items=map_pictures.KINDS,
        default="BLOCKS",
        description="What the panel shows of the map",
    )


@dataclass(frozen=True)
class _Shapes:
    key: tuple
    fills: object = None
    lines: object = None
    dots: object = None


_shapes = _Shapes(())
_handle = None


@lru_cache(maxsize=1)
def _shader():
    interface = gpu.types.GPUStageInterfaceInfo("skytree_overlay")
    interface.smooth("VEC4", "shade")
    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    info.vertex_in(0, "VEC3", "pos")
    info.vertex_in(1, "VEC4", "color")
    info.vertex_out(interface)
    info.fragment_out(0, "VEC4", "out_color")
    info.vertex_source(_VERTEX)
    info.fragment_source(_FRAGMENT)
    return gpu.shader.create_from_info(info)


def geometry(current: map_pictures.Current, settings) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(positions (n,3), colours (n,4)) of "fills" (triangles), "lines" and "dots" (triangles), in the map's
    frame."""
    built, parts = current.built, {}
    if settings.show_blocks and hasattr(built.sampler, "bounds"):
        width, height = built.map_size
        bounds = np.asarray(built.sampler.bounds)
        angles = overlay_geometry.block_solid_angles(bounds, width, height)
        colors = overlay_geometry.density_colors(
            np.asarray(built.sampler.probabilities), angles, settings.opacity
        )
        fills, shades, lines = overlay_geometry.blocks(bounds, width, height, colors)
        parts["fills"] = fills, shades
        parts["lines"] = lines, np.tile(np.float32(LINE_COLOR), (len(lines), 1))
    if settings.show_samples and built.settings.has_density:
        samples, _pdf = built.sampler.sample(overlay_geometry.low_discrepancy(settings.sample_count))
        dots = overlay_geometry.dots(samples, DOT_RADIANS)
        parts["dots"] = dots, np.tile(np.float32(DOT_COLOR), (len(dots), 1))
    return parts


def _batches(current: map_pictures.Current, settings) -> _Shapes:
    global _shapes
    key = (current.key, settings.show_blocks, settings.opacity, settings.show_samples, settings.sample_count)
    if _shapes.key != key:
        shader = _shader()
        batches = {
            name: batch_for_shader(
                shader, "LINES" if name == "lines" else "TRIS", {"pos": positions, "color": colors}
            )
            for name, (positions, colors) in geometry(current, settings).items()
        }
        _shapes = _Shapes(key, **batches)
    return _shapes


def draw(current: map_pictures.Current, settings, to_world: Matrix):
    """Draws with the matrices that are loaded; `to_world` places the unit sphere of the map's frame."""
    shapes = _batches(current, settings)
    shader = _shader()
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("NONE")
    try:
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(to_world)
            shader.bind()
            for batch in (shapes.fills, shapes.lines, shapes.dots):
                if batch is not None:
                    batch.draw(shader)
    finally:
        gpu.state.blend_set("NONE")


def placement(settings, environment, region_data, clip_end: float) -> Matrix:
    """Where the unit sphere of the map's frame stands in the world."""
    rotation = Matrix(environment.world_to_env.T.tolist()).to_4x4()
    if settings.place == "ORIGIN":
        return Matrix.Scale(settings.radius, 4) @ rotation
    viewer = region_data.view_matrix.inverted_safe().translation
    return Matrix.Translation(viewer) @ Matrix.Scale(0.5 * clip_end, 4) @ rotation


def _draw():
    try:
        context = bpy.context
        settings, scene = context.scene.skytree_overlay, context.scene
        if context.engine != "SKYTREE" or not (settings.show_blocks or settings.show_samples):
            return
        map_pictures.follow(scene)
        current = map_pictures.current()
        if current is None or current.built.image is None:
            return
        region_data = context.region_data
        if settings.place == "INFINITE" and not region_data.is_perspective:
            return  # all of an orthographic view looks in one direction: nothing surrounds it
        matrix = placement(settings, current.environment, region_data, context.space_data.clip_end)
        draw(current, settings, matrix)
    except Exception:  # A handler that raises would fill the console at every redraw.
        traceback.print_exc()


CLASSES = (SkytreeOverlaySettings,)


def register():
    global _handle
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.skytree_overlay = PointerProperty(type=SkytreeOverlaySettings, name="Skytree Overlay")
    _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister():
    global _handle, _shapes
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle, _shapes = None, _Shapes(())
    del bpy.types.Scene.skytree_overlay
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
