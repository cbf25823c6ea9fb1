# SPDX-License-Identifier: GPL-3.0-or-later
"""Brings the add-on into the running Blender, as a user does or straight from its sources."""

import importlib
import importlib.util
import os
import sys
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parent.parent
IS_EXTENSION = bpy.app.version >= (4, 2, 0)
ZIP = os.environ.get("SKYTREE_ZIP")  # None: straight from addon/


def install_zip() -> str:
    """Installs and enables the zip; the add-on's module name."""
    if IS_EXTENSION:
        bpy.ops.extensions.package_install_files(filepath=ZIP, repo="user_default", enable_on_install=True)
        return "bl_ext.user_default.skytree"
    bpy.ops.preferences.addon_install(filepath=ZIP, overwrite=True)
    bpy.ops.preferences.addon_enable(module="skytree")
    return "skytree"


def register_sources() -> str:
    spec = importlib.util.spec_from_file_location(
        "skytree", ROOT / "addon" / "__init__.py", submodule_search_locations=[str(ROOT / "addon")]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["skytree"] = module
    spec.loader.exec_module(module)
    module.register()
    return "skytree"


def install():
    """The add-on's package, enabled."""
    return importlib.import_module(install_zip() if ZIP else register_sources())
