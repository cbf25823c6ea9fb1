# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside Blender and renders what it is told: Skytree and Cycles with equal settings.

Orders come as one JSON object a line on a file descriptor, answers go to another (worker.py).
`{"order": "scene", "scene", "map", "bounces", "folder", "export"}` builds a scene and, with a file name in
`export`, writes what Mitsuba needs of it; `{"order": "render", "engine", "preset", "settings", "samples",
"seed", "exr"}` renders as F12 does and tells the processor time of this process.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent), str(HERE.parents[1] / "demo")]
import blender_part  # noqa: E402
import export  # noqa: E402
import scenes  # noqa: E402

BOUNCES = ("max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces")


def build_scene(order: dict) -> None:
    scene = bpy.context.scene
    scenes.build(scene, order["scene"], Path(order["map"]), Path(order["folder"]))
    render, cycles = scene.render, scene.cycles
    render.resolution_x, render.resolution_y = order["size"]
    render.resolution_percentage = 100
    # All cores: with one thread fixed, Cycles spends about twice its wall time, which would be unfair.
    render.threads_mode = "AUTO"
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    for limit in BOUNCES:
        setattr(cycles, limit, order["bounces"])
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    # Nothing that trades truth for less noise, as Skytree and Mitsuba trade nothing here.
    cycles.use_denoising = cycles.use_adaptive_sampling = cycles.use_light_tree = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.blur_glossy = cycles.light_sampling_threshold = 0
    cycles.time_limit = 0
    if order["export"]:
        export.write(scene, Path(order["export"]))


def render(order: dict) -> dict:
    scene = bpy.context.scene
    scene.render.engine = order["engine"]
    if order["engine"] == "CYCLES":
        scene.cycles.samples, scene.cycles.seed = order["samples"], order["seed"]
    else:
        blender_part.apply_settings(scene.skytree, {})
        bpy.ops.skytree.apply_preset(preset=order["preset"])
        given = {
            "samples": order["samples"],
            "seed": order["seed"],
            "max_bounces": order["bounces"],
            "pixel_filter": "BOX",
            "filter_width": 1.0,
            **order.get("settings", {}),
        }
        for name, value in given.items():
            setattr(scene.skytree, name, value)
    scene.render.filepath = order["exr"]
    started = time.process_time()
    bpy.ops.render.render(write_still=True)
    return {"cpu_seconds": time.process_time() - started}


def main() -> int:
    job_file, descriptor = sys.argv[-2:]
    job = json.loads(Path(job_file).read_text())
    reporter = blender_part.Reporter(int(descriptor))
    try:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        core = blender_part.install(job["zip"])
        reporter.tell("ready", version=bpy.app.version_string, core=core)
        for line in os.fdopen(job["orders"]):
            order = json.loads(line)
            if order["order"] == "scene":
                build_scene(order)
                reporter.tell("done")
            else:
                reporter.tell("done", **render(order))
    except Exception as error:
        traceback.print_exc()
        reporter.tell("failed", message=f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # see blender_part.py
