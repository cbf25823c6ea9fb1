# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside Blender as a module: installs the zip for this run alone, opens a file and writes its report.

python compare_in_blender.py ZIP FILE.blend [options of the add-on's compare.cli]
"""

import importlib
import os
import sys
import tempfile
from pathlib import Path

# Before bpy is imported: the user's own settings and extensions stay untouched.
os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix="skytree-compare-")

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs" / "demo"))
from blender_part import install

MODULE = "bl_ext.user_default.skytree"


def main() -> int:
    archive, file, *options = sys.argv[1:]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    install(archive)
    bpy.ops.wm.open_mainfile(filepath=file, load_ui=False)
    return importlib.import_module(f"{MODULE}.compare.cli").main(options)


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender 4.5 as a module hangs in exit() while a render engine written in Python is registered.
    os._exit(code)
