# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a world show an image, with as little change to its nodes as possible."""

from __future__ import annotations

import os

import bpy
import numpy as np

from ..nodes.reader import active_output


def bundled_maps() -> dict[str, str]:
    """Paths of the HDRIs that Blender brings along, by name."""
    folder = bpy.utils.system_resource("DATAFILES", path="studiolights/world")
    if not folder or not os.path.isdir(folder):
        return {}
    names = sorted(name for name in os.listdir(folder) if name.endswith((".exr", ".hdr")))
    return {os.path.splitext(name)[0]: os.path.join(folder, name) for name in names}


def show_image(scene, image):
    """Lights the scene by `image`: in the Environment Texture that its world has, or in new nodes."""
    if scene.world is None:
        scene.world = bpy.data.worlds.new("World")
    world = scene.world
    if world.node_tree is None or (bpy.app.version < (5, 0, 0) and not world.use_nodes):
        world.use_nodes = True
    tree = world.node_tree
    texture = _texture_in_use(tree)
    if texture is None:
        texture = connect_texture(tree)
    texture.image = image
    return texture


def connect_texture(tree):
    """A new Environment Texture that alone feeds the active output; what fed it before stays in the tree."""
    output = active_output(tree, "OUTPUT_WORLD") or tree.nodes.new("ShaderNodeOutputWorld")
    background = tree.nodes.new("ShaderNodeBackground")
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    x, y = output.location
    background.location = x - 200.0, y - 200.0
    texture.location = x - 520.0, y - 200.0
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    return texture


def _texture_in_use(tree):
    """The Environment Texture that feeds the active output, if there is just one."""
    output = active_output(tree, "OUTPUT_WORLD")
    if output is None:
        return None
    found, waiting, seen = [], [output], set()
    while waiting:
        node = waiting.pop()
        if node.name in seen:
            continue
        seen.add(node.name)
        if node.type == "TEX_ENVIRONMENT":
            found.append(node)
        waiting += [link.from_node for socket in node.inputs for link in socket.links]
    return found[0] if len(found) == 1 else None


def packed_image(name: str, pixels: np.ndarray):
    """A float image with linear pixels (height, width, 3), row 0 at the top, kept inside the .blend file."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=True)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rgba.reshape(-1))
    image.update()
    image.pack()
    return image
