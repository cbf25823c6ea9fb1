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
import sys  # noqa: E402

import bpy  # noqa: E402

# Reloading the add-on has to reload its modules too.
if "engine" in locals():
    import importlib

    for _name in [name for name in sys.modules if name.startswith(__package__ + ".")]:
        importlib.reload(sys.modules[_name])

from . import (  # noqa: E402
    compare_cli,
    compare_ops,
    compare_panel,
    compare_props,
    compare_region,
    engine,
    floating,
    map_pictures,
    overlay,
    overlay_panel,
    panels,
    presets,
    problems,
    properties,
)

_MODULES = (
    properties,
    presets,
    engine,
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


def register():
    done = []
    try:
        for module in _MODULES:
            module.register()
            done.append(module)
    except Exception:
        for module in reversed(done):
            module.unregister()
        raise
    # As a Python module Blender 4.5 waits forever in exit() while an engine written in Python is
    # registered, and crashes there over draw handlers. A Blender program must not be touched that late.
    if not bpy.app.binary_path:
        atexit.register(_unregister_at_exit)


def _unregister_at_exit():
    try:
        unregister()
    except Exception as error:
        print(f"Skytree: {error}", file=sys.stderr)
    # Once used, the drivers' namespace holds bpy, and only when bpy is released does it shut down.
    bpy.app.driver_namespace.clear()


def unregister():
    atexit.unregister(_unregister_at_exit)
    for module in reversed(_MODULES):
        module.unregister()
