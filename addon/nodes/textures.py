# SPDX-License-Identifier: GPL-3.0-or-later
"""Image textures on surfaces: which image, in which coordinates, and the one texture that a closure gets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..images import ImageSource, ImageStore, evaluate_texture
from ..messages import Messages
from . import expression as ex
from .reader import NodeReader, Place
from .vectors import affine

IDENTITY_ROWS = tuple(map(tuple, np.eye(3)))
INTERPOLATION = {"Linear": "LINEAR", "Closest": "CLOSEST", "Cubic": "LINEAR", "Smart": "LINEAR"}
EXTENSION = {"REPEAT": "REPEAT", "EXTEND": "EXTEND", "CLIP": "CLIP", "MIRROR": "MIRROR"}
MISSING_IMAGE = (1.0, 0.0, 1.0)


@dataclass(frozen=True)
class SurfaceTexture:
    """One output of an Image Texture node: the source of an expression's leaf."""

    image: ImageSource
    alpha: bool
    matrix: tuple
    offset: tuple
    interpolation: str
    extension: str

    def texels(self) -> np.ndarray:
        """(height, width, 3), or (height, width, 1) for alpha."""
        if not self.alpha:
            return self.image.rgb()
        pixels = self.image.pixels()
        if pixels.shape[2] == 4:
            return np.ascontiguousarray(pixels[..., 3:])
        return np.ones((*pixels.shape[:2], 1), np.float32)


@dataclass(frozen=True)
class TextureSpec:
    """What Scene.add_texture is to be given; equal specs are one texture."""

    expression: ex.Expression
    interpolation: str
    extension: str
    uv_transform: tuple  # 2x3: u' = row0 . (u, v, 1)

    def image(self) -> np.ndarray:
        """(height, width, 3) float32; raises ValueError if an image cannot be read."""
        texels = evaluate_texture(self.expression)
        return np.ascontiguousarray(np.broadcast_to(texels, (*texels.shape[:2], 3)), np.float32)


class TextureReader:
    """Makes leaves and specs for one material, and remembers the UV layer that its textures want."""

    def __init__(self, owner: str, store: ImageStore, messages: Messages):
        self.owner, self.store, self.messages = owner, store, messages
        self.uv_map: str | None = None

    def want_uv(self, name: str):
        if self.uv_map is None:
            self.uv_map = name
        elif name != self.uv_map:
            self.messages.warn(
                f"{self.owner}: its textures use several UV maps; all are shown with "
                f'"{self.uv_map or "the active one"}"'
            )

    def image_leaf(self, output: Place) -> ex.Expression | None:
        node = output.node
        if node.type != "TEX_IMAGE":
            return None
        is_alpha = output.socket.identifier == "Alpha"
        missing = ex.ONE if is_alpha else ex.constant(MISSING_IMAGE)
        if node.image is None:
            self.messages.warn(
                f'{self.owner}: the Image Texture "{node.name}" has no image; it shows magenta'
            )
            return missing
        source = self.store.source(node.image, node.image_user, self.owner, self.messages)
        if source is None:
            return missing
        if node.projection != "FLAT":
            self.messages.warn(
                f'{self.owner}: the projection {node.projection.title()} of "{node.name}" '
                "is shown as Flat, with UVs"
            )
        reader = NodeReader(self.owner, self.messages, self.image_leaf, camera_ray=1.0)
        matrix, offset = affine(output.input("Vector"), reader, self._uv_source, self._active_uv())
        if np.any(np.abs(matrix[:2, 2]) > 1e-9):
            self.messages.warn(
                f"{self.owner}: a rotation of texture coordinates out of the UV plane is left out"
            )
        return ex.Leaf(
            SurfaceTexture(
                source,
                is_alpha,
                tuple(map(tuple, matrix.tolist())),
                tuple(offset.tolist()),
                INTERPOLATION.get(node.interpolation, "LINEAR"),
                EXTENSION.get(node.extension, "REPEAT"),
            ),
            channels=1 if is_alpha else 3,
        )

    def _active_uv(self):
        # Unlinked, an Image Texture takes the render UV map.
        return np.eye(3), np.zeros(3)

    def _uv_source(self, output: Place, reader: NodeReader):
        node = output.node
        if node.type == "UVMAP":
            self.want_uv(node.uv_map)
            return self._active_uv()
        if node.type == "TEX_COORD" and output.socket.identifier == "UV":
            self.want_uv("")
            return self._active_uv()
        if node.type == "ATTRIBUTE" and output.socket.identifier == "Vector":
            self.want_uv(node.attribute_name)
            return self._active_uv()
        return None

    def spec(self, expression: ex.Expression) -> TextureSpec:
        """One texture for an expression; look-ups that differ in coordinates all take the first one's."""
        sources = [leaf.source for leaf in ex.leaves(expression)]
        first = sources[0]
        layout = [(s.matrix, s.offset, s.interpolation, s.extension) for s in sources]
        if any(other != layout[0] for other in layout):
            self.messages.warn(
                f"{self.owner}: textures with different coordinates are combined; all are shown "
                f'with those of "{first.image.name}"'
            )
        if self.uv_map is None:
            self.uv_map = ""
        matrix, offset = np.array(first.matrix), np.array(first.offset)
        rows = np.column_stack((matrix[:2, :2], offset[:2]))
        return TextureSpec(expression, first.interpolation, first.extension, tuple(map(tuple, rows.tolist())))
