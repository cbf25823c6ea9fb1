# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene and RenderSession from Python: shapes, messages, threads and the GIL."""

import threading
import time

import numpy as np
import pytest
import skytree_core

PERSPECTIVE = np.array([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, -1.0002, -0.20002], [0, 0, -1, 0]], float)
ABOVE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]], float)
SQUARE = np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], np.float32)
TWO_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def make_scene(closures=({"type": "DIFFUSE", "color": (0.5, 0.5, 0.5)},), flat=False, **mesh_arrays):
    scene = skytree_core.Scene(flat=flat)
    material = scene.add_material(list(closures), name="floor")
    mesh = scene.add_mesh(SQUARE, TWO_TRIANGLES, name="Floor", **mesh_arrays)
    scene.add_instance(mesh, np.eye(4), [material])
    scene.set_camera(ABOVE, PERSPECTIVE)
    scene.set_environment(None, None)
    return scene


def render(scene, width=20, height=20, samples=64, **settings):
    session = skytree_core.RenderSession(threads=2)
    session.start(scene, width, height, samples, **settings)
    assert session.wait(600)
    assert session.error is None
    return session.pixels()


def test_floor_under_constant_light_shows_its_albedo():
    pixels = render(make_scene(), max_bounces=0)
    assert pixels.shape == (20, 20, 4) and pixels.dtype == np.float32
    np.testing.assert_allclose(pixels[..., :3], 0.5, rtol=0.02)
    np.testing.assert_allclose(pixels[..., :3].mean(), 0.5, rtol=1e-3)
    assert (pixels[..., 3] == 1).all()


def test_pixels_fill_the_array_given():
    session = skytree_core.RenderSession(threads=1)
    session.start(make_scene(), 8, 6, 2, region=(1, 2, 5, 6))
    assert session.wait(600)
    out = np.zeros((4, 4, 4), np.float32)
    assert session.pixels(out) is out
    assert (out[..., 3] == 1).all()
    with pytest.raises(ValueError, match=r"\(4, 4, 4\)"):
        session.pixels(np.zeros((6, 8, 4), np.float32))


def test_texture_is_seen_upright_through_uvs():
    image = np.zeros((2, 2, 3), np.float32)
    image[0, 0] = (1, 0, 0)  # top left
    image[1, 1] = (0, 0, 1)  # bottom right
    scene = make_scene()
    texture = scene.add_texture(image, interpolation="CLOSEST")
    uvs = ((SQUARE[TWO_TRIANGLES].reshape(-1, 3)[:, :2] + 9) / 18).astype(np.float32)
    mesh = scene.add_mesh(SQUARE, TWO_TRIANGLES, corner_uvs=uvs)
    material = scene.add_material([{"type": "DIFFUSE", "color_texture": texture}])
    scene.add_instance(mesh, ABOVE - 4.9 * np.outer([0, 0, 1, 0], [0, 0, 0, 1]), [material])
    pixels = render(scene, max_bounces=0)
    np.testing.assert_allclose(pixels[-1, 0, :3], (1, 0, 0), atol=0.02)
    np.testing.assert_allclose(pixels[0, -1, :3], (0, 0, 1), atol=0.02)


def test_material_slots_and_corners_index_as_documented():
    scene = skytree_core.Scene()
    red = scene.add_material([{"type": "EMISSION", "color": (1, 0, 0)}])
    blue = scene.add_material([{"type": "EMISSION", "color": (0, 0, 1), "strength": 2.0}])
    mesh = scene.add_mesh(
        SQUARE,
        TWO_TRIANGLES,
        material_slots=np.array([1, 0], np.int32),
        corners=TWO_TRIANGLES,
        corner_normals=np.tile(np.float32([0, 0, 1]), (4, 1)),
    )
    instance = scene.add_instance(mesh, np.eye(4), [red, blue])
    scene.set_camera(ABOVE, PERSPECTIVE)
    scene.set_environment(None, color=(0, 0, 0))
    pixels = render(scene, samples=1, pixel_filter="BOX")
    np.testing.assert_array_equal(pixels[0, -1, :3], (0, 0, 2))
    np.testing.assert_array_equal(pixels[-1, 0, :3], (1, 0, 0))
    scene.set_instance_materials(instance, [red])
    # A slot too few: the last one there is.
    np.testing.assert_array_equal(render(scene, samples=1)[0, -1, :3], (1, 0, 0))


@pytest.mark.parametrize(
    ("closure", "message"),
    [
        ({}, "needs a type"),
        ({"type": "GLASS"}, "GLASS"),
        ({"type": "DIFFUSE", "colour": (1, 1, 1)}, "colour"),
        ({"type": "GLOSSY", "roughness": float("nan")}, "roughness"),
        ({"type": "GLOSSY", "color": (1, 1)}, "three numbers"),
        ({"type": "WARD", "alpha_x": "wide"}, "alpha_x"),
    ],
)
def test_bad_closures_are_named(closure, message):
    with pytest.raises(ValueError, match=message):
        skytree_core.Scene().add_material([closure])


def test_bad_shapes_and_names_are_refused():
    scene = make_scene()
    with pytest.raises(ValueError, match=r"positions must have shape \(n, 3\)"):
        scene.add_mesh(SQUARE[:, :2], TWO_TRIANGLES)
    with pytest.raises(ValueError, match="material_slots"):
        scene.add_mesh(SQUARE, TWO_TRIANGLES, material_slots=np.zeros(3, np.int32))
    with pytest.raises(ValueError, match=r"\(4, 4\)"):
        scene.add_instance(0, np.eye(3))
    with pytest.raises(ValueError, match="no mesh 7"):
        scene.add_instance(7, np.eye(4))
    with pytest.raises(ValueError, match="rotation"):
        scene.set_environment(None, None, world_to_env=2 * np.eye(3))
    with pytest.raises(ValueError, match="singular"):
        scene.set_camera(np.diag([1.0, 1.0, 0.0, 1.0]), PERSPECTIVE)
    session = skytree_core.RenderSession()
    with pytest.raises(ValueError, match="TRIANGLE.*BLACKMAN_HARRIS"):
        session.start(scene, 8, 8, 1, pixel_filter="TRIANGLE")
    with pytest.raises(ValueError, match="region"):
        session.start(scene, 8, 8, 1, region=(4, 0, 4, 8))


def test_python_runs_while_native_threads_render():
    scene = make_scene()
    session = skytree_core.RenderSession(threads=2)
    session.start(scene, 64, 64, 1 << 30)
    with pytest.raises(RuntimeError, match="cancel"):
        scene.set_transform(0, np.eye(4))
    ticks = 0

    def wait():
        session.wait(0.5)

    waiter = threading.Thread(target=wait)
    waiter.start()
    while waiter.is_alive():  # counts only if wait() lets go of the GIL
        ticks += 1
        time.sleep(0.001)
    assert ticks > 20
    session.cancel()
    assert not session.running and session.samples_done > 0
    scene.set_transform(0, np.eye(4))
    assert {"rays", "seconds", "cpu_seconds", "commit_seconds"} <= set(session.stats)


def test_environment_image_outlives_its_array():
    image = np.full((4, 8, 3), 2.0, np.float32)
    scene = make_scene()
    scene.set_environment(image, skytree_core.KdTreeSampler(image, block_count=4))
    del image
    np.testing.assert_allclose(render(scene, max_bounces=0)[..., :3].mean(), 1.0, rtol=0.01)
    scene.set_environment(None)
    assert scene.stats["environments_set"] == 3


def test_changes_of_a_light_rebuild_nothing():
    scene = make_scene()
    render(scene, samples=1)
    before = scene.stats
    for turn in (0.3, 0.6):
        c, s = np.cos(turn), np.sin(turn)
        scene.set_environment(None, None, world_to_env=[[c, -s, 0], [s, c, 0], [0, 0, 1]], color=(turn, 1, 1))
        render(scene, samples=1)
    assert scene.stats["meshes_built"] == before["meshes_built"] == 1
    assert scene.stats["top_level_built"] == before["top_level_built"] == 1


def test_flat_scene_needs_no_trees_of_meshes():
    scene = make_scene(flat=True)
    np.testing.assert_allclose(render(scene, max_bounces=0)[..., :3].mean(), 0.5, rtol=1e-3)
    assert scene.stats["meshes_built"] == 0
    assert scene.stats["top_level_built"] == 1
