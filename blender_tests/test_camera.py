# SPDX-License-Identifier: GPL-3.0-or-later
"""Every camera that Skytree has puts every pixel where Cycles puts it."""

import math

import bpy
import numpy as np
import pytest
import scenes


def landmarks(scene):
    """Three emitting squares of different colours, on a dark world, and a picture of which is seen where."""
    _, background = scenes.world_tree(scene)
    background.inputs["Color"].default_value = (0.05, 0.05, 0.05, 1)
    for color, location in (((1, 0, 0), (-1, 0, 1)), ((0, 1, 0), (1.5, 1, 2)), ((0, 0, 1), (0, 3, 0))):
        emission = scenes.material("ShaderNodeEmission", Color=color)
        scenes.plane(scene, 1.5, location, emission, rotation=(math.pi / 2, 0, 0.2))
    scenes.at_pixel_centers(scene)


def assert_same_picture(scene):
    ours, theirs = scenes.render_skytree(scene), scenes.render_cycles(scene)
    assert ours.shape == theirs.shape
    assert len(np.unique(theirs.reshape(-1, theirs.shape[2]).round(2), axis=0)) >= 3
    # Only where an edge runs through a pixel's centre may rounding decide.
    assert np.mean(np.abs(ours - theirs).max(axis=2) > 0.01) <= 0.01


CAMERAS = {
    "perspective": {},
    "long_lens": {"lens": 85.0},
    "shift": {"shift_x": 0.2, "shift_y": -0.15},
    "sensor_vertical": {"sensor_fit": "VERTICAL", "sensor_height": 30.0},
    "sensor_horizontal": {"sensor_fit": "HORIZONTAL", "sensor_width": 50.0},
    "orthographic": {"type": "ORTHO", "ortho_scale": 7.0},
    "orthographic_shift": {"type": "ORTHO", "ortho_scale": 7.0, "shift_x": 0.3},
    "clipped_near": {"clip_start": 6.5},
    "clipped_far": {"clip_end": 8.0},
}


@pytest.mark.parametrize("name", CAMERAS)
def test_camera(cycles, name):
    landmarks(cycles)
    for key, value in CAMERAS[name].items():
        setattr(cycles.camera.data, key, value)
    assert_same_picture(cycles)


@pytest.mark.parametrize("size, aspect", [((40, 64), (1, 1)), ((64, 48), (2, 1)), ((64, 48), (1, 1.5))])
def test_frame_and_pixel_aspect(cycles, size, aspect):
    landmarks(cycles)
    cycles.render.resolution_x, cycles.render.resolution_y = size
    cycles.render.pixel_aspect_x, cycles.render.pixel_aspect_y = aspect
    assert_same_picture(cycles)


@pytest.mark.parametrize("crop", [False, True])
def test_border(cycles, crop):
    landmarks(cycles)
    render = cycles.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x = 0.253, 0.807
    render.border_min_y, render.border_max_y = 0.211, 0.967
    assert_same_picture(cycles)


def test_border_does_not_change_pixels(scene):
    scenes.demo_objects(scene)
    # What is learnt, and where noise is found, depends on what is rendered.
    scene.skytree.learn_visibility = scene.skytree.adaptive_sampling = False
    scenes.set_map(scene, scenes.bundled("city"))
    whole = scenes.render_skytree(scene, 8)
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.25, 0.5
    part = scenes.render_skytree(scene, 8)
    scenes.assert_same_picture(part, whole[12:24, 16:48])


def test_scaled_and_parented_camera(cycles):
    landmarks(cycles)
    parent = bpy.data.objects.new("Rig", None)
    parent.scale, parent.rotation_euler = (2.0, 2.0, 2.0), (0.0, 0.0, 0.3)
    cycles.collection.objects.link(parent)
    cycles.camera.parent = parent
    cycles.camera.location, cycles.camera.scale = (0.0, -3.5, 1.0), (1.0, 3.0, 0.5)
    assert_same_picture(cycles)
