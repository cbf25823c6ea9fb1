# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's view transform (Filmic, AgX, looks, exposure, curves) as a table for the GPU.

Blender applies it to what an engine draws in `view_draw`, but not to what a draw handler draws, and it gives
Python neither its shader nor OpenColorIO. So a grid of colours is saved through the transform once, as F12's
images are, and read back.
"""

from __future__ import annotations

import traceback

import bpy
import gpu
import numpy as np

from . import display

GRID = 65
# log2 of the smallest and largest colour in the table, evenly spaced (see gpu_draw.view_transform).
SHAPER = (-12.0, 10.0)

_baked: dict[tuple, ViewTransform] = {}
_failed: set[tuple] = set()


class ViewTransform:
    """What gpu_draw.draw_image wants: `texture`, `shaper`, `size`."""

    shaper = SHAPER
    size = GRID

    def __init__(self, table: np.ndarray):
        self.table = table  # (GRID, GRID * GRID, 3): green down, blue and red along a row
        self._texture = None

    @property
    def texture(self):
        if self._texture is None:
            # Only while drawing is there sure to be a GPU context.
            rgba = np.ones((*self.table.shape[:2], 4), np.float32)
            rgba[..., :3] = self.table
            data = gpu.types.Buffer("FLOAT", (rgba.size,), rgba.reshape(-1))
            size = (GRID * GRID, GRID)
            self._texture = gpu.types.GPUTexture(size, format="RGBA16F", data=data)
        return self._texture


def grid_colors() -> np.ndarray:
    """(GRID, GRID * GRID, 3) linear colours of the table's entries."""
    stops = np.linspace(*SHAPER, GRID)
    levels = np.exp2(stops) - np.exp2(SHAPER[0])
    blue, green, red = np.meshgrid(levels, levels, levels, indexing="ij")
    colors = np.stack((red, green, blue), axis=-1).transpose(1, 0, 2, 3)
    return np.ascontiguousarray(colors.reshape(GRID, GRID * GRID, 3), np.float32)


def bake(scene) -> ViewTransform:
    """For the main thread, not while drawing: it makes an image for a moment."""
    return ViewTransform(display.displayed(grid_colors(), scene, depth="16"))


def view_transform(scene) -> ViewTransform | None:
    """The scene's transform; None at first, while a timer bakes it. May be called while drawing."""
    key = _key(scene)
    if key not in _baked and key not in _failed:
        _request(scene)
        return next(iter(_baked.values()), None)
    return _baked.get(key)


def clear():
    if bpy.app.timers.is_registered(_bake_requested):
        bpy.app.timers.unregister(_bake_requested)
    _baked.clear()
    _failed.clear()


def _key(scene) -> tuple:
    view = scene.view_settings
    names = ("view_transform", "look", "exposure", "gamma", "use_curve_mapping", "use_white_balance",
             "white_balance_temperature", "white_balance_tint")  # fmt: skip
    curves = ()
    if view.use_curve_mapping and view.curve_mapping:
        curves = tuple(tuple(point.location) for curve in view.curve_mapping.curves for point in curve.points)
    return (
        *(getattr(view, name, None) for name in names),
        curves,
        scene.display_settings.display_device,
        scene.sequencer_colorspace_settings.name,
    )


_requested: str | None = None


def _request(scene):
    global _requested
    _requested = scene.name
    if not bpy.app.timers.is_registered(_bake_requested):
        bpy.app.timers.register(_bake_requested, first_interval=0.0)


def _bake_requested():
    scene = bpy.data.scenes.get(_requested)
    if scene is None:
        return
    key = _key(scene)
    if key in _baked:
        return
    try:
        baked = bake(scene)
    except Exception:
        traceback.print_exc()
        _failed.add(key)  # shown through plain sRGB instead
        return
    _baked.clear()
    _baked[key] = baked
    from . import clock as viewport_clock

    for region, _ in viewport_clock.regions():
        region.tag_redraw()
