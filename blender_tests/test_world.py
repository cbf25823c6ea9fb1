# SPDX-License-Identifier: GPL-3.0-or-later
"""Direction, rotation and strength of the world agree with Cycles, which shows the same map in the same
pixels."""

import math

import bpy
import numpy as np
import pytest
import scenes

ROTATIONS = {
    "none": (0.0, 0.0, 0.0),
    "z": (0.0, 0.0, 1.1),
    "x": (0.7, 0.0, 0.0),
    "xyz": (0.4, -0.9, 2.5),
}
VIEWS = {
    "front": (math.radians(90), 0.0, 0.0),
    "left": (math.radians(80), 0.0, math.radians(100)),
    "up": (math.radians(170), 0.0, 0.3),
    "down": (math.radians(10), 0.0, 0.0),
}


def assert_same_picture(scene, tolerance: float = 0.01):
    """The background agrees in 99 of 100 pixels: at the poles Cycles blends texels across, Skytree does
    not."""
    scenes.at_pixel_centers(scene)
    ours = scenes.render_skytree(scene)[..., :3]
    theirs = np.maximum(scenes.render_cycles(scene)[..., :3], 0.0)  # Skytree knows no negative light
    assert theirs.max() > 0.0
    difference = np.abs(ours - theirs) / np.maximum(theirs, 0.1 * theirs.mean())
    assert np.percentile(difference, 99) <= tolerance, f"means {ours.mean():.5g} and {theirs.mean():.5g}"
    assert abs(ours.mean() - theirs.mean()) <= tolerance * theirs.mean()


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("rotation", ROTATIONS)
def test_smooth_map_is_seen_as_in_cycles(cycles, rotation, view):
    scene = cycles
    scenes.set_map(
        scene, scenes.float_image("smooth", scenes.smooth_map()), ROTATIONS[rotation], strength=1.7
    )
    scene.camera.rotation_euler = VIEWS[view]
    scene.camera.data.angle = math.radians(120)
    assert_same_picture(scene)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, 0, 1), (0.3, -0.8, -0.5)])
def test_one_bright_texel_stands_where_cycles_shows_it(cycles, direction):
    scene = cycles
    d = np.array(direction, float) / np.linalg.norm(direction)
    width, height = 256, 128
    pixels = np.full((height, width, 3), 0.01, np.float32)
    u, v = 0.5 - math.atan2(d[1], d[0]) / (2 * math.pi), math.acos(d[2]) / math.pi
    pixels[min(int(v * height), height - 1), int(u * width) % width] = 50.0
    scenes.set_map(scene, scenes.float_image("texel", pixels), (0.0, 0.2, 0.4))
    from mathutils import Euler, Vector

    # The map is looked up at R d, so the texel of direction d stands in the world at R^-1 d.
    towards = Euler((0.0, 0.2, 0.4)).to_matrix().inverted() @ Vector(d)
    scene.camera.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()
    scene.camera.data.angle = math.radians(20)
    scenes.at_pixel_centers(scene)
    ours, theirs = scenes.render_skytree(scene), scenes.render_cycles(scene)
    assert ours.max() > 15.0
    peaks = [np.array(np.unravel_index(p[..., 0].argmax(), p.shape[:2])) for p in (ours, theirs)]
    assert np.abs(peaks[0] - peaks[1]).max() <= 1


@pytest.mark.parametrize("name", ["city", "forest", "night"])
def test_bundled_map_is_seen_as_in_cycles(cycles, name):
    scenes.set_map(cycles, scenes.bundled(name), (0.0, 0.0, 0.8))
    cycles.camera.data.angle = math.radians(100)
    assert_same_picture(cycles, tolerance=0.06)  # a pixel steps over many texels


def test_strength_scales_the_picture(scene):
    texture, _ = scenes.set_map(scene, scenes.bundled())
    one = scenes.render_skytree(scene, samples=1)
    background = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Strength"].default_value = 3.0
    three = scenes.render_skytree(scene, samples=1)
    np.testing.assert_allclose(three[..., :3], 3.0 * one[..., :3], rtol=1e-4, atol=1e-6)


def test_world_without_nodes_shows_its_colour(scene):
    world = bpy.data.worlds.new("Plain")
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = False
        world.color = (0.1, 0.2, 0.3)
        expected = (0.1, 0.2, 0.3)
    else:
        background = next(n for n in scenes.nodes_of(world).nodes if n.type == "BACKGROUND")
        background.inputs["Color"].default_value = (0.1, 0.2, 0.3, 1.0)
        expected = (0.1, 0.2, 0.3)
    scene.world = world
    picture = scenes.render_skytree(scene, samples=1)
    np.testing.assert_allclose(picture[..., :3].mean(axis=(0, 1)), expected, rtol=1e-4)


def test_no_world_is_black_and_said(scene, skytree):
    scene.world = None
    picture = scenes.render_skytree(scene, samples=1)
    assert not picture[..., :3].any()
    assert "no world" in scenes.messages(skytree)


def test_changed_rotation_and_strength_use_the_same_sampler(scene, skytree):
    environments = scenes.part(skytree, "environments").environments
    _, mapping = scenes.set_map(scene, scenes.bundled())
    scenes.render_skytree(scene, samples=1)
    builds = environments.builds
    mapping.inputs["Rotation"].default_value = (0.0, 0.3, 1.0)
    next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND").inputs[
        "Strength"
    ].default_value = 5.0
    scenes.render_skytree(scene, samples=1)
    assert environments.builds == builds
    scene.skytree.block_count = 300
    scenes.render_skytree(scene, samples=1)
    assert environments.builds == builds + 1
