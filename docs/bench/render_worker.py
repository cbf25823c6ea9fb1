# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside Blender: renders the spheres with Skytree and Cycles in the order that the job gives, with
equal settings: direct light only, box filter of one pixel, no denoiser, no clamping, no adaptive
sampling.

JOB.json holds `zip`, `hdri`, `width`, `height` and `renders`, a list of `engine`, `samples`,
`seed`, `settings` (of scene.skytree) and `exr` (or null). After each one `rendered` is told with the
processor time of this process, user and system, and the wall time.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from pathlib import Path

import bpy

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parents[1] / "demo")]
import blender_part  # noqa: E402
import spheres  # noqa: E402


def configure(scene: bpy.types.Scene, job: dict) -> None:
    """What both engines share."""
    render, cycles = scene.render, scene.cycles
    render.resolution_x, render.resolution_y, render.resolution_percentage = job["width"], job["height"], 100
    # All cores: with one thread fixed, Cycles spends about twice its wall time, which would be unfair.
    render.threads_mode = "AUTO"
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    cycles.max_bounces = 0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.use_denoising = cycles.use_adaptive_sampling = cycles.use_light_tree = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.time_limit = 0


def render(scene: bpy.types.Scene, entry: dict, reporter: blender_part.Reporter) -> None:
    scene.render.engine = entry["engine"]
    if entry["engine"] == "CYCLES":
        scene.cycles.samples, scene.cycles.seed = entry["samples"], entry["seed"]
    else:
        blender_part.apply_settings(
            scene.skytree,
            {
                "samples": entry["samples"],
                "seed": entry["seed"],
                "max_bounces": 0,
                "pixel_filter": "BOX",
                "filter_width": 1.0,
                **entry["settings"],
            },
        )
    if entry["exr"]:
        scene.render.filepath = entry["exr"]
    started, cpu_started = time.perf_counter(), sum(os.times()[:2])
    bpy.ops.render.render(write_still=bool(entry["exr"]))
    cpu, wall = sum(os.times()[:2]) - cpu_started, time.perf_counter() - started
    reporter.tell("rendered", cpu_seconds=cpu, wall_seconds=wall)


def main() -> int:
    job_file, descriptor = sys.argv[-2:]
    job = json.loads(Path(job_file).read_text())
    reporter = blender_part.Reporter(int(descriptor))
    try:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        core = blender_part.install(job["zip"])
        reporter.tell("installed", blender=bpy.app.version_string, core=core)
        scene = bpy.context.scene
        spheres.build(scene, Path(job["hdri"]))
        configure(scene, job)
        for entry in job["renders"]:
            render(scene, entry, reporter)
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
