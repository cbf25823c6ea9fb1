# SPDX-License-Identifier: GPL-3.0-or-later
"""The live viewport in a real window; see driver.py."""

import bpy
import scenes
from mathutils import Quaternion


def set_up(w, map_name: str = "city"):
    """The test scene under a bundled HDRI, seen from the side, in Solid shading."""
    scene = scenes.new_scene()
    scene.skytree.preview_samples = 8
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled(map_name))
    view = w.space.region_3d
    view.view_perspective = "PERSP"
    view.view_location = (0.0, 0.0, 0.8)
    view.view_rotation = Quaternion((0.82, 0.57, 0.0, 0.0)).normalized()
    view.view_distance = 8.0
    w.space.overlay.show_overlays = False
    return scene


def scenario_rendered(w):
    """Rendered shading shows the scene, refines, and stops at preview_samples."""
    scene = set_up(w)
    yield 0.3
    assert not w.renderers()
    w.shade("RENDERED")
    yield from w.until(w.renderers, what="a renderer")
    renderer = w.renderers()[0]
    yield from w.until(lambda: renderer.picture, what="a first picture")
    w.figure("first picture, ms after the view was asked for", renderer.picture.seconds * 1000)
    yield from w.until_still()
    assert renderer.problem == ""
    assert renderer.samples_done == scene.skytree.preview_samples
    shot = w.view_of(w.shot("rendered"), 0.1)
    assert shot.std() > 0.05, "the view is of one colour"
