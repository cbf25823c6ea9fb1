# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes Blender's evaluated scene for Mitsuba: the triangles, normals and texture coordinates that Blender's
own engines render, the camera, and the materials of scenes.py read from their nodes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import bpy
import numpy as np


def write(scene: bpy.types.Scene, file: Path) -> None:
    """An .npz: `scene` is JSON (see read_meshes and read_camera); arrays `0_positions` (3 T, 3), `0_normals`,
    `0_uv` (3 T, 2) and so on, one of each a mesh, in world space, three corners a triangle; and the pixels of
    image textures (H, W, 3), top row first, by the image's name."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    arrays: dict[str, np.ndarray] = {}
    meshes = []
    for item in (o for o in depsgraph.objects if o.type == "MESH"):
        number = len(meshes)
        for name, array in read_mesh(item).items():
            arrays[f"{number}_{name}"] = array
        material, pictures = read_material(item.data.materials[0])
        arrays.update(pictures)
        meshes.append({"name": item.name, "material": material})
    described = {"meshes": meshes, "camera": read_camera(scene)}
    np.savez(file, scene=json.dumps(described), **arrays)


def read_mesh(item: bpy.types.Object) -> dict[str, np.ndarray]:
    mesh = item.data
    mesh.calc_loop_triangles()
    triangles = mesh.loop_triangles
    corners, vertices = np.empty(3 * len(triangles), np.int32), np.empty(3 * len(triangles), np.int32)
    triangles.foreach_get("loops", corners)
    triangles.foreach_get("vertices", vertices)
    positions, normals = (
        np.empty(3 * len(mesh.vertices), np.float32),
        np.empty(3 * len(mesh.loops), np.float32),
    )
    mesh.vertices.foreach_get("co", positions)
    mesh.corner_normals.foreach_get("vector", normals)
    matrix = np.array(item.matrix_world, float)
    world = positions.reshape(-1, 3)[vertices] @ matrix[:3, :3].T + matrix[:3, 3]
    turned = normals.reshape(-1, 3)[corners] @ np.linalg.inv(matrix[:3, :3])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    found = {"positions": world.astype(np.float32), "normals": turned.astype(np.float32)}
    if mesh.uv_layers.active:
        uv = np.empty(2 * len(mesh.loops), np.float32)
        mesh.uv_layers.active.data.foreach_get("uv", uv)
        found["uv"] = uv.reshape(-1, 2)[corners]
    return found


def read_camera(scene: bpy.types.Scene) -> dict:
    data = scene.camera.data
    width, height = scene.render.resolution_x, scene.render.resolution_y
    assert data.sensor_fit == "AUTO" and width >= height and not (data.shift_x or data.shift_y)
    angle = 2 * math.degrees(math.atan(data.sensor_width / (2 * data.lens)))
    return {"matrix": [list(row) for row in scene.camera.matrix_world], "x_degrees": angle}


def read_material(material: bpy.types.Material) -> tuple[dict, dict[str, np.ndarray]]:
    """What reaches the surface, and the pixels of the image textures in it."""
    pictures: dict[str, np.ndarray] = {}
    output = material.node_tree.get_output_node("ALL")
    return read_shader(output.inputs["Surface"].links[0].from_node, pictures), pictures


def read_shader(node: bpy.types.Node, pictures: dict) -> dict:
    """{"type": "diffuse" | "glossy" | "mix", …}; anything that is not certain to mean the same is refused."""
    if node.bl_idname == "ShaderNodeBsdfDiffuse":
        if node.inputs["Roughness"].default_value != 0:
            raise ValueError("Oren-Nayar is another model in Mitsuba: Diffuse needs roughness 0")
        return {"type": "diffuse", "color": read_color(node.inputs["Color"], pictures)}
    if node.bl_idname in ("ShaderNodeBsdfAnisotropic", "ShaderNodeBsdfGlossy"):
        if node.distribution != "GGX" or node.inputs["Rotation"].default_value != 0:
            raise ValueError("Glossy needs the distribution GGX and no rotation")
        # As Cycles' node: roughness squared, stretched by the anisotropy along the tangent.
        alpha, share = node.inputs["Roughness"].default_value ** 2, node.inputs["Anisotropy"].default_value
        if share < 0:
            raise ValueError("negative anisotropy is not exported")
        alphas = [alpha * (1 - share), alpha / (1 - share)]
        return {"type": "glossy", "color": read_color(node.inputs["Color"], pictures), "alpha": alphas}
    if node.bl_idname == "ShaderNodeMixShader":
        shaders = [read_shader(node.inputs[i].links[0].from_node, pictures) for i in (1, 2)]
        return {"type": "mix", "share": node.inputs[0].default_value, "shaders": shaders}
    raise ValueError(f"{node.bl_idname} cannot be exported")


def read_color(socket: bpy.types.NodeSocket, pictures: dict) -> list[float] | str:
    """Three numbers, or the name in pictures of the image texture that is linked."""
    if not socket.is_linked:
        return list(socket.default_value)[:3]
    image = socket.links[0].from_node.image
    width, height = image.size
    pixels = np.empty(4 * width * height, np.float32)
    image.pixels.foreach_get(pixels)
    pictures[image.name] = pixels.reshape(height, width, 4)[::-1, :, :3]  # Blender's first row is the lowest
    return image.name
