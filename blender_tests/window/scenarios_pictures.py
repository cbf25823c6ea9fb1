# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the map and the sampler's overlay in a real window; see driver.py."""

import bpy
import numpy as np
import scenes
from mathutils import Quaternion


def set_up(w, distance: float = 8.0):
    scene = scenes.new_scene()
    scene.skytree.preview_samples = 4
    scene.skytree.max_bounces = 0
    scene.skytree.block_count = 256
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled("city"))
    view = w.space.region_3d
    view.view_perspective = "PERSP"
    view.view_location = (0.0, 0.0, 0.8)
    view.view_rotation = Quaternion((0.76, 0.65, 0.0, 0.0)).normalized()
    view.view_distance = distance
    w.space.overlay.show_overlays = False
    return scene, scene.skytree_overlay


def current(w):
    return w.part("pictures.map_pictures").current()


def until_current(w, count: int):
    """Yields until the pictures follow a kd-tree of `count` blocks and the view was drawn with them."""
    yield from w.until(
        lambda: current(w) is not None and getattr(current(w).built.sampler, "block_count", 0) == count,
        what=f"{count} blocks",
    )
    yield 0.4


def scenario_overlay(w):
    """Blocks and samples are drawn over the view, follow the block count and go when switched off."""
    scene, overlay = set_up(w)
    w.shade("RENDERED")
    yield from w.until_still()
    plain = w.view_of(w.shot("overlay_off"))
    overlay.show_blocks = True
    yield from until_current(w, 256)
    blocks = w.view_of(w.shot("overlay_blocks"))
    assert np.abs(blocks - plain).mean() > 0.01
    scene.skytree.block_count = 16
    yield from until_current(w, 16)
    yield from w.until_still()
    few = w.view_of(w.shot("overlay_few_blocks"))
    assert np.abs(few - blocks).mean() > 0.005
    overlay.show_blocks, overlay.show_samples = False, True
    yield 0.5
    samples = w.view_of(w.shot("overlay_samples"))
    assert (np.abs(samples - few).max(axis=2) > 0.1).mean() > 0.0005
    overlay.show_samples = False
    scene.skytree.block_count = 256
    yield 0.2
    yield from w.until_still()
    again = w.view_of(w.shot("overlay_off_again"))
    assert np.array_equal(again, plain)


def scenario_overlay_at_the_origin(w):
    """The sphere at the origin is seen from outside, in Solid shading as well."""
    _, overlay = set_up(w, distance=20.0)
    plain = w.view_of(w.shot("sphere_off"))
    overlay.show_blocks, overlay.show_samples = True, True
    overlay.place, overlay.radius = "ORIGIN", 4.0
    yield from until_current(w, 256)
    sphere = w.view_of(w.shot("sphere_on"))
    height, width = sphere.shape[:2]
    inside = np.abs(sphere - plain)[height // 3 : height // 2, width // 2 - 40 : width // 2 + 40].mean()
    outside = np.abs(sphere - plain)[:60, :60].mean()
    assert inside > 0.03 and outside < 0.001, (inside, outside)


def scenario_pictures_follow_the_slider(w):
    """The World properties show each picture; another block count brings another one."""
    scene, overlay = set_up(w)
    pictures = w.part("pictures.map_pictures")
    area = next(a for a in w.window.screen.areas if a.type == "PROPERTIES")
    area.spaces.active.context = "WORLD"
    for kind in ("BLOCKS", "PDF", "EXPOSURE"):
        overlay.picture = kind
        pictures.follow(scene, kind)
        yield from w.until(lambda kind=kind: pictures.icon(kind) != 0, what=f"the picture {kind}")
    preview = pictures._previews["BLOCKS"]
    before = np.empty(len(preview.image_pixels_float), np.float32)
    preview.image_pixels_float.foreach_get(before)
    assert before.size == pictures.SIZE**2 * 4 and before.std() > 0.1
    scene.skytree.block_count = 16
    pictures.follow(scene, "BLOCKS")
    yield from until_current(w, 16)
    yield from w.until(lambda: not pictures._drawing, what="the picture")
    yield 0.3
    after = np.empty_like(before)
    preview.image_pixels_float.foreach_get(after)
    assert np.abs(after - before).mean() > 0.01
    with w.override():
        assert bpy.ops.skytree.picture_image(size=128) == {"FINISHED"}
    assert tuple(bpy.data.images["Skytree Exposure"].size) == (128, 128)

    scene.skytree.block_count = 256
    big = w.area
    big.type = "PROPERTIES"
    yield 0.5  # its tabs are known once it was drawn
    big.spaces.active.context = "WORLD"
    for kind in ("BLOCKS", "PDF", "EXPOSURE"):
        overlay.picture = kind
        yield from until_current(w, 256)
        shows_it = lambda kind=kind: pictures._shown.get(kind) == current(w).key  # noqa: E731
        yield from w.until(shows_it, what=f"the picture {kind}")
        for _ in range(40):  # to where the picture is
            middle = {"x": big.x + big.width // 2, "y": big.y + big.height // 3}
            w.window.event_simulate(type="MOUSEMOVE", value="NOTHING", **middle)
            w.window.event_simulate(type="WHEELDOWNMOUSE", value="PRESS", **middle)
        yield 0.5
        screenshot = str(w.folder / f"panel_{kind.lower()}.png")
        region = next(r for r in big.regions if r.type == "WINDOW")
        with bpy.context.temp_override(window=w.window, screen=w.window.screen, area=big, region=region):
            bpy.ops.screen.screenshot(filepath=screenshot)
