# SPDX-License-Identifier: GPL-3.0-or-later
"""A report made in the background, and comparisons on the scene's device."""

import json
import threading
import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import scenes
from scenes import Updates, part

WIDTH, HEIGHT = 48, 32


@pytest.fixture
def lit(scene):
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.skytree.max_bounces = 1
    scenes.demo_objects(scene)
    for mesh in bpy.data.meshes:
        # Blender 3.4 adds up smooth normals in the order in which its threads come: their last bits vary.
        mesh.polygons.foreach_set("use_smooth", [False] * len(mesh.polygons))
    scenes.set_map(scene, scenes.float_image("smooth", scenes.smooth_map()))
    compared = scene.skytree_compare
    compared.a.method, compared.b.method, compared.samples = "KDTREE", "UNIFORM", 8
    compared.reference_samples = 32
    return scene


@pytest.fixture
def background(skytree):
    module = part(skytree, "compare.background")
    yield module
    module.stop()
    module.forget()


def start(skytree, background, scene, folder):
    report = background.start(part(skytree, "compare.job").ReportJob(scene), folder)
    bpy.app.timers.unregister(background._tick)  # the tests are the clock
    return report


def finish(report, seconds: float = 120.0):
    end = time.perf_counter() + seconds
    while not report.done:
        report.advance()
        assert time.perf_counter() < end, "the report does not come to an end"
        time.sleep(0.01)


def test_the_background_writes_what_a_script_writes(skytree, background, lit, tmp_path, monkeypatch):
    monkeypatch.setattr(part(skytree, "viewport.display"), "BAND_PIXELS", 5 * WIDTH)
    report = start(skytree, background, lit, tmp_path / "background")
    finish(report)
    assert report.problem == "" and report.page == tmp_path / "background" / "report.html"
    assert len(report.summary()) == 2
    assert bpy.ops.skytree.compare_report(folder=str(tmp_path / "script")) == {"FINISHED"}
    for name in ("a.png", "reference.png", "difference_ab.png", "comparison.exr"):
        written = [(tmp_path / folder / name).read_bytes() for folder in ("background", "script")]
        assert written[0] == written[1], name


def test_pictures_are_shown_in_bands_through_one_view(skytree, background, lit, tmp_path, monkeypatch):
    """A change of the view transform in between counts for all of them."""
    monkeypatch.setattr(part(skytree, "viewport.display"), "BAND_PIXELS", 5 * WIDTH)
    report = start(skytree, background, lit, tmp_path / "background")
    calls = 0
    end = time.perf_counter() + 120.0
    while not report.done and time.perf_counter() < end:
        report.advance()
        calls += report.is_showing
        if calls == 4:
            lit.view_settings.gamma = 2.0
        time.sleep(0.005)
    assert report.done and report.problem == ""
    # Four in vain, and then all, after the last of which there is none to show.
    assert calls == 4 + 3 * -(-HEIGHT // 5) - 1
    assert bpy.ops.skytree.compare_report(folder=str(tmp_path / "script")) == {"FINISHED"}
    for name in ("a.png", "b.png", "reference.png"):
        written = [(tmp_path / folder / name).read_bytes() for folder in ("background", "script")]
        assert written[0] == written[1], name


def test_progress_and_edits_meanwhile(skytree, background, lit, tmp_path):
    """The main thread is free: the scene may be changed, and the report shows it as it was."""
    lit.skytree_compare.reference_samples = 2048
    longest = 0.0
    report = start(skytree, background, lit, tmp_path / "edited")
    told = set()
    while not report.done:
        started = time.perf_counter()
        report.advance()
        longest = max(longest, time.perf_counter() - started)
        told.add(report.progress.text)
        bpy.data.objects["Sphere"].location.z += 0.1
        bpy.context.view_layer.update()
        time.sleep(0.005)
    assert report.problem == ""
    assert {"reference", "writing the report"} <= told
    print(f"longest call of the main thread while a report is made: {1000 * longest:.0f} ms")
    bpy.data.objects["Sphere"].location.z = 1.0
    assert bpy.ops.skytree.compare_report(folder=str(tmp_path / "before")) == {"FINISHED"}
    assert (tmp_path / "edited" / "a.png").read_bytes() == (tmp_path / "before" / "a.png").read_bytes()


def test_cancelling_leaves_no_thread(skytree, background, lit, tmp_path):
    lit.skytree_compare.reference_samples = 1 << 20
    report = start(skytree, background, lit, tmp_path / "cancelled")
    time.sleep(0.1)
    report.advance()
    assert not report.done and 0.0 <= report.progress.fraction < 1.0
    assert bpy.ops.skytree.cancel_report.poll() and not bpy.ops.skytree.compare_report.poll()
    assert bpy.ops.skytree.cancel_report() == {"FINISHED"}
    finish(report, 20.0)
    assert report.problem == "The comparison was cancelled" and report.page is None
    assert not any(thread.name == "Skytree report" for thread in threading.enumerate())
    assert bpy.ops.skytree.compare_report.poll() and not (tmp_path / "cancelled").exists()


def test_a_report_that_cannot_be_written(skytree, background, lit, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    report = start(skytree, background, lit, blocked)
    finish(report)
    assert "failed" in report.problem and "file" in report.problem


def test_loading_a_file_ends_the_report(skytree, background, lit, tmp_path):
    lit.skytree_compare.reference_samples = 1 << 20
    start(skytree, background, lit, tmp_path / "loaded")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert background.current() is None
    assert not any(thread.name == "Skytree report" for thread in threading.enumerate())


# Devices


def test_a_report_renders_on_the_scenes_device(skytree, lit, tmp_path):
    """The same pictures as on the CPU within rounding; where there is no GPU the report says so."""
    lit.skytree_compare.samples, lit.skytree_compare.reference_samples = 2, 4
    documents = {}
    for device in ("CPU", "CUDA"):
        lit.skytree.device = device
        assert bpy.ops.skytree.compare_report(folder=str(tmp_path / device)) == {"FINISHED"}
        documents[device] = json.loads((tmp_path / device / "report.json").read_text())
    assert documents["CPU"]["machine"]["device"] == "CPU"
    told = documents["CUDA"]["machine"]["device"]
    if part(skytree, "devices").cuda_problem():
        assert "CPU" in told and any("The CPU finishes" in note for note in documents["CUDA"]["notes"])
    else:
        assert told != "CPU" and not any("The CPU finishes" in note for note in documents["CUDA"]["notes"])
    for side in "ab":
        cpu, gpu = (documents[d]["results"][side]["errors"] for d in ("CPU", "CUDA"))
        assert gpu["nrmse_tc"] == pytest.approx(cpu["nrmse_tc"], rel=2e-2)
        assert gpu["rmse"] == pytest.approx(cpu["rmse"], rel=2e-2)
        assert documents["CUDA"]["times"][side][-1]["device_seconds"] > 0.0


@pytest.fixture
def compared_view(skytree, lit):
    """A CompareView of two samples: `look` shows the scene as it is, `fresh` does in another view; both
    return the pictures of the two sides."""
    lit.skytree_compare.samples = 2
    renderer = part(skytree, "viewport.renderer").ViewportRenderer()
    renderer.update(bpy.context.evaluated_depsgraph_get())
    module = part(skytree, "compare.view")
    view = module.CompareView(renderer)

    def look_until_complete(view=view):
        view.look(module.Request.of(camera_view(skytree, lit), lit))
        end = time.perf_counter() + 120.0
        while view.busy:
            assert time.perf_counter() < end, "the comparison does not come to an end"
            renderer.advance()
            view.advance()
            time.sleep(0.002)
        assert view.problem == ""
        return tuple(view.sides[name].picture for name in "ab")

    def fresh():
        other = module.CompareView(renderer)
        try:
            return look_until_complete(other)
        finally:
            other.close()

    yield SimpleNamespace(look=look_until_complete, fresh=fresh, renderer=renderer, view=view)
    view.close()
    renderer.close()


def test_a_side_that_is_not_changed_keeps_its_picture(compared_view, lit):
    look, fresh, compared = compared_view.look, compared_view.fresh, lit.skytree_compare
    a, b = look()
    for settings in ({"method": "ALIAS"}, {"method": "KDTREE", "block_count": 77}):
        for name, value in settings.items():
            setattr(compared.a, name, value)
        new_a, new_b = look()
        assert new_a is not a and new_b is b
        for shown, expected in zip((new_a, new_b), fresh(), strict=True):
            np.testing.assert_array_equal(shown.pixels, expected.pixels)
        a = new_a
    compared.b.method = "INVERSION"
    new_a, new_b = look()
    assert new_a is a and new_b is not b


def test_both_sides_follow_what_both_depend_on(compared_view, lit):
    look = compared_view.look
    before = look()
    lit.skytree_compare.samples = 3
    after = look()
    assert not set(map(id, before)) & set(map(id, after))
    lit.skytree_compare.a.method, before = "UNIFORM", after
    with Updates(compared_view.renderer) as updates:
        bpy.data.objects["Sphere"].location.z += 0.5
        updates.now()
    after = look()
    assert not set(map(id, before)) & set(map(id, after))
    # Two that are given equal time have to share the machine.
    lit.skytree_compare.clock, lit.skytree_compare.seconds = "TIME", 0.05
    before = look()
    lit.skytree_compare.a.method = "ALIAS"
    after = look()
    assert not set(map(id, before)) & set(map(id, after))


def test_samplers_are_asked_for_before_anything_is_drawn(skytree, compared_view, lit):
    module, view = part(skytree, "compare.region"), compared_view.view
    region = SimpleNamespace(as_pointer=lambda: 1)
    context = SimpleNamespace(region=region, scene=lit)
    lit.skytree_compare.mode = "SPLIT"
    _, b = compared_view.look()
    module._views[1] = view
    try:
        lit.skytree_compare.a.block_count = 123
        module.follow(compared_view.renderer, context)
        assert view.sides["a"].sampler.result(timeout=60.0).settings.block_count == 123
        assert view.busy and view.sides["b"].picture is b
        compared_view.look()
        lit.skytree_compare.a.block_count = 124
        lit.skytree_compare.mode = "OFF"
        module.follow(compared_view.renderer, context)
        assert not view.busy
    finally:
        del module._views[1]


def test_a_view_compares_on_the_scenes_device(skytree, lit):
    renderer = part(skytree, "viewport.renderer").ViewportRenderer()
    view_module = part(skytree, "compare.view")
    try:
        renderer.update(bpy.context.evaluated_depsgraph_get())
        pictures, sessions = {}, {}
        for device in ("CPU", "CUDA"):
            lit.skytree.device = device
            lit.skytree_compare.samples = 2
            view = view_module.CompareView(renderer)
            seen = camera_view(skytree, lit)
            view.look(view_module.Request.of(seen, lit))
            end = time.perf_counter() + 120.0
            while view.busy and time.perf_counter() < end:
                renderer.advance()
                view.advance()
                time.sleep(0.002)
            assert view.problem == "" and not view.busy
            pictures[device] = [view.sides[side].picture.pixels.copy() for side in "ab"]
            sessions[device] = view.sides["a"].session.stats["device"]
            view.close()
        for cpu, gpu in zip(pictures["CPU"], pictures["CUDA"], strict=True):
            np.testing.assert_allclose(gpu, cpu, rtol=2e-3, atol=1e-4)
        if not part(skytree, "devices").cuda_problem():
            assert sessions["CUDA"] != sessions["CPU"]
    finally:
        renderer.close()


def camera_view(skytree, scene):
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    projection = scene.camera.calc_matrix_camera(depsgraph, x=WIDTH, y=HEIGHT)
    flat = [tuple(v for row in m for v in row) for m in (scene.camera.matrix_world, projection)]
    return part(skytree, "viewport.view").View(*flat, WIDTH, HEIGHT)
