# SPDX-License-Identifier: GPL-3.0-or-later
"""Linear images as Blender shows them: through the scene's own view transform, as F12's "Save As" does."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable

import bpy
import numpy as np

# Some 10 ms of work: Blender stands still for it.
BAND_PIXELS = 1 << 16


def bands(height: int, width: int) -> list[slice]:
    """The rows of an image in parts of about BAND_PIXELS pixels, each of which may be shown on its own: the
    view transform looks at one pixel at a time."""
    rows = max(BAND_PIXELS // width, 1)
    return [slice(y, min(y + rows, height)) for y in range(0, height, rows)]


def view_of(scene) -> tuple[Callable[[np.ndarray], np.ndarray], str]:
    """(function from linear (H,W,3) to uint8 display values, name of the view for captions)."""
    view = scene.view_settings
    name = f"{view.view_transform}, exposure {view.exposure:g}, gamma {view.gamma:g}"
    if view.look != "None":
        name += f", {view.look}"

    def to_bytes(image: np.ndarray) -> np.ndarray:
        return (displayed(image, scene, depth="8") * 255.0 + 0.5).astype(np.uint8)

    return to_bytes, name


def displayed(image: np.ndarray, scene, depth: str = "8") -> np.ndarray:
    """A linear image (H,W,3) in the scene's display space, 0..1, as float32 in steps of `depth` ("8" or
    "16") bits; the rows keep their order. For the main thread, and not while drawing: it makes images for a
    moment."""
    height, width = image.shape[:2]
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = image
    source = bpy.data.images.new("skytree display", width, height, alpha=True, float_buffer=True)
    shown = None
    try:
        source.pixels.foreach_set(rgba.ravel())
        with tempfile.TemporaryDirectory() as folder, _PngSettings(scene.render.image_settings, depth):
            path = os.path.join(folder, "display.png")
            source.save_render(path, scene=scene)
            shown = bpy.data.images.load(path)
            # Blender would linearise the pixels of a 16-bit file, which it holds as floats.
            shown.colorspace_settings.name = "Non-Color"
            pixels = np.empty(len(shown.pixels), np.float32)
            shown.pixels.foreach_get(pixels)
            return np.ascontiguousarray(pixels.reshape(height, width, shown.channels)[..., :3])
    finally:
        bpy.data.images.remove(source)
        if shown is not None:
            bpy.data.images.remove(shown)


class _PngSettings:
    """The scene's image settings set to PNG for a while: save_render takes its format from them."""

    def __init__(self, settings, depth: str):
        self._settings = settings
        # media_type (5.0 and later) comes first: it decides which formats there are.
        wanted = {
            "media_type": "IMAGE",
            "file_format": "PNG",
            "color_mode": "RGB",
            "color_depth": depth,
            "compression": 0,
        }
        self._wanted = {name: value for name, value in wanted.items() if hasattr(settings, name)}

    def __enter__(self):
        self._before = {name: getattr(self._settings, name) for name in self._wanted}
        for name, value in self._wanted.items():
            setattr(self._settings, name, value)

    def __exit__(self, *error):
        for name, value in self._before.items():
            setattr(self._settings, name, value)
