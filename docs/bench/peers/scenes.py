# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes of cases.py, built inside Blender.

Meshes are triangles with fixed normals, materials are Diffuse and Glossy (GGX) alone, since Principled is not
the same model in any two renderers.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import scene as parts
import shapes
import spheres
import teapot

DIFFUSE, GLOSSY = "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy"
TEXTURE_SIZE = 128


def build(scene: bpy.types.Scene, name: str, hdri: Path, folder: Path) -> None:
    """Empties the scene's file and fills it; what has to be a file, as a texture, goes to folder."""
    for collection in (
        *(bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.images, bpy.data.worlds),
        bpy.data.cameras,
    ):
        for item in list(collection):
            collection.remove(item)
    if name == "spheres":
        spheres.build(scene, hdri)
        return
    {"suzanne": suzanne, "teapot": chrome_teapot, "aniso": anisotropic_sphere, "room": room}[name](
        scene, folder
    )
    parts.add_world(scene, hdri, 0.0)


def grey(value: float) -> dict:
    return {"Color": (value, value, value, 1)}


def add_ground(scene: bpy.types.Scene) -> None:
    material = parts.material("Ground", DIFFUSE, grey(0.5))
    parts.add_mesh(scene, "Ground", quad((-50, -50, 0), (100, 0, 0), (0, 100, 0)), material)


def quad(corner: tuple, u: tuple, v: tuple) -> teapot.Mesh:
    """The parallelogram corner + s u + t v, facing u × v."""
    corner, u, v = (np.array(a, float) for a in (corner, u, v))
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    corners = np.array([corner, corner + u, corner + u + v, corner + v])
    return teapot.Mesh(corners, np.tile(normal, (4, 1)), np.array([(0, 1, 2), (0, 2, 3)], np.int32))


def suzanne(scene: bpy.types.Scene, folder: Path) -> None:
    add_ground(scene)
    bpy.ops.mesh.primitive_monkey_add(size=2.6, location=(0, 0, 1.25), rotation=(-0.25, 0, 0.35))
    monkey = bpy.context.object
    subdivision = monkey.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels = subdivision.render_levels = 3
    monkey.modifiers.new("Triangles", "TRIANGULATE")
    evaluated = monkey.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(evaluated)
    monkey.modifiers.clear()
    monkey.data = mesh
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.materials.clear()
    mesh.materials.append(textured_material(folder))
    aim(scene, 1.1)


def textured_material(folder: Path) -> bpy.types.Material:
    """80 % Diffuse with coloured grain and stripes from an image, 20 % Glossy GGX 0.35."""
    material = parts.material("Painted", DIFFUSE, {})
    tree = material.node_tree
    diffuse = next(node for node in tree.nodes if node.bl_idname == DIFFUSE)
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    glossy, mix, picture = (
        tree.nodes.new(kind) for kind in (GLOSSY, "ShaderNodeMixShader", "ShaderNodeTexImage")
    )
    glossy.distribution = "GGX"
    glossy.inputs["Roughness"].default_value = 0.35
    glossy.inputs["Color"].default_value = (0.9, 0.9, 0.9, 1)
    picture.image = bpy.data.images.load(str(write_texture(folder)))
    picture.image.colorspace_settings.name = "Non-Color"
    mix.inputs[0].default_value = 0.2
    tree.links.new(picture.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], mix.inputs[1])
    tree.links.new(glossy.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def write_texture(folder: Path) -> Path:
    """An EXR of coloured grain with stripes, not symmetric, so that a mirrored texture would show."""
    rng = np.random.default_rng(5)
    pixels = np.ones((TEXTURE_SIZE, TEXTURE_SIZE, 4), np.float32)
    pixels[..., :3] = 0.2 + 0.4 * rng.random((TEXTURE_SIZE, TEXTURE_SIZE, 3), np.float32)
    pixels[:, ::8, 0] = 0.8
    pixels[: TEXTURE_SIZE // 2, :, 2] *= 0.5
    image = bpy.data.images.new("Paint", TEXTURE_SIZE, TEXTURE_SIZE, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(pixels.reshape(-1))
    image.filepath_raw, image.file_format = str(folder / "paint.exr"), "OPEN_EXR"
    image.save()
    bpy.data.images.remove(image)
    return folder / "paint.exr"


def aim(scene: bpy.types.Scene, height: float) -> None:
    parts.add_camera(scene, position=(0, -6.2, 4.6), target=(0, 0, height), lens=40)


def chrome_teapot(scene: bpy.types.Scene, _: Path) -> None:
    add_ground(scene)
    chrome = parts.material("Chrome", GLOSSY, {**grey(0.75), "Roughness": 0.1})
    pot = parts.add_mesh(scene, "Teapot", teapot.teapot(segments=16), chrome)
    pot.scale = (0.7,) * 3
    pot.rotation_euler = (0, 0, math.radians(-28))
    aim(scene, 0.9)


def anisotropic_sphere(scene: bpy.types.Scene, _: Path) -> None:
    add_ground(scene)
    brushed = parts.material("Brushed", GLOSSY, {**grey(0.8), "Roughness": 0.35, "Anisotropy": 0.7})
    ball = parts.add_mesh(scene, "Ball", shapes.sphere(96), brushed)
    ball.scale = (1.4,) * 3
    ball.location = (0, 0, 1.4)
    add_azimuth_uv(ball.data)
    aim(scene, 1.1)


def add_azimuth_uv(mesh: bpy.types.Mesh) -> None:
    """u along the azimuth about z: the direction that Blender takes for the tangent where none is linked,
    told to renderers that take it from texture coordinates."""
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    corner = positions.reshape(-1, 3)[corners].reshape(-1, 3, 3).astype(float)
    azimuth = np.arctan2(corner[..., 1], corner[..., 0]) / (2 * np.pi)
    pole = np.hypot(corner[..., 0], corner[..., 1]) < 1e-6
    first = np.where(pole[:, :1], azimuth[:, 1:2], azimuth[:, :1])
    azimuth = first + (azimuth - first + 0.5) % 1 - 0.5  # no jump of a turn inside a triangle
    others = (azimuth.sum(1, keepdims=True) - azimuth) / 2
    azimuth = np.where(pole, others, azimuth)
    uv = np.stack([azimuth, np.arcsin(np.clip(corner[..., 2], -1, 1)) / np.pi + 0.5], -1)
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uv.astype(np.float32).reshape(-1))


def room(scene: bpy.types.Scene, _: Path) -> None:
    """4 m × 5 m × 2.6 m; the window is in the wall x = 2, the camera looks at the corner beside it."""
    walls = parts.material("Walls", DIFFUSE, grey(0.75))
    sill, head, left, right = 0.9, 2.0, 1.6, 3.0
    faces = {
        "Floor": ((-2, 0, 0), (4, 0, 0), (0, 5, 0)),
        "Ceiling": ((-2, 0, 2.6), (0, 5, 0), (4, 0, 0)),
        "Back": ((-2, 5, 0), (4, 0, 0), (0, 0, 2.6)),
        "Front": ((2, 0, 0), (-4, 0, 0), (0, 0, 2.6)),
        "Left": ((-2, 0, 0), (0, 5, 0), (0, 0, 2.6)),
        "Below": ((2, 5, 0), (0, -5, 0), (0, 0, sill)),
        "Above": ((2, 5, head), (0, -5, 0), (0, 0, 2.6 - head)),
        "Beside": ((2, 5, sill), (0, right - 5, 0), (0, 0, head - sill)),
        "Before": ((2, left, sill), (0, -left, 0), (0, 0, head - sill)),
    }
    for name, face in faces.items():
        parts.add_mesh(scene, name, quad(*face), walls)
    ball = parts.add_mesh(
        scene, "Ball", shapes.sphere(48), parts.material("Glossy", GLOSSY, {**grey(0.8), "Roughness": 0.3})
    )
    ball.scale, ball.location = (0.5,) * 3, (-0.2, 3.0, 0.5)
    clay = parts.material("Clay", DIFFUSE, {"Color": (0.7, 0.35, 0.2, 1)})
    pot = parts.add_mesh(scene, "Teapot", teapot.teapot(segments=12), clay)
    pot.scale, pot.location = (0.28,) * 3, (0.9, 2.1, 0)
    parts.add_camera(scene, position=(-1.7, 0.3, 1.7), target=(0.5, 3.2, 0.7), lens=24)
