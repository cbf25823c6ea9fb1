# SPDX-License-Identifier: GPL-3.0-or-later
"""Skytree: a render engine whose light comes from HDRIs, sampled through a kd-tree.

Blender 4.2 and later read blender_manifest.toml; bl_info is for earlier versions.
"""

bl_info = {
    "name": "Skytree",
    "author": "The Skytree developers",
    "version": (0, 0, 0),
    "blender": (3, 4, 0),
    "location": "Render Properties > Render Engine > Skytree",
    "description": "Path tracer lit by HDRIs through kd-tree importance sampling",
    "category": "Render",
}

import atexit  # noqa: E402
import ctypes  # noqa: E402
import functools  # noqa: E402
import sys  # noqa: E402

import bpy  # noqa: E402

# Reloading the add-on has to reload its modules too.
if "engine" in locals():
    import importlib

    for _name in [name for name in sys.modules if name.startswith(__package__ + ".")]:
        importlib.reload(sys.modules[_name])

from . import compress_op, engine, panels, presets, properties  # noqa: E402
from .compare import cli as compare_cli  # noqa: E402
from .compare import ops as compare_ops  # noqa: E402
from .compare import panel as compare_panel  # noqa: E402
from .compare import props as compare_props  # noqa: E402
from .compare import region as compare_region  # noqa: E402
from .environments import environments  # noqa: E402
from .pictures import map_pictures, overlay  # noqa: E402
from .pictures import panel as overlay_panel  # noqa: E402
from .problems import panel as problems  # noqa: E402
from .viewport import floating  # noqa: E402

_MODULES = (
    properties,
    presets,
    engine,
    compress_op,
    panels,
    problems,
    floating,
    compare_props,
    compare_ops,
    compare_cli,
    compare_region,
    compare_panel,
    map_pictures,
    overlay,
    overlay_panel,
)


_registered = []  # also what Blender's shutdown finds after ours: nothing, then


def register():
    try:
        for module in _MODULES:
            module.register()
            _registered.append(module)
    except Exception:
        unregister()
        raise
    # A Blender program must not be touched as late as at exit; Blender as a Python module has to be.
    if not bpy.app.binary_path:
        atexit.register(_unregister_at_exit)
        if bpy.app.version < (5, 0):
            _end_before_blender_waits()


def _unregister_at_exit():
    try:
        unregister()
    except Exception as error:
        print(f"Skytree: {error}", file=sys.stderr)
    # Once used, the drivers' namespace holds bpy, and only when bpy is released does it shut down.
    bpy.app.driver_namespace.clear()
    ctypes.CDLL(None).fflush(None)  # what Blender itself printed


@functools.cache
def _end_before_blender_waits():
    """As a Python module Blender 4.x destroys a condition variable in exit() that a thread of its own still
    waits on, and hangs, unless everything of bpy was released before; one reference in a script or an add-on
    is enough. Python has ended and flushed by then, so the process leaves with its status right before."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "on_exit"):
        libc.on_exit(ctypes.cast(libc._exit, ctypes.c_void_p), None)


def unregister():
    atexit.unregister(_unregister_at_exit)
    while _registered:
        _registered.pop().unregister()
    environments.clear()
