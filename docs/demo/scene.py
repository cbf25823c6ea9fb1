# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene, built by code inside Blender: the teapot in chrome steel among spheres of six materials on
a round table, lit by an environment map alone, as in Figures 3 and 6 of Ergun, Kurt, Ozturk, "Real-time
Kd-tree Based Importance Sampling of Environment Maps" (SCCG 2012).

Works in every engine that knows Blender's own nodes; some of these have their names from Blender 4.0 on.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import shapes
import teapot

# Name of the sphere and its material; x, y, radius.
SPHERES = [
    ("Diffuse", (-2.25, -1.35, 0.52)),
    ("Principled plastic", (-1.08, -1.95, 0.48)),
    ("Glossy 0.5", (0.12, -2.15, 0.48)),
    ("Glossy 0.2", (1.3, -1.85, 0.5)),
    ("Anisotropic", (2.35, -1.1, 0.55)),
    ("Gold", (2.35, 0.75, 0.85)),
]

DIFFUSE, GLOSSY, PRINCIPLED = "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy", "ShaderNodeBsdfPrincipled"
MATERIALS = {
    "Chrome steel": (GLOSSY, {"Color": (0.62, 0.63, 0.64, 1), "Roughness": 0.18}),
    "Table": (DIFFUSE, {"Color": (0.36, 0.34, 0.32, 1)}),
    "Diffuse": (DIFFUSE, {"Color": (0.66, 0.17, 0.1, 1)}),
    "Principled plastic": (PRINCIPLED, {"Base Color": (0.02, 0.16, 0.5, 1), "Roughness": 0.25}),
    "Glossy 0.5": (GLOSSY, {"Color": (0.75, 0.75, 0.75, 1), "Roughness": 0.5}),
    "Glossy 0.2": (GLOSSY, {"Color": (0.9, 0.56, 0.42, 1), "Roughness": 0.2}),
    "Anisotropic": (GLOSSY, {"Color": (0.72, 0.74, 0.78, 1), "Roughness": 0.35, "Anisotropy": 0.8}),
    "Gold": (GLOSSY, {"Color": (1.0, 0.72, 0.32, 1), "Roughness": 0.3}),
}


def build(scene: bpy.types.Scene, hdri: Path, rotation: float = 0.0) -> None:
    """Fills an empty scene: objects, camera, a world of the map, turned by rotation radians about +Z."""
    materials = {name: material(name, *shader) for name, shader in MATERIALS.items()}
    pot = add_mesh(scene, "Teapot", teapot.teapot(segments=16), materials["Chrome steel"])
    pot.scale = (0.62,) * 3
    pot.rotation_euler = (0, 0, math.radians(-28))
    pot.location = (-0.35, 0.35, 0)
    add_mesh(scene, "Table", shapes.table(), materials["Table"])
    for name, (x, y, radius) in SPHERES:
        ball = add_mesh(scene, name, shapes.sphere(48), materials[name])
        ball.scale = (radius,) * 3
        ball.location = (x, y, radius)
    add_camera(scene, position=(0.5, -9.2, 2.05), target=(0.1, 0.0, 0.8), lens=46)
    add_world(scene, hdri, rotation)


def add_mesh(
    scene: bpy.types.Scene, name: str, shape: teapot.Mesh, material: bpy.types.Material
) -> bpy.types.Object:
    """A new object of the shape with its exact normals."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(shape.vertices.tolist(), [], shape.triangles.tolist())
    mesh.polygons.foreach_set("use_smooth", [True] * len(shape.triangles))
    if hasattr(mesh, "use_auto_smooth"):  # Blender < 4.1 ignores custom normals without it
        mesh.use_auto_smooth = True
    mesh.normals_split_custom_set_from_vertices(shape.normals.tolist())
    mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(thing)
    return thing


def material(name: str, node_type: str, inputs: dict) -> bpy.types.Material:
    """A new material of one shader node with these input values."""
    made = bpy.data.materials.new(name)
    if made.node_tree is None:  # from Blender 5.0 on it is there, and touching use_nodes warns
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new(node_type), tree.nodes.new("ShaderNodeOutputMaterial")
    if hasattr(shader, "distribution") and node_type != "ShaderNodeBsdfPrincipled":
        shader.distribution = "GGX"  # Blender's default, Multiscatter GGX, is another model
    for socket, value in inputs.items():
        shader.inputs[socket].default_value = value
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def add_camera(scene: bpy.types.Scene, position: tuple, target: tuple, lens: float) -> None:
    """The scene's camera at position, looking at target, +Z up."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = lens
    camera.location = position
    direction = np.subtract(target, position)
    pitch, heading = (
        math.atan2(-direction[2], math.hypot(*direction[:2])),
        math.atan2(-direction[0], direction[1]),
    )
    camera.rotation_euler = (math.pi / 2 - pitch, 0, heading)
    scene.collection.objects.link(camera)
    scene.camera = camera


def add_world(scene: bpy.types.Scene, hdri: Path, rotation: float) -> None:
    """A world whose background is the lat-long map, turned by rotation radians about +Z."""
    world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    coordinates, mapping, picture, background, output = (
        tree.nodes.new(kind)
        for kind in (
            "ShaderNodeTexCoord",
            "ShaderNodeMapping",
            "ShaderNodeTexEnvironment",
            "ShaderNodeBackground",
            "ShaderNodeOutputWorld",
        )
    )
    picture.image = bpy.data.images.load(str(hdri))
    mapping.inputs["Rotation"].default_value = (0, 0, rotation)
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], picture.inputs["Vector"])
    tree.links.new(picture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    scene.world = world
