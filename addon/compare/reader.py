# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a scene as F12 does: with the objects, modifiers and subdivisions of final renders.

Blender hands such a depsgraph to render engines alone, so an engine that only reads is registered for a
moment.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager

import bpy


class _Reader(bpy.types.RenderEngine):
    bl_idname = "SKYTREE_READER"
    bl_label = "Skytree Reader"

    read: Callable | None = None
    result = None
    error: Exception | None = None

    def render(self, depsgraph):
        if _Reader.read is None:  # a second view layer
            return
        read, _Reader.read = _Reader.read, None
        try:
            _Reader.result = read(depsgraph)
        except Exception as error:  # goes on in read_for_render: Blender would only print it
            _Reader.error = error


def read_for_render(scene, read: Callable):
    """What `read(depsgraph)` returns or raises. It may keep nothing of Blender's. For the main thread."""
    _Reader.read, _Reader.result, _Reader.error = read, None, None
    bpy.utils.register_class(_Reader)
    try:
        wanted = {"engine": _Reader.bl_idname, "use_compositing": False, "use_sequencer": False}
        with _settings(scene.render, wanted):
            bpy.ops.render.render(scene=scene.name)
        if _Reader.error is not None:
            raise _Reader.error
        if _Reader.read is not None:
            raise RuntimeError("Blender did not render: is the view layer enabled for rendering?")
        return _Reader.result
    finally:
        _Reader.read = _Reader.result = _Reader.error = None
        # While it is registered, Blender 4.5 as a Python module cannot end.
        bpy.utils.unregister_class(_Reader)


@contextmanager
def _settings(target, wanted: dict):
    before = {name: getattr(target, name) for name in wanted}
    try:
        for name, value in wanted.items():
            setattr(target, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(target, name, value)
