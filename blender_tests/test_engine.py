# SPDX-License-Identifier: GPL-3.0-or-later
"""A final render as a user or a farm meets it: statistics, determinism, threads, layers, animation,
cancelling."""

import time

import bpy
import numpy as np
import pytest
import scenes


@pytest.fixture
def lit(scene):
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled("sunset"))
    return scene


def test_leaves_statistics(lit):
    bpy.app.driver_namespace.pop("peer_stats", None)
    scenes.render_skytree(lit, 4)
    stats = bpy.app.driver_namespace["peer_stats"]
    assert set(stats) >= {"render_s", "sync_s"}
    assert stats["render_s"] > 0.0 and stats["sync_s"] > 0.0


def test_same_seed_same_picture_for_any_threads(lit):
    pictures = []
    for mode, threads in (("AUTO", 1), ("FIXED", 1), ("FIXED", 3)):
        lit.render.threads_mode = mode
        if mode == "FIXED":
            lit.render.threads = threads
        pictures.append(scenes.render_skytree(lit, 8, seed=5))
    scenes.assert_same_picture(pictures[0], pictures[1])
    scenes.assert_same_picture(pictures[0], pictures[2])
    assert not np.array_equal(pictures[0], scenes.render_skytree(lit, 8, seed=6))


def test_more_samples_less_noise(lit):
    def noise(samples):
        a, b = (scenes.render_skytree(lit, samples, seed=seed) for seed in (1, 2))
        return np.median(np.abs(a - b)[..., :3])

    assert noise(64) < 0.6 * noise(8)


def test_multi_jittered_points_where_every_pixel_takes_as_many_samples(lit):
    settings = lit.skytree
    for settings.adaptive_sampling in (True, False):
        pictures = []
        for settings.point_set in ("SOBOL", "CMJ"):
            pictures.append(scenes.render_skytree(lit, 8))
        assert (np.abs(pictures[0] - pictures[1]).mean() < 1e-4) == settings.adaptive_sampling
    assert pictures[0][..., :3].mean() == pytest.approx(pictures[1][..., :3].mean(), rel=0.02)


def test_film_transparent(lit):
    opaque = scenes.render_skytree(lit, 4)
    assert (opaque[..., 3] == 1.0).all()
    lit.render.film_transparent = True
    picture = scenes.render_skytree(lit, 4)
    assert picture[-1, :, 3].min() == 0.0 and picture[0, :, 3].min() == 1.0


def test_max_bounces_adds_light(lit):
    direct = scenes.render_skytree(lit, 64, max_bounces=0)
    indirect = scenes.render_skytree(lit, 64, max_bounces=4)
    assert indirect[..., :3].mean() > 1.02 * direct[..., :3].mean()


@pytest.mark.parametrize(("bounces", "rays"), [(0, 4), (1, 2)])
def test_light_rays_are_as_many_as_pay(lit, bounces, rays):
    pictures = {
        n: scenes.render_skytree(lit, 4, seed=3, max_bounces=bounces, light_rays=n, adaptive_sampling=False)
        for n in (0, rays, 3)
    }
    scenes.assert_same_picture(pictures[0], pictures[rays])
    assert not np.allclose(pictures[0], pictures[3], atol=1e-4)


def test_wider_filter_blurs(lit):
    # So many samples that the noise of drawing points from so wide a filter is below what it blurs.
    sharp = scenes.render_skytree(lit, 1024, pixel_filter="BOX")
    soft = scenes.render_skytree(lit, 1024, pixel_filter="GAUSSIAN", filter_width=6.0)
    assert np.abs(np.diff(soft[..., 0], axis=1)).mean() < np.abs(np.diff(sharp[..., 0], axis=1)).mean()


def test_view_layers_are_rendered_apart(lit):
    """Each layer shows its own collections."""
    hidden = lit.view_layers.new("Empty")
    collection = bpy.data.collections.new("Things")
    lit.collection.children.link(collection)
    for ob in [ob for ob in lit.collection.objects if ob.type == "MESH"]:
        lit.collection.objects.unlink(ob)
        collection.objects.link(ob)
    hidden.layer_collection.children["Things"].exclude = True
    lit.render.film_transparent = True
    lit.view_layers[0].use = False
    assert scenes.render_skytree(lit, 1)[..., 3].max() == 0.0
    lit.view_layers[0].use, hidden.use = True, False
    assert scenes.render_skytree(lit, 1)[..., 3].max() == 1.0


def test_animation_renders_each_frame(lit, tmp_path):
    sphere = next(ob for ob in lit.objects if ob.name.startswith("Sphere"))
    for frame, height in ((1, 1.0), (2, 50.0)):
        sphere.location.z = height
        sphere.keyframe_insert("location", frame=frame)
    lit.frame_start, lit.frame_end = 1, 2
    lit.skytree.samples = 4
    lit.render.filepath = str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True)
    first, second = (scenes.read(tmp_path / f"frame_000{i}.exr") for i in (1, 2))
    assert np.abs(first - second).max() > 0.05


def test_resolution_percentage(lit):
    lit.render.resolution_percentage = 50
    assert scenes.render_skytree(lit, 1).shape == (24, 32, 4)


def test_cuda_without_a_gpu_renders_on_the_cpu_and_says_so(lit, skytree):
    native = scenes.part(skytree, "native")
    if any(device.type == "CUDA" for device in native.core().devices()):
        pytest.skip("this machine has a CUDA device")
    cpu = scenes.render_skytree(lit, 4)
    picture = scenes.render_skytree(lit, 4, device="CUDA")
    scenes.assert_same_picture(picture, cpu)
    assert "NVIDIA" in scenes.messages(skytree)


def test_lamps_are_named(lit, skytree):
    lamp = bpy.data.objects.new("Key Light", bpy.data.lights.new("Key Light", "SUN"))
    lit.collection.objects.link(lamp)
    scenes.render_skytree(lit, 1)
    assert "Key Light" in scenes.messages(skytree)


def test_cancel_keeps_what_is_there(lit, skytree, monkeypatch):
    """Esc ends a long render at once, with a picture."""
    engine = scenes.part(skytree, "engine").SkytreeRenderEngine
    started = time.perf_counter()
    # Not test_break itself: Blender finds its own function before ours.
    monkeypatch.setattr(engine, "_is_cancelled", lambda self: time.perf_counter() - started > 1.0)
    lit.render.film_transparent = True
    picture = scenes.render_skytree(lit, 1 << 20)
    assert time.perf_counter() - started < 60.0  # a million samples would take hours
    assert picture[0, :, 3].min() == 1.0


def test_cancel_before_the_first_sample_leaves_a_blank_picture(lit, skytree, monkeypatch):
    engine = scenes.part(skytree, "engine").SkytreeRenderEngine
    monkeypatch.setattr(engine, "_is_cancelled", lambda self: True)
    assert scenes.render_skytree(lit, 1 << 20).shape == (48, 64, 4)


def test_progress_is_told(lit, skytree, monkeypatch):
    engine = scenes.part(skytree, "engine")
    told = []
    monkeypatch.setattr(engine, "POLL_SECONDS", 0.001)
    monkeypatch.setattr(
        engine.SkytreeRenderEngine, "_tell_progress", lambda self, done, samples: told.append((done, samples))
    )
    scenes.render_skytree(lit, 256)
    assert told == sorted(told) and told[-1] == (256, 256) and len(told) > 1
