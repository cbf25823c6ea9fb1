# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of the demo that runs inside Blender: installs the add-on's zip, builds the scene and renders.

    BLENDER_USER_RESOURCES=DIR python blender_part.py JOB.json FD

JOB.json holds `zip`, `hdri`, `rotation` (radians), `width`, `height`, `max_bounces` and `renders`, a list of
`name`, `samples`, `seed`, `settings` (properties of scene.skytree; what is left out keeps its default) and
`exr` (file to write). What happens is told as one JSON object a line on the file descriptor FD: `installed`,
`progress`, `rendered`, `failed`. Blender's own output stays on stdout.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import sys
import time
import traceback
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
import scene as demo_scene


class Reporter:
    """Tells the process that started us what happens."""

    def __init__(self, descriptor: int) -> None:
        self.pipe = os.fdopen(descriptor, "w", buffering=1)

    def tell(self, event: str, **details) -> None:
        self.pipe.write(json.dumps({"event": event, **details}) + "\n")


def install(zip_file: str) -> str:
    """Installs and enables the add-on as a user does; -> version of the core."""
    if bpy.app.version >= (4, 2):
        module = "bl_ext.user_default.skytree"
        repositories = bpy.context.preferences.extensions.repos
        if "user_default" not in {repository.module for repository in repositories}:
            bpy.ops.preferences.extension_repo_add(name="User Default", type="LOCAL")
        bpy.ops.extensions.package_install_files(
            filepath=zip_file, repo="user_default", enable_on_install=True
        )
    else:
        module = "skytree"
        bpy.ops.preferences.addon_install(filepath=zip_file, overwrite=True)
        bpy.ops.preferences.addon_enable(module=module)
    if module not in bpy.context.preferences.addons:
        raise RuntimeError(f"Blender did not enable {module} after installing {zip_file}; its log says why")
    return importlib.import_module(f"{module}.native").core().__version__


def property_names(settings: bpy.types.PropertyGroup) -> list[str]:
    """What can be set: numbers, switches, choices and texts."""
    kinds = {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"}
    return [p.identifier for p in settings.bl_rna.properties if p.type in kinds and p.identifier != "name"]


def apply_settings(settings: bpy.types.PropertyGroup, values: dict) -> None:
    """Sets these properties of scene.skytree and puts all others back to their defaults."""
    for name in property_names(settings):
        settings.property_unset(name)
    for name, value in values.items():
        setattr(settings, name, value)


def render(scene: bpy.types.Scene, entry: dict, reporter: Reporter) -> None:
    """Renders one image, as F12 would, and tells its times."""
    given = {name: entry[name] for name in ("samples", "seed", "max_bounces")}
    apply_settings(scene.skytree, given | entry["settings"])
    scene.render.filepath = entry["exr"]

    def on_stats(text, *_unused) -> None:
        found = re.search(r"(\d+)\s*(?:/|of)\s*(\d+)", str(text).rpartition("|")[2])
        if found:
            reporter.tell("progress", name=entry["name"], done=int(found[1]), total=int(found[2]))

    bpy.app.handlers.render_stats.append(on_stats)
    started, cpu_started = time.perf_counter(), sum(os.times()[:2])
    try:
        bpy.ops.render.render(write_still=True)
    finally:
        bpy.app.handlers.render_stats.remove(on_stats)
    if not Path(entry["exr"]).is_file():
        raise RuntimeError(f"the render '{entry['name']}' wrote no image")
    reporter.tell(
        "rendered",
        name=entry["name"],
        wall_seconds=time.perf_counter() - started,
        cpu_seconds=sum(os.times()[:2]) - cpu_started,
        settings={name: getattr(scene.skytree, name) for name in property_names(scene.skytree)},
        **{key: float(value) for key, value in bpy.app.driver_namespace.get("peer_stats", {}).items()},
    )


def main() -> int:
    job_file, descriptor = sys.argv[1:]
    job = json.loads(Path(job_file).read_text())
    reporter = Reporter(int(descriptor))
    try:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        version = install(job["zip"])
        reporter.tell("installed", blender=bpy.app.version_string, core=version)
        scene = bpy.context.scene
        demo_scene.build(scene, Path(job["hdri"]), job["rotation"])
        scene.render.engine = "SKYTREE"
        scene.render.resolution_x, scene.render.resolution_y = job["width"], job["height"]
        scene.render.resolution_percentage = 100
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_depth = "32"
        scene.render.image_settings.exr_codec = "ZIP"
        for entry in job["renders"]:
            render(scene, {"max_bounces": job["max_bounces"], **entry}, reporter)
    except Exception as error:
        traceback.print_exc()
        reporter.tell("failed", message=f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender 4.5 as a module hangs in exit() while a render engine written in Python is registered.
    os._exit(code)
