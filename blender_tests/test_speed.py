# SPDX-License-Identifier: GPL-3.0-or-later
"""How long a large scene takes to reach the core. The times are printed, not asserted: machines differ."""

import time

import bpy
import numpy as np
import scenes


def million_triangles(scene):
    side = 708
    ticks = np.linspace(-5.0, 5.0, side, dtype=np.float32)
    x, y = np.meshgrid(ticks, ticks)
    vertices = np.stack([x, y, 0.2 * np.sin(3 * x) * np.cos(2 * y)], axis=-1).reshape(-1, 3)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.stack([corner, corner + 1, corner + side + 1, corner + side], axis=1)
    mesh = bpy.data.meshes.new("Terrain")
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 4))
    if bpy.app.version < (4, 1, 0):
        mesh.polygons.foreach_set("loop_total", np.full(len(faces), 4))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", vertices[faces.ravel(), :2].ravel())
    mesh.update(calc_edges=True)
    scene.collection.objects.link(bpy.data.objects.new("Terrain", mesh))
    return mesh


def test_large_scene(scene, skytree, capsys):
    """A million triangles with UVs and smooth normals and a map of 4096 x 2048, from Blender to the core."""
    million_triangles(scene)
    pixels = np.repeat(np.repeat(scenes.smooth_map(512, 256), 8, axis=0), 8, axis=1)
    image = scenes.float_image("large", pixels)
    scenes.set_map(scene, image)
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    sync = scenes.part(skytree, "sync.scene").SceneSync()
    lines = []

    def measure(name, step):
        wall, cpu = time.perf_counter(), time.process_time()
        step()
        lines.append((name, time.perf_counter() - wall, time.process_time() - cpu))

    measure("decode the file", lambda: len(image.pixels))
    measure("1M triangles", lambda: sync.objects.sync(depsgraph, None))
    measure("map and kd-tree", lambda: sync.sync_environment(depsgraph))
    lines.append(("together", *(sum(line[i] for line in lines) for i in (1, 2))))
    with capsys.disabled():
        text = "; ".join(f"{name} {wall:.2f} s (CPU {cpu:.2f} s)" for name, wall, cpu in lines)
        print(f"\nBlender {bpy.app.version_string}: {text}")
    assert sync.scene.stats["triangles"] == 2 * 707 * 707
    assert sync.built.map_size == (4096, 2048)
