# SPDX-License-Identifier: GPL-3.0-or-later
"""The renderer behind the 3D views, without a window: what is sent again, what is built, what is given
back."""

import gc
import math
import resource
import time
import weakref
from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest
import scenes
from scenes import Updates, part

WIDTH, HEIGHT = 96, 64


@pytest.fixture
def viewport(skytree, scene):
    """(scene, renderer that has synced and looks through the camera)."""
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled())
    scene.skytree.preview_samples = 4
    renderer = part(skytree, "viewport.renderer").ViewportRenderer()
    update(renderer)
    look(skytree, renderer)
    finish(renderer)
    yield scene, renderer
    renderer.close()


def update(renderer):
    """What Blender does after a change: evaluates, and hands the depsgraph over with its updates."""
    bpy.context.view_layer.update()
    renderer.update(bpy.context.evaluated_depsgraph_get())


def view_through_camera(skytree, width=WIDTH, height=HEIGHT, border=None):
    camera = bpy.context.scene.camera
    depsgraph = bpy.context.evaluated_depsgraph_get()
    projection = camera.calc_matrix_camera(depsgraph, x=width, y=height)
    module = part(skytree, "viewport.view")
    flat = [tuple(v for row in m for v in row) for m in (camera.matrix_world, projection)]
    return module.View(*flat, width, height, border)


def look(skytree, renderer, view=None, **settings):
    module = part(skytree, "viewport.renderer")
    chosen = module.RenderSettings.of(bpy.context.scene)
    renderer.look(view or view_through_camera(skytree), chosen)


def finish(renderer, seconds=60.0):
    end = time.perf_counter() + seconds
    while renderer.busy and not renderer.problem:
        renderer.advance()
        assert time.perf_counter() < end, "the renderer does not come to an end"
        time.sleep(0.001)
    assert renderer.problem == ""


def uploads(renderer):
    """How often each kind of thing was uploaded since the last call."""
    now = dict(renderer.sync.counts)
    before = getattr(renderer, "counted_before", {})
    renderer.counted_before = now
    return {key: now[key] - before.get(key, 0) for key in now if now[key] != before.get(key, 0)}


def builds(skytree) -> int:
    return part(skytree, "environments").environments.builds


def test_refines_to_preview_samples(skytree, viewport):
    scene, renderer = viewport
    assert renderer.samples_done == 4 and not renderer.running
    assert renderer.pixels().shape == (HEIGHT, WIDTH, 4)
    scene.skytree.preview_samples = 9
    look(skytree, renderer)
    finish(renderer)
    assert renderer.samples_done == 9


def test_same_picture_as_a_final_render(skytree, viewport):
    scene, renderer = viewport
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.skytree.blue_noise = True  # as the viewport always has it
    scene.skytree.learn_visibility = scene.skytree.adaptive_sampling = False  # as only final renders do
    final = scenes.render_skytree(scene, samples=4)
    # A final render's tree is flat, a viewport's has instances: hits differ in their last bits, which decides
    # at edges.
    picture = renderer.pixels()
    assert (~np.isclose(picture, final, rtol=1e-4, atol=1e-5)).mean() < 0.01
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), final.mean(axis=(0, 1)), rtol=1e-4)


def test_first_picture_is_coarse(skytree, viewport):
    scene, renderer = viewport
    renderer.seconds_per_sample = 1.0  # a very slow machine
    seen = []
    look(skytree, renderer, view_through_camera(skytree, 640, 480))
    while renderer.busy:
        if renderer.advance():
            seen.append((renderer.picture.divisor, renderer.pixels().shape[:2]))
            renderer.seconds_per_sample = 1.0
    divisors = [divisor for divisor, _ in seen]
    assert divisors == sorted(divisors, reverse=True) and divisors[0] == 8 and divisors[-1] == 1
    assert seen[0] == (8, (60, 80)) and seen[-1] == (1, (480, 640))


def test_moving_an_object_sends_its_transform_alone(skytree, viewport):
    scene, renderer = viewport
    before = renderer.pixels().copy()
    with Updates(renderer) as updates:
        uploads(renderer)
        meshes = renderer.sync.scene.stats["meshes_built"]
        bpy.data.objects["Sphere"].location.x += 0.5
        updates.now()
        assert uploads(renderer) == {"transforms": 1}
    finish(renderer)
    assert renderer.sync.scene.stats["meshes_built"] == meshes
    assert np.abs(renderer.pixels() - before).max() > 0.05


def test_world_rotation_and_strength_build_nothing(skytree, viewport):
    scene, renderer = viewport
    nodes = scene.world.node_tree.nodes
    mapping = next(n for n in nodes if n.type == "MAPPING")
    background = next(n for n in nodes if n.type == "BACKGROUND")
    with Updates(renderer) as updates:
        uploads(renderer)
        before = builds(skytree)
        for step in range(5):
            mapping.inputs["Rotation"].default_value[2] = 0.1 * step + 0.05
            updates.now()
            background.inputs["Strength"].default_value = 1.0 + 0.1 * step
            updates.now()
            finish(renderer)
        sent = uploads(renderer)
    assert builds(skytree) == before
    assert set(sent) == {"environments"} and sent["environments"] >= 5


def test_edit_mode_shows_what_is_edited(skytree, viewport):
    """Also an edit that is not written into the mesh yet."""
    scene, renderer = viewport
    before = renderer.pixels().copy()
    ob = bpy.data.objects["Sphere"]
    bpy.context.view_layer.objects.active = ob
    with Updates(renderer) as updates:
        bpy.ops.object.mode_set(mode="EDIT")
        updates.now()
        finish(renderer)
        np.testing.assert_allclose(renderer.pixels(), before, atol=0.02)
        edited = bmesh.from_edit_mesh(ob.data)
        bmesh.ops.scale(edited, vec=(0.5, 0.5, 0.5), verts=edited.verts)
        bmesh.update_edit_mesh(ob.data)
        updates.now()
        finish(renderer)
        assert np.abs(renderer.pixels() - before).max() > 0.05
        bpy.ops.object.mode_set(mode="OBJECT")
        updates.now()
        finish(renderer)


def test_nothing_is_restarted_for_what_is_not_seen(skytree, viewport):
    scene, renderer = viewport
    picture = renderer.picture
    with Updates(renderer) as updates:
        bpy.data.objects["Sphere"].select_set(True)
        scene.skytree.samples = 77
        scene.frame_end = 33
        updates.now()
    look(skytree, renderer)
    assert not renderer.busy and renderer.picture is picture


@pytest.mark.parametrize("sampler", ["INVERSION", "ALIAS", "UNIFORM"])
def test_sampler_is_built_on_a_thread(skytree, viewport, sampler):
    scene, renderer = viewport
    old = renderer.sync.built
    with Updates(renderer) as updates:
        scene.skytree.sampler = sampler
        updates.now()
        assert renderer.sync.built is old or renderer.sync.built.settings.sampler == sampler
        finish(renderer)
    assert renderer.sync.built.settings.sampler == sampler


def test_sampler_that_is_soon_there_is_taken_over_before_a_redraw(skytree, viewport, monkeypatch):
    scene, renderer = viewport
    module = part(skytree, "sync.scene")
    waits, wait = [], module.wait

    def until_done(futures, seconds):
        waits.append(seconds)
        return wait(futures)

    monkeypatch.setattr(module, "wait", until_done)
    with Updates(renderer) as updates:
        scene.skytree.sampler = "INVERSION"
        updates.now()
    assert not renderer.sync.awaits_sampler
    assert renderer.sync.built.settings.sampler == "INVERSION"
    assert all(0.0 <= seconds <= 0.02 for seconds in waits)  # none where it was there at once
    finish(renderer)
    # A second view that wants the same sampler does not wait once more.
    awaited = part(skytree, "environments").FutureEnvironment()
    awaited.asked -= 1.0
    awaited.set_result(renderer.sync.built)
    renderer.sync._awaited = renderer.sync.environment, awaited
    renderer.sync.wait_since_asked(100.0)
    renderer.sync.wait_since_asked(0.5)
    assert 0.0 < waits[-2] <= 99.0 and waits[-1] == 0.0


def test_block_count_follows_the_last_value(skytree, viewport):
    scene, renderer = viewport
    with Updates(renderer) as updates:
        for count in (16, 64, 77, 300):
            scene.skytree.block_count = count
            updates.now()
        finish(renderer)
    assert renderer.sync.built.sampler.block_count == 300


def test_every_setting_shows_a_new_picture(skytree, viewport):
    scene, renderer = viewport
    changes = {
        "max_bounces": 1,
        "seed": 3,
        "filter_width": 3.0,
        "light_rays": 1,
        "control_variate": False,
        "product_sampling": False,
        "pixel_filter": "BOX",
        "sampler": "INVERSION",
        "preview_samples": 6,
    }
    with Updates(renderer) as updates:
        for name, value in changes.items():
            picture = renderer.picture
            setattr(scene.skytree, name, value)
            updates.now()
            look(skytree, renderer)
            finish(renderer)
            assert renderer.picture is not picture, name
            assert not np.array_equal(renderer.pixels(), picture.pixels), name


def test_film_transparent(skytree, viewport):
    scene, renderer = viewport
    scene.camera.rotation_euler.x = math.radians(90.0)
    bpy.context.view_layer.update()
    look(skytree, renderer)
    finish(renderer)
    assert (renderer.pixels()[..., 3] > 0.999).all()
    scene.render.film_transparent = True
    look(skytree, renderer)
    finish(renderer)
    alpha = renderer.pixels()[..., 3]
    assert alpha[-1].max() == 0.0 and alpha[0].min() > 0.999


def test_border_renders_those_pixels_alone(skytree, viewport):
    _, renderer = viewport
    whole = renderer.pixels().copy()
    look(skytree, renderer, view_through_camera(skytree, border=(10, 20, 50, 60)))
    finish(renderer)
    np.testing.assert_array_equal(renderer.pixels(), whole[20:60, 10:50])


def test_moving_view_always_gets_pictures(skytree, viewport):
    """Views that change faster than a picture is made must not starve it."""
    scene, renderer = viewport
    shown, picture = 0, renderer.picture
    for i in range(60):
        scene.camera.rotation_euler.z = 0.01 * i
        bpy.context.view_layer.update()
        look(skytree, renderer, view_through_camera(skytree, 800, 600))
        renderer.wait_for_picture()
        if renderer.picture is not picture:
            shown, picture = shown + 1, renderer.picture
    assert shown > 10
    finish(renderer)
    assert renderer.picture.view == view_through_camera(skytree, 800, 600)


def test_render_thread_without_memory_is_a_message(skytree, viewport):
    """A render thread that fails leaves a message and the last picture; the next change starts again."""
    scene, renderer = viewport
    start, picture = renderer._start, renderer.picture

    def starved(divisor):
        with scenes.short_of_memory(48):  # the tree of a million triangles takes more
            start(divisor)
            assert renderer.session.wait(60.0)

    with Updates(renderer) as updates:
        grid = scenes.million_triangles(scene)
        renderer._start = starved
        updates.now()
        renderer.advance()
        assert "memory" in renderer.problem, renderer.problem
        assert renderer.problem in renderer.status_line()
        assert renderer.picture is picture and not renderer.busy
        renderer._start = start
        bpy.data.objects.remove(grid)
        updates.now()
    finish(renderer)
    np.testing.assert_array_equal(renderer.pixels(), picture.pixels)


def test_native_error_is_a_message(skytree, viewport):
    _, renderer = viewport
    singular = part(skytree, "viewport.view").View((0.0,) * 16, (0.0,) * 16, 20, 20)
    look(skytree, renderer, singular)
    for _ in range(50):
        renderer.advance()
        time.sleep(0.002)
    assert renderer.problem and not renderer.busy
    look(skytree, renderer)
    finish(renderer)


def test_closing_gives_everything_back(skytree, viewport):
    scene, renderer = viewport
    native_scene = weakref.ref(renderer.sync)
    session = renderer.session
    look(skytree, renderer, view_through_camera(skytree, 1200, 900))
    renderer.close()
    gc.collect()
    assert native_scene() is None and not session.running
    assert renderer not in part(skytree, "viewport.renderer").alive
    assert not renderer.busy and renderer.advance() is False


def resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def test_500_updates_leak_nothing(skytree, viewport):
    scene, renderer = viewport
    ob = bpy.data.objects["Sphere"]
    mapping = next(n for n in scene.world.node_tree.nodes if n.type == "MAPPING")
    material = bpy.data.materials["Clay"]
    shader = scenes.shader_node(material)

    def change(i):
        ob.location.x = math.sin(i)
        if i % 5 == 0:
            mapping.inputs["Rotation"].default_value[2] = 0.01 * i
        if i % 7 == 0:
            scenes.set_input(shader, "Color", (0.5 + 0.001 * (i % 500), 0.4, 0.2))
        if i % 11 == 0:
            ob.data.vertices[0].co.z += 0.001
            ob.data.update()
        if i % 50 == 0:
            scene.skytree.block_count = 100 + i
        updates.now()
        look(skytree, renderer, view_through_camera(skytree, WIDTH + i % 3, HEIGHT))
        renderer.wait_for_picture()

    with Updates(renderer) as updates:
        for count in range(part(skytree, "environments").MAX_SAMPLERS):
            # As many as are kept, each with its tables for product sampling, which its first picture makes.
            scene.skytree.block_count = 50 + count
            updates.now()
            finish(renderer)
        for i in range(100):
            change(i)
        gc.collect()
        before = resident_bytes()
        native = renderer.sync.scene.stats["nbytes"]
        for i in range(100, 600):
            change(i)
        finish(renderer)
        gc.collect()
    grown = resident_bytes() - before
    print(f"500 updates: {grown / 1e6:.2f} MB more")
    assert renderer.sync.scene.stats["nbytes"] == native
    # A leaked picture, map or mesh each time would be at least 500 x 70 KB.
    assert grown < 16e6


def test_main_thread_stays_responsive(skytree, scene):
    """Prints how long calls of the main thread take with a million triangles and a 4096 x 2048 map."""
    plane, mapping = scenes.large_scene(scene)
    scene.skytree.preview_samples = 2

    module = part(skytree, "viewport.renderer")
    renderer = module.ViewportRenderer()
    calls: dict[str, list[float]] = {}

    def timed(name, function, *arguments):
        # Processor time of this thread, and what it waited: other programs do not count.
        start, wall = time.thread_time(), time.perf_counter()
        function(*arguments)
        calls.setdefault(name, []).append(1000 * max(time.thread_time() - start, 0.0))
        calls.setdefault(name + " (clock)", []).append(1000 * (time.perf_counter() - wall))

    bpy.context.view_layer.update()
    try:
        timed("first sync", renderer.update, bpy.context.evaluated_depsgraph_get())
        look(skytree, renderer, view_through_camera(skytree, 640, 480))
        finish(renderer)

        def on_update(_, depsgraph):
            timed("update", renderer.update, depsgraph)

        bpy.context.view_layer.update()
        bpy.app.handlers.depsgraph_update_post.append(on_update)
        try:
            for step in range(12):
                plane.location.x = 0.01 * step
                mapping.inputs["Rotation"].default_value[2] = 0.02 * step
                if step % 4 == 0:
                    scene.skytree.block_count = 500 + step
                bpy.context.view_layer.update()
                asked = time.perf_counter()
                old = renderer.sync.built
                view = view_through_camera(skytree, 640 + step, 480)
                timed("look", renderer.look, view, module.RenderSettings.of(scene))
                timed("wait", renderer.wait_for_picture)
                picture = renderer.picture
                while renderer.busy and (renderer.picture is picture or renderer.sync.awaits_sampler):
                    timed("advance", renderer.advance)
                    time.sleep(0.002)
                if renderer.sync.built is not old:
                    calls.setdefault("new sampler to new picture (clock)", []).append(
                        1000 * (time.perf_counter() - asked)
                    )
        finally:
            bpy.app.handlers.depsgraph_update_post.remove(on_update)
        assert renderer.problem == ""
    finally:
        renderer.close()
    for name, milliseconds in calls.items():
        print(f"{name}: {len(milliseconds)} calls, median {np.median(milliseconds):.1f} ms, "
              f"longest {max(milliseconds):.1f} ms")  # fmt: skip


def test_a_renderer_is_closed_when_blender_has_freed_its_engine(scene, skytree, monkeypatch):
    """Blender 5.2 refuses access to an engine's attributes once it has freed its own side of it."""

    class Renderer:
        closed = False

        def close(self):
            self.closed = True

    renderer, engines = Renderer(), []

    def render(engine, depsgraph):
        engine._renderer = renderer
        engines.append(engine)  # the Python object outlives the render

    monkeypatch.setattr(scenes.part(skytree, "engine").SkytreeRenderEngine, "render", render)
    scene.render.engine = "SKYTREE"
    bpy.ops.render.render(scene=scene.name)
    assert engines and not renderer.closed
    engines.clear()
    gc.collect()
    assert renderer.closed
