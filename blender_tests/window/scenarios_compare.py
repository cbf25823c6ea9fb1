# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison in a real window; see driver.py."""

import gc

import bpy
import numpy as np
import scenes
from mathutils import Quaternion

SAMPLES = 4


def set_up(w):
    """The test scene under a bundled HDRI in Rendered shading: A is a kd-tree, B samples uniformly."""
    scene = scenes.new_scene()
    scene.skytree.max_bounces = 0
    scene.skytree.preview_samples = 4
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled("city"))
    view = w.space.region_3d
    view.view_perspective = "PERSP"
    view.view_location = (0.0, 0.0, 0.8)
    view.view_rotation = Quaternion((0.82, 0.57, 0.0, 0.0)).normalized()
    view.view_distance = 8.0
    w.space.overlay.show_overlays = False
    compared = scene.skytree_compare
    compared.a.method, compared.b.method = "KDTREE", "UNIFORM"
    compared.samples = SAMPLES
    w.shade("RENDERED")
    return scene, compared


def view_in(w):
    return w.part("compare.region").view_in(w.region)


def until_compared(w):
    """Yields until both sides have all their samples."""
    yield from w.until(lambda: view_in(w) is not None, what="a comparison")
    yield 0.1
    yield from w.until(lambda: not view_in(w).busy, what="both sides")
    w.event("MOUSEMOVE", "NOTHING", (0.9, 0.1))  # no tooltip over the picture
    yield 0.3


def scenario_split(w):
    """Kd-tree on the left of the line, uniform sampling on the right, with equal samples."""
    _, compared = set_up(w)
    compared.mode = "SPLIT"
    yield from until_compared(w)
    view = view_in(w)
    assert view.problem == ""
    assert [view.sides[name].picture.samples for name in "ab"] == [SAMPLES, SAMPLES]
    compared.show_figures = False  # and no hint that a reference is missing
    yield 0.3
    split = w.view_of(w.shot("split"))
    compared.mode = "FLIP"
    yield 0.3
    a = w.view_of(w.shot("flip_a"))
    w.key("J")
    yield 0.3
    assert compared.show_b
    b = w.view_of(w.shot("flip_b"))
    height, width = split.shape[:2]
    low, half = slice(height // 2), width // 2  # labels are in the upper half
    assert np.array_equal(split[low, : half - 10], a[low, : half - 10])
    assert np.array_equal(split[low, half + 10 :], b[low, half + 10 :])
    assert np.abs(a[low] - b[low]).mean() > 0.02, "A and B look alike"
    line = split[40 : height // 3, half - 1 : half + 1]
    assert line.min() > 0.6, "there is no white line"


def scenario_drag(w):
    """The line follows the mouse that drags it; elsewhere a click does not move it."""
    _, compared = set_up(w)
    compared.mode = "SPLIT"
    yield from until_compared(w)
    yield from w.drag("LEFTMOUSE", (0.5, 0.4), (0.25, 0.4))
    yield from until_compared(w)
    assert abs(compared.split - 0.25) < 0.02, f"the line stands at {compared.split}"
    w.shot("dragged")
    yield from w.drag("LEFTMOUSE", (0.7, 0.4), (0.6, 0.4))
    assert abs(compared.split - 0.25) < 0.02, f"a click elsewhere moved the line to {compared.split}"


def scenario_reference_and_figures(w):
    """A captured reference brings figures and a plot; the better sampler has the smaller error."""
    _, compared = set_up(w)
    compared.mode = "SPLIT"
    yield from until_compared(w)
    with w.override():
        assert bpy.ops.skytree.capture_reference(samples=16) == {"FINISHED"}
    view = view_in(w)
    assert view.capture is not None
    yield from w.until(lambda: view.reference is not None, seconds=150.0, what="the reference")
    yield from until_compared(w)
    errors = {name: view.sides[name].steps[-1].errors["relmse"] for name in "ab"}
    assert errors["a"] < 0.1 * errors["b"], errors
    assert [view.sides[name].steps[-1].samples for name in "ab"] == [SAMPLES, SAMPLES]
    w.shot("reference")

    w.space.region_3d.view_distance = 7.0
    yield from until_compared(w)
    assert view.reference_is_stale
    w.shot("stale_reference")
    w.space.region_3d.view_distance = 8.0
    yield from until_compared(w)
    assert not view.reference_is_stale


def scenario_captured_reference_as_side(w):
    """B is the captured reference; Difference to it is what A gets wrong."""
    _, compared = set_up(w)
    compared.b.method = "REFERENCE"
    compared.mode = "DIFFERENCE"
    yield from until_compared(w)
    with w.override():
        bpy.ops.skytree.capture_reference(samples=16)
    yield from w.until(lambda: view_in(w).reference is not None, seconds=150.0, what="the reference")
    yield from until_compared(w)
    b = view_in(w).sides["b"]
    assert b.picture.samples == 16
    assert np.array_equal(b.picture.pixels[..., :3], view_in(w).reference.image)
    w.shot("difference_to_reference")


def scenario_cancel_reference(w):
    """Cancelling a capture leaves no reference and goes on with the two sides."""
    _, compared = set_up(w)
    compared.mode = "SPLIT"
    yield from until_compared(w)
    with w.override():
        bpy.ops.skytree.capture_reference(samples=1 << 20)
    yield 0.3
    assert w.part("compare.region").capture_fraction() is not None
    w.shot("capturing")
    with w.override():
        assert bpy.ops.skytree.cancel_reference() == {"FINISHED"}
    yield from until_compared(w)
    assert view_in(w).captured is None
    assert view_in(w).sides["a"].picture.samples == SAMPLES


def scenario_other_modes(w):
    """Side by side shows the middle twice; difference is black where both agree."""
    _, compared = set_up(w)
    compared.show_figures = False
    compared.mode = "SIDE"
    yield from until_compared(w)
    shown = w.view_of(w.shot("side_by_side"))
    height, width = shown.shape[:2]
    # Where the spheres are and Blender's own buttons are not; means of cells hide the noise.
    band = slice(int(0.35 * height), int(0.35 * height) + 120)
    cells = [
        shown[band, start + 60 : start + 60 + 200].reshape(6, 20, 10, 20, 3).mean(axis=(1, 3))
        for start in (0, width // 2)
    ]
    assert np.corrcoef(cells[0].ravel(), cells[1].ravel())[0, 1] > 0.9

    compared.mode = "DIFFERENCE"
    yield from until_compared(w)
    different = w.view_of(w.shot("difference"))
    compared.b.method = "KDTREE"
    yield from until_compared(w)
    same = w.view_of(w.shot("no_difference"))
    middle = slice(60, height // 2), slice(100, width - 140)  # neither labels nor Blender's buttons
    assert same[middle].max() < 0.02, "equal methods with equal seeds differ"
    assert different[middle].mean() > 0.05


def scenario_equal_time(w):
    """Under Equal Time both sides stop after the same time, whatever they have reached."""
    _, compared = set_up(w)
    compared.clock, compared.seconds = "TIME", 0.8
    compared.mode = "SPLIT"
    yield from until_compared(w)
    sides = [view_in(w).sides[name] for name in "ab"]
    assert all(side.finished and side.picture.samples > 0 for side in sides)
    for side in sides:
        w.figure(f"equal time, {side.method.label}, samples", side.picture.samples)
        w.figure(f"equal time, {side.method.label}, seconds", side.seconds)
    # Both were told to stop in the same tick; a session counts from its first ray, which may be late.
    assert all(side.seconds >= 0.4 for side in sides)
    w.shot("equal_time")


def scenario_settings(w):
    """Every method and setting shows a picture; orbiting and editing the scene restart both sides."""
    scene, compared = set_up(w)
    compared.samples = 1
    compared.mode = "SPLIT"
    yield from until_compared(w)
    for method in ("SCENE", "KDTREE", "INVERSION", "ALIAS", "UNIFORM", "BSDF"):
        compared.a.method = method
        yield from until_compared(w)
        assert view_in(w).problem == ""
        assert view_in(w).sides["a"].picture.samples == 1, method
    compared.a.method = "KDTREE"
    builds = w.part("environments").environments.builds
    for count in (16, 64):
        compared.a.block_count = count
        yield from until_compared(w)
        assert view_in(w).sides["a"].sampler.result().sampler.block_count == count
    assert w.part("environments").environments.builds == builds + 2

    before = view_in(w).sides["a"].picture.pixels.copy()
    bpy.data.objects["Sphere"].location.z += 1.0
    yield 0.2
    yield from until_compared(w)
    assert not np.array_equal(view_in(w).sides["a"].picture.pixels, before)
    yield from w.drag("MIDDLEMOUSE", (0.4, 0.4), (0.6, 0.5))
    yield from until_compared(w)
    assert view_in(w).sides["a"].picture.view == view_in(w).request.view
    compared.mode = "OFF"
    yield 0.3
    assert view_in(w) is None
    yield from w.until_still()
    assert w.renderers()[0].samples_done == scene.skytree.preview_samples


def scenario_quad_view_and_two_views(w):
    """Every view compares by itself; a reference is captured for each, and each is judged by its own."""
    _, compared = set_up(w)
    compared.samples, compared.mode = 2, "SPLIT"
    yield from until_compared(w)
    with w.override():
        bpy.ops.screen.region_quadview()
    region = w.part("compare.region")
    yield from w.until(lambda: len(region._views) == 4, what="four comparisons")
    yield from w.until(lambda: not any(view.busy for view in region._views.values()), what="all sides")
    with w.override():
        bpy.ops.skytree.capture_reference(samples=4)
    views = list(region._views.values())
    yield from w.until(lambda: all(view.reference is not None for view in views), 150.0, "four references")
    yield from w.until(lambda: not any(view.busy for view in views), what="all sides")
    yield 0.5
    w.shot("quad_view")
    assert all(view.problem == "" and view.sides["a"].steps for view in views)
    assert len({view.captured.of[0] for view in views}) == 4
    with w.override():
        bpy.ops.screen.region_quadview()
    yield 0.5
    gc.collect()
    yield from w.until(lambda: len(region._views) == 1, what="one comparison after quad view")
    yield from until_compared(w)


def scenario_camera_border_and_ortho(w):
    """In camera view with a border, orthographic, of another size, and with a transparent film."""
    scene, compared = set_up(w)
    compared.mode, compared.show_figures = "SPLIT", False
    yield from until_compared(w)
    with w.override():
        bpy.ops.view3d.view_camera()
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.75
    scene.render.border_min_y, scene.render.border_max_y = 0.2, 0.8
    yield from w.until(lambda: view_in(w).request.view.border is not None, what="the border")
    yield from until_compared(w)
    x0, y0, x1, y1 = view_in(w).request.view.border
    assert view_in(w).sides["b"].picture.pixels.shape[:2] == (y1 - y0, x1 - x0)
    w.shot("camera_border")
    scene.render.use_border = False
    scene.render.film_transparent = True
    yield from w.until(lambda: view_in(w).request.settings.film_transparent, what="the film")
    yield from until_compared(w)
    w.shot("film_transparent")
    assert view_in(w).sides["a"].picture.pixels[..., 3].min() == 0.0
    scene.render.film_transparent = False
    with w.override():
        bpy.ops.view3d.view_axis(type="TOP")
    w.space.region_3d.view_perspective = "ORTHO"
    yield 0.8
    yield from until_compared(w)
    w.shot("orthographic")
    with w.override():
        bpy.ops.screen.screen_full_area()
    yield 0.5
    yield from until_compared(w)
    size = view_in(w).request.view
    assert (size.width, size.height) == (w.region.width, w.region.height)
    with w.override():
        bpy.ops.screen.back_to_previous()
    yield 0.5
    yield from until_compared(w)
    assert view_in(w).problem == ""


def scenario_report_in_the_background(w):
    """The button returns at once; the panel tells how far it is, cancels, and opens the page."""
    scene, compared = set_up(w)
    scene.render.resolution_x, scene.render.resolution_y = 160, 100
    compared.samples, compared.reference_samples = 4, 1 << 20
    compared.folder = str(w.folder / "report")
    yield from w.until_still()
    w.key("N")  # the sidebar
    yield 0.5
    w.key("LEFTMOUSE", (0.98, 0.636))  # its tab Skytree
    yield 0.5
    background = w.part("compare.background")
    with w.override():
        bpy.ops.skytree.compare_report("INVOKE_DEFAULT")
    yield from w.until(lambda: background.current().progress.text == "reference", what="the reference")
    yield from w.drag("MIDDLEMOUSE", (0.4, 0.4), (0.5, 0.5))
    yield 0.5
    w.shot("report_running")
    with w.override():
        assert bpy.ops.skytree.cancel_report() == {"FINISHED"}
    yield from w.until(lambda: background.current().done, what="the end of the report")
    assert background.current().page is None
    compared.reference_samples = 16
    with w.override():
        bpy.ops.skytree.compare_report("INVOKE_DEFAULT")
    yield from w.until(lambda: background.current().done, 120.0, "the report")
    yield 0.5
    assert background.current().problem == "" and background.current().page.exists()
    w.shot("report_done")
    w.key("N")
    yield 0.3


def scenario_close(w):
    """Leaving Rendered shading, loading another file: comparisons and their threads go."""
    _, compared = set_up(w)
    compared.mode = "SPLIT"
    yield from until_compared(w)
    w.shade("SOLID")
    yield 0.5
    assert view_in(w) is None
    w.shade("RENDERED")
    yield from until_compared(w)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    yield 0.5
    assert not w.part("compare.region")._views
