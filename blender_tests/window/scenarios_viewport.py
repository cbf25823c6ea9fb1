# SPDX-License-Identifier: GPL-3.0-or-later
"""The live viewport in a real window; see driver.py."""

import gc
import resource
import threading
from pathlib import Path

import bpy
import numpy as np
import scenes
from mathutils import Quaternion


def set_up(w, map_name: str = "city"):
    """The test scene under a bundled HDRI, seen from the side, in Solid shading."""
    scene = scenes.new_scene()
    scene.skytree.preview_samples = 2
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
    scene.skytree.preview_samples = 16
    yield 0.3
    assert not w.renderers()
    w.shade("RENDERED")
    yield from w.until(w.renderers, what="a renderer")
    renderer = w.renderers()[0]
    yield from w.until(lambda: renderer.picture, what="a first picture")
    w.figure("first picture of Rendered shading, ms", renderer.first_picture_seconds * 1000)
    yield from w.until_still()
    assert renderer.problem == ""
    assert renderer.samples_done == scene.skytree.preview_samples
    shot = w.view_of(w.shot("rendered"), 0.1)
    assert shot.std() > 0.05, "the view is of one colour"


def rendered(w, refined=True, **settings):
    """The test scene in Rendered shading; its renderer."""
    scene = set_up(w)
    for name, value in settings.items():
        setattr(scene.skytree, name, value)
    w.shade("RENDERED")
    yield from w.until(lambda: w.renderers() and w.renderers()[0].picture, what="a picture")
    if refined:
        yield from w.until_still()
    return w.renderers()[0]


def difference(a, b) -> float:
    return float(np.abs(a - b).mean())


def scenario_orbit_pan_zoom(w):
    """Dragging with the middle mouse button shows new pictures on the way and refines the last view."""
    renderer = yield from rendered(w)
    shown = []
    original = renderer.draw

    def counting(**options):
        original(**options)
        shown.append(renderer.picture.view)

    renderer.draw = counting
    before = w.view_of(w.shot("orbit_before"), 0.2)
    for name, modifiers in (("orbit", {}), ("pan", {"shift": True}), ("zoom", {"ctrl": True})):
        view = renderer.view
        shown.clear()
        yield from w.drag("MIDDLEMOUSE", (0.5, 0.5), (0.62, 0.56), steps=5, **modifiers)
        yield from w.until_still()
        assert renderer.view != view, name
        assert len(set(shown)) > 1, f"no picture was shown on the way of {name}"
        assert renderer.picture.view == renderer.view and renderer.samples_done == 2
    after = w.view_of(w.shot("orbit_after"), 0.2)
    assert difference(before, after) > 0.02
    w.figure("first picture of the last view, ms", renderer.first_picture_seconds * 1000)


def scenario_cuda(w):
    """On a GPU the same picture, in the memory that the GPU copied it to; orbiting, and back to the CPU."""
    if problem := w.part("devices").cuda_problem():
        w.skip(problem)
    renderer = yield from rendered(w, preview_samples=4)
    on_cpu = w.view_of(w.shot("cuda_before"), 0.1)
    assert renderer.pixels().flags.owndata
    w.scene.skytree.device = "CUDA"
    picture = renderer.picture
    yield from w.until(lambda: renderer.picture is not picture and not renderer.busy, what="CUDA's picture")
    assert renderer.session.warning is None and "CPU" not in renderer.session.stats["device"].split(" + ")
    assert renderer.samples_done == 4 and not renderer.pixels().flags.owndata
    on_gpu = w.view_of(w.shot("cuda"), 0.1)
    w.figure("mean difference of the screenshots, CUDA and CPU", difference(on_cpu, on_gpu))
    assert difference(on_cpu, on_gpu) < 0.01
    yield from w.drag("MIDDLEMOUSE", (0.5, 0.5), (0.62, 0.56), steps=5)
    yield from w.until_still()
    assert renderer.samples_done == 4 and renderer.session.warning is None
    turned = w.view_of(w.shot("cuda_orbit"), 0.1)
    w.scene.skytree.device = "CPU"
    picture = renderer.picture
    yield from w.until(
        lambda: renderer.picture is not picture and not renderer.busy, what="the CPU's picture"
    )
    assert difference(turned, w.view_of(w.shot("cuda_after"), 0.1)) < 0.01


def coarse(image):
    """Means of blocks of 16 x 16 pixels."""
    rows, columns = image.shape[0] // 16, image.shape[1] // 16
    return image[: rows * 16, : columns * 16].reshape(rows, 16, columns, 16, 3).mean(axis=(1, 3))


def scenario_beside_cycles(w):
    """The same view through Cycles: camera, background, light and view transform agree."""
    yield from rendered(w, preview_samples=8)
    ours = w.view_of(w.shot("beside_cycles_skytree"), 0.2)
    w.shade("SOLID")
    scene = w.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.preview_samples, cycles.use_preview_denoising, cycles.use_preview_adaptive_sampling = (
        16,
        False,
        False,
    )
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = scene.skytree.max_bounces
    yield 0.2
    w.shade("RENDERED")
    for _ in range(30):  # Cycles begins with a coarse picture, and may dwell on it
        yield 1.0
        theirs = w.view_of(w.shot("beside_cycles_cycles"), 0.2)
        worst = np.abs(coarse(theirs) - coarse(ours)).max()
        if theirs.std() > 0.05 and abs(theirs.mean() - ours.mean()) < 0.01 and worst < 0.12:
            break
    w.shade("SOLID")
    w.figure("mean, Skytree", ours.mean())
    w.figure("mean, Cycles", theirs.mean())
    assert abs(theirs.mean() - ours.mean()) < 0.02
    w.figure("largest difference of a 16 x 16 block", worst)
    assert worst < 0.12


def scenario_camera_view(w):
    """Camera view with its zoom and offset, a render border, an orthographic view, a border outside of it."""
    renderer = yield from rendered(w)
    scene = w.scene
    with w.override():
        bpy.ops.view3d.view_camera()
    yield from w.until_still()
    whole = w.view_of(w.shot("camera_whole"))
    view = renderer.view
    w.space.region_3d.view_camera_zoom = 40.0
    w.space.region_3d.view_camera_offset = (0.1, 0.0)
    w.region.tag_redraw()
    yield from w.until_still()
    assert renderer.view != view
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.75
    scene.render.border_min_y, scene.render.border_max_y = 0.2, 0.8
    yield from w.until_still()
    border = renderer.view.border
    assert border is not None and renderer.pixels().shape[:2] == (
        border[3] - border[1],
        border[2] - border[0],
    )
    part = w.view_of(w.shot("camera_border"))
    assert difference(whole, part) > 0.02
    w.key("NUMPAD_0")
    scene.render.use_border = False
    yield 0.3
    with w.override():
        bpy.ops.view3d.view_axis(type="FRONT")
        bpy.ops.view3d.view_persportho()
    w.space.region_3d.view_perspective = "ORTHO"
    yield 0.8
    yield from w.until_still()
    assert w.space.region_3d.view_perspective == "ORTHO" and not w.space.region_3d.is_perspective
    shot = w.view_of(w.shot("orthographic"), 0.2)
    assert shot.std() > 0.02 and renderer.problem == ""


def scenario_quad_view_and_second_area(w):
    """Four views at once, then a second 3D view; each has its renderer, and closing gives it back."""
    yield from rendered(w, preview_samples=2)
    with w.override():
        bpy.ops.screen.region_quadview()
    yield from w.until(lambda: len(w.renderers()) == 4, what="four renderers")
    yield from w.until_still()
    assert all(r.samples_done == 2 for r in w.renderers())
    w.shot("quad_view")
    with w.override():
        bpy.ops.screen.region_quadview()
    yield 0.5
    gc.collect()
    yield from w.until(lambda: len(w.renderers()) == 1, what="one renderer after quad view")
    other = next(a for a in w.window.screen.areas if a.type == "PROPERTIES")
    other.type = "VIEW_3D"
    other.spaces.active.shading.type = "RENDERED"
    yield from w.until(lambda: len(w.renderers()) == 2, what="two renderers")
    yield from w.until_still()
    w.shot("two_views")
    other.type = "PROPERTIES"
    yield from w.until(lambda: len(w.renderers()) == 1, what="one renderer after closing a view")
    yield from w.until_still()
    assert w.renderers()[0].problem == ""


def scenario_changes(w):
    """Every setting, an object, a material, the world: each change shows a new picture by itself."""
    renderer = yield from rendered(w, preview_samples=2)
    scene = w.scene
    nodes = scene.world.node_tree.nodes
    mapping = next(n for n in nodes if n.type == "MAPPING")
    background = next(n for n in nodes if n.type == "BACKGROUND")
    clay = scenes.shader_node(bpy.data.materials["Clay"])
    builds = w.part("environments").environments
    changes = {
        "max_bounces": lambda: setattr(scene.skytree, "max_bounces", 0),
        "seed": lambda: setattr(scene.skytree, "seed", 5),
        "preview_samples": lambda: setattr(scene.skytree, "preview_samples", 3),
        "filter_width": lambda: setattr(scene.skytree, "filter_width", 2.5),
        "pixel_filter": lambda: setattr(scene.skytree, "pixel_filter", "BOX"),
        "block_count": lambda: setattr(scene.skytree, "block_count", 64),
        "split_criterion": lambda: setattr(scene.skytree, "split_criterion", "SSE"),
        "block_probability": lambda: setattr(scene.skytree, "block_probability", "FITTED"),
        "sampler inversion": lambda: setattr(scene.skytree, "sampler", "INVERSION"),
        "sampler alias": lambda: setattr(scene.skytree, "sampler", "ALIAS"),
        "sampler uniform": lambda: setattr(scene.skytree, "sampler", "UNIFORM"),
        "sampler kd-tree": lambda: setattr(scene.skytree, "sampler", "KDTREE"),
        "film_transparent": lambda: setattr(scene.render, "film_transparent", True),
        "film opaque": lambda: setattr(scene.render, "film_transparent", False),
        "object": lambda: setattr(bpy.data.objects["Sphere"], "location", (-1.5, 0.5, 1.2)),
        "material": lambda: scenes.set_input(clay, "Color", (0.1, 0.3, 0.8)),
        "hidden object": lambda: bpy.data.objects["Sphere.001"].hide_set(True),
        "world rotation": lambda: setattr(mapping.inputs["Rotation"], "default_value", (0.0, 0.0, 1.0)),
        "world strength": lambda: setattr(background.inputs["Strength"], "default_value", 1.5),
    }  # fmt: skip
    for name, change in changes.items():
        picture, built = renderer.picture, builds.builds
        change()
        yield from w.until(
            lambda picture=picture: renderer.picture is not picture and not renderer.busy,
            what=f"a picture after a change of {name}",
        )
        assert renderer.problem == "", (name, renderer.problem)
        if name.startswith("world"):
            assert builds.builds == built, f"{name} built a sampler"
        if name == "film_transparent":
            w.shot("film_transparent")
            assert renderer.pixels()[..., 3].min() == 0.0
        if name.startswith("sampler") or name == "block_count":
            w.figure(f"{name}: new picture, ms", renderer.first_picture_seconds * 1000)
    w.shot("changed")


def scenario_render_and_undo(w):
    """F12 while the viewport renders, then undo and redo, edit mode."""
    renderer = yield from rendered(w, refined=False, preview_samples=4096, samples=2)
    scene = w.scene
    finished = []
    handler = lambda *_: finished.append(True)  # noqa: E731
    bpy.app.handlers.render_complete.append(handler)
    try:
        assert renderer.busy
        with w.override():
            bpy.ops.render.render("INVOKE_DEFAULT")
        yield from w.until(lambda: finished, what="the end of the final render")
    finally:
        bpy.app.handlers.render_complete.remove(handler)
    scene.skytree.preview_samples = 2
    yield from w.until_still()
    assert renderer.problem == ""
    with w.override():
        bpy.ops.ed.undo_push(message="before")
        bpy.data.objects["Sphere"].location.z = 3.0
        bpy.ops.ed.undo_push(message="moved")
    yield from w.until_still()
    for operator in (bpy.ops.ed.undo, bpy.ops.ed.redo, bpy.ops.ed.undo):
        with w.override():
            operator()
        yield 0.3
        yield from w.until(w.renderers, what="a renderer after undo")
        yield from w.until_still()
        assert all(r.problem == "" for r in w.renderers())
    assert bpy.data.objects["Sphere"].location.z < 2.0
    undone = w.view_of(w.shot("undone"), 0.2)
    bpy.context.view_layer.objects.active = bpy.data.objects["Sphere"]
    with w.override():
        bpy.ops.object.mode_set(mode="EDIT")
    yield from w.until_still()
    edited = w.view_of(w.shot("edit_mode"), 0.2)
    assert difference(edited, undone) < 0.05, "the object in edit mode is not seen"
    with w.override():
        bpy.ops.object.mode_set(mode="OBJECT")
    yield from w.until_still()
    assert all(r.problem == "" for r in w.renderers())


def scenario_local_view(w):
    """Local view shows the selected object alone; what the view itself hides is not there; both come back."""
    renderer = yield from rendered(w, preview_samples=2)
    whole = w.view_of(w.shot("local_view_before"), 0.2)
    triangles = renderer.sync.scene.stats["instances"]
    assert triangles == 3
    meshes = renderer.sync.counts["meshes"]
    for ob in bpy.data.objects:
        ob.select_set(ob.name == "Sphere")
    with w.override():
        bpy.ops.view3d.localview(frame_selected=False)
    yield from w.until(lambda: renderer.sync.scene.stats["instances"] == 1, what="local view")
    yield from w.until_still()
    alone = w.view_of(w.shot("local_view"), 0.2)
    assert difference(alone, whole) > 0.1
    with w.override():
        bpy.ops.view3d.localview(frame_selected=False)
    yield from w.until(lambda: renderer.sync.scene.stats["instances"] == 3, what="the end of local view")
    yield from w.until_still()
    assert difference(w.view_of(w.shot("local_view_after"), 0.2), whole) < 0.02
    w.space.show_object_viewport_mesh = False
    yield from w.until(lambda: renderer.sync.scene.stats["instances"] == 0, what="hidden meshes")
    w.space.show_object_viewport_mesh = True
    yield from w.until(lambda: renderer.sync.scene.stats["instances"] == 3, what="shown meshes")
    yield from w.until_still()
    assert renderer.sync.counts["meshes"] == meshes, "a mesh was sent again"
    # What changes while it is hidden is read again.
    w.space.show_object_viewport_mesh = False
    yield from w.until(lambda: renderer.sync.scene.stats["instances"] == 0, what="hidden meshes")
    bpy.data.objects["Sphere"].data.vertices[0].co.z += 0.1
    bpy.data.objects["Sphere"].data.update()
    yield 0.2
    w.space.show_object_viewport_mesh = True
    yield from w.until(lambda: renderer.sync.scene.stats["instances"] == 3, what="shown meshes")
    assert renderer.sync.counts["meshes"] == meshes + 1, "an edited mesh was not sent, or others were"
    assert renderer.problem == ""


def scenario_resize(w):
    """A region that changes its size keeps showing a picture, at last one of its own size."""
    renderer = yield from rendered(w, preview_samples=2)
    sizes = [renderer.size]
    with w.override():
        bpy.ops.screen.screen_full_area()
    yield 0.5
    yield from w.until(lambda: w.renderers() and w.renderers()[0].picture, what="a picture of a large view")
    yield from w.until_still()
    sizes.append(w.renderers()[0].size)
    assert sizes[1] > sizes[0] and w.renderers()[0].size == (w.region.width, w.region.height)
    w.shot("full_screen")
    with w.override():
        bpy.ops.screen.back_to_previous()
    yield 0.5
    yield from w.until_still()


def scenario_failure_is_a_message(w):
    """A render thread without memory says so in the view; the next change brings the picture back."""
    renderer = yield from rendered(w, preview_samples=2)
    start = renderer._start

    def starved(divisor):
        with scenes.short_of_memory(48):  # the tree of a million triangles takes more
            start(divisor)
            renderer.session.wait(60.0)

    renderer._start = starved
    grid = scenes.million_triangles(w.scene)
    yield from w.until(lambda: renderer.problem, what="a message")
    renderer._start = start
    yield 0.5
    w.shot("failure")
    assert "memory" in renderer.problem
    bpy.data.objects.remove(grid)
    yield from w.until_still()
    assert renderer.problem == "" and renderer.samples_done == 2


def scenario_floating_preview(w):
    """Skytree's picture in the corner of a Solid view, in all corners; gone when switched off."""
    scene = set_up(w)
    w.space.overlay.show_overlays = True
    scene.skytree.preview_samples = 4
    yield 0.3
    plain = w.view_of(w.shot("floating_off"))
    scene.skytree.floating_preview = True
    yield from w.until(lambda: w.renderers() and w.renderers()[0].picture, what="a picture")
    yield 0.5
    yield from w.until_still()
    shots = {}
    for corner in ("LOWER_LEFT", "UPPER_LEFT", "UPPER_RIGHT", "LOWER_RIGHT"):
        scene.skytree.floating_corner = corner
        yield 0.3
        yield from w.until_still()
        shots[corner] = w.view_of(w.shot(f"floating_{corner.lower()}"))
        assert difference(shots[corner], plain) > 0.01, corner
    height, width = plain.shape[:2]
    quarter = shots["LOWER_RIGHT"][: height // 4, -width // 4 :]
    assert difference(quarter, plain[: height // 4, -width // 4 :]) > 0.05
    scene.skytree.floating_size = 60.0
    yield from w.until_still()
    w.shot("floating_large")
    bpy.data.objects["Sphere"].location.z = 2.0
    renderer = w.renderers()[0]
    picture = renderer.picture
    yield from w.until(lambda: renderer.picture is not picture, what="a picture of the moved sphere")
    yield from w.until_still()
    scene.skytree.floating_preview = False
    yield from w.until(lambda: not w.renderers(), what="the end of the renderer")
    yield 0.3
    assert difference(w.view_of(w.shot("floating_gone")), plain) < 0.02


def scenario_load_and_close(w):
    """Another file while the viewport renders; leaving Rendered shading; nothing stays behind."""
    yield from rendered(w, refined=False, preview_samples=4096)
    assert w.renderers()[0].busy
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=False)
    yield 0.5
    gc.collect()
    assert not w.renderers(), "a renderer outlived its file"
    yield from rendered(w, refined=False, preview_samples=4096)
    assert w.renderers()[0].busy
    w.shade("SOLID")
    yield 0.5
    gc.collect()
    assert not w.renderers(), "a renderer outlived Rendered shading"


def disable_ten_times(w):
    """Disabled and enabled while it renders, compares, floats and overlays; then it works as before."""
    yield from rendered(w, refined=False, preview_samples=4096)
    keymap = bpy.context.window_manager.keyconfigs.addon.keymaps["3D View"]
    keys = len(keymap.keymap_items)
    resident = []
    for round_ in range(10):
        scene = w.scene
        scene.skytree.max_bounces = 0
        scene.skytree_compare.mode = "SPLIT" if round_ % 2 else "OFF"
        scene.skytree_overlay.show_blocks = round_ < 2  # slow to draw in software
        w.shade("RENDERED")
        yield from w.until(w.renderers, what="a renderer")
        yield 0.1
        w.addon.unregister()
        yield 0.1
        gc.collect()
        assert not w.renderers(), "a renderer outlived the add-on"
        assert not [t.name for t in threading.enumerate() if "skytree" in t.name.lower()]
        assert not any(i.idname.startswith("skytree") for i in keymap.keymap_items)
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        resident.append(pages * resource.getpagesize() / 1e6)
        w.addon.register()
        w.scene.render.engine = "SKYTREE"
    w.figure("ten times disabled: MB more than after the second time", resident[-1] - resident[1])
    assert len(keymap.keymap_items) == keys
    w.shade("SOLID")
    renderer = yield from rendered(w, preview_samples=2)
    assert renderer.problem == "" and renderer.samples_done == 2


def scenario_disable_ten_times(w):
    """See disable_ten_times; where it fails, the scenarios that follow still find the add-on."""
    try:
        yield from disable_ten_times(w)
    finally:
        if not hasattr(bpy.types.Scene, "skytree"):
            w.addon.register()


def scenario_thumbnails(w):
    """Previews of a material and of a world are rendered by the engine."""
    scene = set_up(w)
    yield 0.2
    for datablock in (bpy.data.materials["Clay"], scene.world):
        datablock.preview_ensure()
        with w.override():
            bpy.ops.wm.previews_ensure()
        datablock.asset_generate_preview()
        yield from w.until(
            lambda d=datablock: d.preview is not None and any(d.preview.image_pixels_float),
            what=f"the preview of {datablock.name}",
        )
        yield 0.5
        pixels = np.array(datablock.preview.image_pixels_float, np.float32)
        width, height = datablock.preview.image_size
        pixels = pixels.reshape(height, width, 4)
        image = bpy.data.images.new("preview", width, height, alpha=True)
        image.pixels.foreach_set(pixels.ravel())
        image.filepath_raw, image.file_format = str(w.folder / f"thumbnail_{datablock.name}.png"), "PNG"
        image.save()
        bpy.data.images.remove(image)
        assert pixels[..., :3].std() > 0.02, datablock.name
    clay = np.array(bpy.data.materials["Clay"].preview.image_pixels_float).reshape(-1, 4)
    middle = clay[clay[:, 3] > 0.9].mean(axis=0)
    assert middle[0] > 1.2 * middle[2], "the material's colour is not seen"
