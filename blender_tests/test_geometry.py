# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry of every kind arrives: modifiers, normals, curves and text, instances, visibility."""

import math

import bpy
import numpy as np
import pytest
import scenes


def white_world(scene, size: int = 48):
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.film_transparent = True
    scenes.set_map(scene, scenes.float_image("smooth", scenes.smooth_map()))
    scene.skytree.max_bounces = 0


def assert_as_in_cycles(scene, tolerance: float = 0.05):
    """Alpha is the same silhouette, and the shading follows the same normals."""
    ours, theirs = scenes.render_skytree(scene, 64), scenes.render_cycles(scene, 64)
    assert theirs[..., 3].mean() > 0.02
    assert np.mean(np.abs(ours - theirs)[..., 3] > 0.2) <= 0.01
    covered = (theirs[..., 3] > 0.99) & (ours[..., 3] > 0.99)
    difference = np.abs(ours - theirs)[..., :3][covered]
    assert difference.mean() <= tolerance * theirs[..., :3][covered].mean()


def cube(scene, **options):
    mesh = bpy.data.meshes.new("Cube")
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh.from_pydata(corners, [], faces)
    ob = bpy.data.objects.new("Cube", mesh)
    ob.location, ob.rotation_euler = (0, 0, 0.4), (0.3, 0.2, 0.5)
    for key, value in options.items():
        setattr(ob, key, value)
    scene.collection.objects.link(ob)
    return ob


def test_flat(cycles):
    white_world(cycles)
    cube(cycles)
    assert_as_in_cycles(cycles)


def test_smooth(cycles):
    white_world(cycles)
    scenes.sphere(cycles, (0, 0, 0.4), 1.5, subdivisions=2)
    assert_as_in_cycles(cycles, 0.06)


def test_modifiers(cycles):
    white_world(cycles)
    ob = cube(cycles)
    ob.modifiers.new("Subdivision", "SUBSURF").render_levels = 3
    ob.modifiers.new("Array", "ARRAY").count = 2
    assert_as_in_cycles(cycles)


def test_custom_normals(cycles):
    white_world(cycles)
    ob = cube(cycles)
    mesh = ob.data
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    if hasattr(mesh, "use_auto_smooth"):
        mesh.use_auto_smooth = True
    tilted = [(0.1, 0.07, 0.3)] * len(mesh.loops)
    normals = [tuple(np.add(p.normal, t)) for p in mesh.polygons for t in tilted[: p.loop_total]]
    mesh.normals_split_custom_set([tuple(np.array(n) / np.linalg.norm(n)) for n in normals])
    assert_as_in_cycles(cycles, 0.06)


def curve(kind: str):
    if kind == "FONT":
        data = bpy.data.curves.new("Text", "FONT")
        data.body, data.extrude, data.align_x = "ABC", 0.1, "CENTER"
        ob = bpy.data.objects.new("Text", data)
        ob.rotation_euler = (math.pi / 2, 0, 0)
        ob.scale = (2, 2, 2)
    elif kind == "CURVE":
        data = bpy.data.curves.new("Wire", "CURVE")
        data.dimensions, data.bevel_depth = "3D", 0.4
        spline = data.splines.new("POLY")
        spline.points.add(2)
        for point, co in zip(spline.points, [(-2, 0, 0), (0, 0, 2), (2, 0, 0)], strict=True):
            point.co = (*co, 1)
        ob = bpy.data.objects.new("Wire", data)
    else:
        data = bpy.data.metaballs.new("Blob")
        data.elements.new().co = (0, 0, 0)
        data.elements.new().co = (1, 0, 0.5)
        data.resolution = data.render_resolution = 0.2
        ob = bpy.data.objects.new("Blob", data)
    return ob


@pytest.mark.parametrize("kind", ["FONT", "CURVE", "META"])
def test_converted(cycles, kind):
    white_world(cycles)
    cycles.collection.objects.link(curve(kind))
    assert_as_in_cycles(cycles, 0.06)


def instancing_collection(scene):
    collection = bpy.data.collections.new("Props")
    ob = cube(scene, scale=(0.3, 0.3, 0.3))
    scene.collection.objects.unlink(ob)
    collection.objects.link(ob)
    for x in (-1.2, 0.0, 1.2):
        empty = bpy.data.objects.new("Empty", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location = (x, 0, x * 0.3)
        scene.collection.objects.link(empty)


def instancing_vertices(scene):
    parent = scenes.plane(scene, 2.0, (0, 0, 0.5))
    child = cube(scene, scale=(0.2, 0.2, 0.2), location=(0, 0, 0))
    child.parent = parent
    parent.instance_type = "VERTS"
    parent.show_instancer_for_render = False


def instancing_geometry_nodes(scene):
    """A generated mesh on generated points: no object of its own."""
    ob = scenes.plane(scene, 2.0, (0, 0, 0.5))
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    if hasattr(tree, "interface"):
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    else:
        tree.outputs.new("NodeSocketGeometry", "Geometry")
    grid = tree.nodes.new("GeometryNodeMeshGrid")
    grid.inputs["Vertices X"].default_value = grid.inputs["Vertices Y"].default_value = 3
    grid.inputs["Size X"].default_value = grid.inputs["Size Y"].default_value = 3.0
    box = tree.nodes.new("GeometryNodeMeshCube")
    box.inputs["Size"].default_value = (0.4, 0.4, 0.4)
    on_points = tree.nodes.new("GeometryNodeInstanceOnPoints")
    output = tree.nodes.new("NodeGroupOutput")
    tree.links.new(grid.outputs["Mesh"], on_points.inputs["Points"])
    tree.links.new(box.outputs["Mesh"], on_points.inputs["Instance"])
    tree.links.new(on_points.outputs["Instances"], output.inputs[0])
    ob.modifiers.new("Scatter", "NODES").node_group = tree


@pytest.mark.parametrize(
    "build, count",
    [(instancing_collection, 3), (instancing_vertices, 4), (instancing_geometry_nodes, 9)],
)
def test_instances(cycles, skytree, build, count):
    white_world(cycles)
    build(cycles)
    assert_as_in_cycles(cycles)
    uploads = scenes.part(skytree, "status").last.uploads
    assert uploads["instances"] == count and uploads["meshes"] == 1


def test_particles(cycles, skytree):
    white_world(cycles)
    emitter = scenes.plane(cycles, 3.0, (0, 0, 0.3))
    stamp = cube(cycles, scale=(0.15, 0.15, 0.15), location=(50, 0, 0))
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end = 20, 1, 1
    settings.physics_type, settings.render_type, settings.instance_object = "NO", "OBJECT", stamp
    settings.particle_size, settings.emit_from = 1.0, "FACE"
    cycles.frame_set(5)
    scenes.render_skytree(cycles, 4)
    assert scenes.part(skytree, "status").last.uploads["instances"] >= 20


def test_hidden_objects_are_not_rendered(scene):
    white_world(scene)
    cube(scene, hide_render=True)
    assert scenes.render_skytree(scene, 4)[..., 3].max() == 0.0


def test_mirrored_and_sheared_transforms(cycles):
    white_world(cycles)
    parent = bpy.data.objects.new("Parent", None)
    parent.scale = (1.0, 0.5, 1.4)
    cycles.collection.objects.link(parent)
    ob = scenes.sphere(cycles, (0, 0, 0.4), 1.0)
    ob.rotation_euler, ob.scale, ob.parent = (0.5, 0.3, 0.1), (-1, 1, 1), parent
    assert_as_in_cycles(cycles)
