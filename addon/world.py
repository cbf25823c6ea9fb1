# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads Blender's world into one environment map, a rotation and a colour factor.

The node tree is walked from its active output. The constant colour factor and, where all image look-ups share
it, the rotation stay apart from the map: changing them needs no new pixels and no new sampler. Everything
else (colour nodes, mirrored or stretched coordinates, several images) is computed once into a new lat-long
map.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import latlong
from .images import ImageSource, ImageStore
from .messages import Messages
from .nodes import expression as ex
from .nodes.reader import NodeReader, Place, active_output, follow
from .nodes.vectors import affine_direction, split_rotation
from .version import uses_nodes

MIN_COMPUTED_HEIGHT = 256
IDENTITY_ROWS = tuple(map(tuple, np.eye(3)))


@dataclass(frozen=True)
class MapTexture:
    """An Environment Texture: shows in direction d the image at normalize(matrix d + offset)."""

    image: ImageSource
    mirror_ball: bool
    matrix: tuple = IDENTITY_ROWS
    offset: tuple = (0.0, 0.0, 0.0)

    @property
    def is_plain(self) -> bool:
        return not self.mirror_ball and self.matrix == IDENTITY_ROWS and not any(self.offset)

    def texels(self) -> np.ndarray:
        return self.image.rgb()


@dataclass
class Environment:
    """`radiance(d) = color * expression(world_to_env d)`; the expression is its own cache key.

    `expression` is None for a world of one colour."""

    expression: ex.Expression | None = None
    color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    world_to_env: np.ndarray = field(default_factory=lambda: np.eye(3))
    visible: bool = True
    name: str = ""

    def pixels(self) -> np.ndarray:
        """(height, width, 3) float32 lat-long map; raises ValueError if an image cannot be read."""
        return render_map(self.expression)


def read_world(world, store: ImageStore, messages: Messages) -> Environment:
    """`world` is the evaluated world of the depsgraph's scene, or None."""
    if world is None:
        messages.warn(
            "The scene has no world: it is lit by emitting surfaces alone; "
            "add a world with an Environment Texture in the World properties"
        )
        return Environment()
    owner = f'World "{world.name}"'
    visible = getattr(getattr(world, "cycles_visibility", None), "camera", True)
    if not uses_nodes(world):
        return Environment(color=tuple(world.color), visible=visible, name=world.name)
    expression = _WorldReader(owner, store, messages).read(world.node_tree)
    color, rest = ex.split_scale(expression)
    if min(color) < 0.0:
        messages.warn(f"{owner}: a negative strength or colour is treated as zero")
        color = tuple(max(c, 0.0) for c in color)
    if isinstance(rest, ex.Constant):
        if not any(color):
            messages.info(f"{owner}: the background is black")
        return Environment(color=color, visible=visible, name=world.name)
    rest, rotation = _factor_rotation(rest)
    return Environment(rest, color, rotation, visible, world.name)


class _WorldReader:
    def __init__(self, owner: str, store: ImageStore, messages: Messages):
        self.owner, self.store, self.messages = owner, store, messages
        self.reader = NodeReader(owner, messages, self._image, camera_ray=0.0)

    def read(self, tree) -> ex.Expression:
        output = active_output(tree, "OUTPUT_WORLD")
        if output is None:
            self.messages.warn(f"{self.owner}: the node tree has no World Output; the background is black")
            return ex.BLACK
        if any(link.is_valid for link in output.inputs["Volume"].links):
            self.messages.warn(f"{self.owner}: the volume is left out")
        return self._closure(Place(output.inputs["Surface"]))

    def _closure(self, place: Place) -> ex.Expression:
        output, _ = follow(place)
        if output is None:
            if place.node.type == "OUTPUT_WORLD":
                self.messages.warn(f"{self.owner}: nothing is linked to the Surface; the background is black")
            return ex.BLACK
        node = output.node
        if node.type in {"BACKGROUND", "EMISSION"}:
            color, strength = self.reader.inputs(output, "Color", "Strength")
            return ex.multiply(color, strength)
        if node.type in {"MIX_SHADER", "ADD_SHADER"}:
            first, second = (self._closure(Place(s, output.groups)) for s in list(node.inputs)[-2:])
            if node.type == "ADD_SHADER":
                return ex.add(first, second)
            factor = ex.call("clamp", self.reader.value(output.input("Fac")), ex.constant(0.0), ex.ONE)
            inverse = ex.call("invert", ex.ONE, factor)
            return ex.add(_times(first, inverse), _times(second, factor))
        if output.socket.type != "SHADER":
            # A colour plugged straight into a shader socket shines with strength 1 in Cycles.
            return self._as_color(output)
        self.messages.warn(
            f'{self.owner}: the shader "{node.name}" ({node.bl_label}) has no meaning for a '
            "background and is left out",
            topic="NODE",
        )
        return ex.BLACK

    def _as_color(self, output: Place) -> ex.Expression:
        value = self.reader.output(output)
        if value is None:
            self.messages.warn(
                f'{self.owner}: the node "{output.node.name}" ({output.node.bl_label}) cannot be '
                "read; the background is black",
                topic="NODE",
            )
            return ex.BLACK
        return value if ex.channels(value) == 3 else ex.call("combine", value, value, value)

    def _image(self, output: Place) -> ex.Expression | None:
        node = output.node
        if node.type != "TEX_ENVIRONMENT":
            return None
        if node.image is None:
            self.messages.warn(
                f'{self.owner}: the Environment Texture "{node.name}" has no image; '
                "it shows magenta, as in Cycles",
                topic="IMAGE",
            )
            return ex.constant((1.0, 0.0, 1.0))
        source = self.store.source(node.image, node.image_user, self.owner, self.messages)
        if source is None:
            return ex.constant((1.0, 0.0, 1.0))
        if node.interpolation not in {"Linear", "Cubic", "Smart"}:
            self.messages.info(
                f'{self.owner}: the interpolation {node.interpolation} of "{node.name}" is shown as Linear'
            )
        matrix, offset = affine_direction(output.input("Vector"), self.reader)
        return ex.Leaf(
            MapTexture(
                source,
                node.projection == "MIRROR_BALL",
                tuple(map(tuple, matrix.tolist())),
                tuple(offset.tolist()),
            )
        )


def _times(a: ex.Expression, b: ex.Expression) -> ex.Expression:
    if ex.Constant((0.0,)) in (a, b) or ex.BLACK in (a, b):
        return ex.BLACK
    return ex.multiply(a, b)


def _factor_rotation(expression: ex.Expression) -> tuple[ex.Expression, np.ndarray]:
    """(expression in the map's frame, world_to_env): a rotation that all look-ups share is taken out of
    them."""
    textures = {leaf.source for leaf in ex.leaves(expression)}
    splits = {
        texture: split_rotation(np.array(texture.matrix), np.array(texture.offset)) for texture in textures
    }
    rotations = [rotation for rotation, _ in splits.values()]
    if not all(np.allclose(rotation, rotations[0], atol=1e-6) for rotation in rotations):
        return expression, np.eye(3)

    def in_frame(leaf):
        texture = leaf.source
        rest = splits[texture][1]
        offset = texture.offset
        return ex.Leaf(
            MapTexture(texture.image, texture.mirror_ball, tuple(map(tuple, rest.tolist())), offset)
        )

    return ex.replace_leaves(expression, in_frame), rotations[0]


def render_map(expression: ex.Expression) -> np.ndarray:
    """The lat-long map (height, width, 3) of an environment's expression."""
    loaded = {leaf: leaf.source.texels() for leaf in set(ex.leaves(expression))}
    if isinstance(expression, ex.Leaf) and expression.source.is_plain:
        return loaded[expression]
    height = max(pixels.shape[0] for pixels in loaded.values())
    width = max(pixels.shape[1] * (2 if leaf.source.mirror_ball else 1) for leaf, pixels in loaded.items())
    # Blender interpolates first and computes then; between few texels that makes a difference.
    height, width = max(height, MIN_COMPUTED_HEIGHT), max(width, 2 * MIN_COMPUTED_HEIGHT)

    def on_grid(leaf):
        pixels = loaded[leaf]
        texture = leaf.source
        if texture.is_plain and pixels.shape[:2] == (height, width):
            return pixels
        return latlong.resample(
            pixels, height, width, np.array(texture.matrix), np.array(texture.offset), texture.mirror_ball
        )

    pixels = np.maximum(ex.evaluate(expression, on_grid), 0.0)
    return np.ascontiguousarray(np.broadcast_to(pixels, (height, width, 3)), np.float32)
