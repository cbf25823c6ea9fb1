# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside Blender 3.4, 4.5 or 5.2: how long Skytree takes to take over a mesh of a million triangles and
a map.

JOB.json holds `zip`, `hdri`, `rounds`. Each round is a fresh scene, so nothing is kept from the round before;
`synced` tells the seconds of the synchronisation and of the whole F12 with one sample of 32 x 18 pixels.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parents[1] / "demo")]
import blender_part  # noqa: E402
import scene as parts  # noqa: E402

QUADS = 707  # along each side: 999 698 triangles


def add_terrain(scene: bpy.types.Scene) -> int:
    """A wavy grid of about a million triangles; -> how many."""
    row = np.linspace(-5, 5, QUADS + 1, dtype=np.float32)
    x, y = np.meshgrid(row, row)
    z = 0.3 * np.sin(3 * x) * np.cos(2 * y)
    corner = np.arange(QUADS)[:, None] * (QUADS + 1) + np.arange(QUADS)
    around = [corner, corner + 1, corner + QUADS + 2, corner + QUADS + 1]
    count = QUADS * QUADS
    mesh = bpy.data.meshes.new("Terrain")
    mesh.vertices.add(x.size)
    mesh.vertices.foreach_set("co", np.stack([x, y, z], -1).reshape(-1))
    mesh.loops.add(4 * count)
    mesh.loops.foreach_set("vertex_index", np.stack(around, -1).reshape(-1).astype(np.int32))
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", 4 * np.arange(count, dtype=np.int32))
    if bpy.app.version < (4, 1):
        mesh.polygons.foreach_set("loop_total", np.full(count, 4, np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(count, bool))
    mesh.update(calc_edges=True)
    mesh.materials.append(parts.material("Grey", "ShaderNodeBsdfDiffuse", {"Color": (0.5, 0.5, 0.5, 1)}))
    scene.collection.objects.link(bpy.data.objects.new("Terrain", mesh))
    return 2 * count


def one_round(job: dict) -> dict:
    for collection in (bpy.data.objects, bpy.data.meshes, bpy.data.images, bpy.data.worlds, bpy.data.cameras):
        for item in list(collection):
            collection.remove(item)
    scene = bpy.context.scene
    triangles = add_terrain(scene)
    parts.add_camera(scene, position=(0, -7.5, 5.5), target=(0, 0, 0), lens=40)
    parts.add_world(scene, Path(job["hdri"]), 0.0)
    scene.render.engine = "SKYTREE"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 32, 18, 100
    scene.skytree.samples = 1
    started, cpu_started = time.perf_counter(), sum(os.times()[:2])
    bpy.ops.render.render()
    whole, cpu = time.perf_counter() - started, sum(os.times()[:2]) - cpu_started
    stats = bpy.app.driver_namespace["peer_stats"]
    return {
        "triangles": triangles,
        "sync_seconds": float(stats["sync_s"]),
        "whole_seconds": whole,
        "cpu_seconds": cpu,
    }


def main() -> int:
    job_file, descriptor = sys.argv[-2:]
    job = json.loads(Path(job_file).read_text())
    reporter = blender_part.Reporter(int(descriptor))
    try:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        reporter.tell("installed", blender=bpy.app.version_string, core=blender_part.install(job["zip"]))
        for _ in range(job["rounds"]):
            reporter.tell("synced", **one_round(job))
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
