# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is wrong is named with its cause, a picture comes out where one makes sense, and Blender lives
on."""

import os
import shutil

import bpy
import numpy as np
import pytest
import scenes


def problem(scene, skytree) -> str:
    """What a user is told by a render: Skytree's messages, and the operator's error if it raises one."""
    scenes.part(skytree, "status").last.messages.clear()
    try:
        scenes.render_skytree(scene, 2)
    except RuntimeError as error:
        return f"{error}\n{scenes.messages(skytree)}"
    return scenes.messages(skytree)


def lit(scene):
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled())


def assert_alive(scene):
    """A good scene renders afterwards."""
    fresh = scenes.new_scene()
    lit(fresh)
    assert scenes.render_skytree(fresh, 2)[..., :3].max() > 0.0


def test_no_camera(scene, skytree):
    lit(scene)
    scene.camera = None
    assert "camera" in problem(scene, skytree)
    assert_alive(scene)


def test_camera_that_is_no_camera(scene, skytree):
    lit(scene)
    scene.camera = next(ob for ob in scene.objects if ob.type == "MESH")
    assert "is no camera" in problem(scene, skytree)


def test_panoramic_camera(scene, skytree):
    lit(scene)
    scene.camera.data.type = "PANO"
    assert "Perspective or Orthographic" in problem(scene, skytree)


def test_singular_camera(scene, skytree):
    lit(scene)
    scene.camera.scale = (0.0, 1.0, 1.0)
    text = problem(scene, skytree)
    assert not text or "camera" in text.lower()


def test_empty_scene_shows_the_background(scene):
    scenes.set_map(scene, scenes.bundled())
    assert scenes.render_skytree(scene, 2)[..., :3].mean() > 0.01


def broken_mesh(scene, name, vertices, faces, **transform):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    ob = bpy.data.objects.new(name, mesh)
    for key, value in transform.items():
        setattr(ob, key, value)
    scene.collection.objects.link(ob)
    return ob


def test_empty_mesh_and_loose_edges(scene, skytree):
    lit(scene)
    broken_mesh(scene, "Nothing", [], [])
    broken_mesh(scene, "Points", [(0, 0, 0), (1, 0, 0)], [])
    assert scenes.render_skytree(scene, 2)[..., :3].mean() > 0.01
    assert '"Nothing" has no faces' in scenes.messages(skytree)


def test_vertices_that_are_no_numbers(scene, skytree):
    lit(scene)
    nan = float("nan")
    broken_mesh(scene, "Torn", [(0, 0, 0), (1, 0, 0), (0, 1, nan), (1, 1, 0)], [(0, 1, 2), (0, 1, 3)])
    broken_mesh(scene, "Far", [(0, 0, 0), (1, 0, 0), (0, 1, float("inf"))], [(0, 1, 2)])
    picture = scenes.render_skytree(scene, 2)
    assert np.isfinite(picture).all()
    assert "Torn" in scenes.messages(skytree)


def test_degenerate_triangles(scene):
    lit(scene)
    broken_mesh(scene, "Needle", [(0, 0, 0), (0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2), (0, 2, 3)])
    assert np.isfinite(scenes.render_skytree(scene, 2)).all()


@pytest.mark.parametrize("scale", [(0.0, 0.0, 0.0), (1.0, 0.0, 1.0), (1e30, 1e30, 1e30)])
def test_singular_and_huge_transforms(scene, scale):
    lit(scene)
    broken_mesh(scene, "Flat", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], scale=scale)
    assert np.isfinite(scenes.render_skytree(scene, 2)).all()


def test_missing_map(scene, skytree):
    lit(scene)
    texture = next(n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT")
    image = bpy.data.images.new("sky", 8, 4)
    image.source = "FILE"
    image.filepath = "/nonexistent/sky.exr"
    texture.image = image
    picture = scenes.render_skytree(scene, 2)
    assert "/nonexistent/sky.exr does not exist" in scenes.messages(skytree)
    assert picture[..., 0].max() > 0.0


def test_no_image_in_the_node(scene, skytree):
    lit(scene)
    next(n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT").image = None
    assert scenes.render_skytree(scene, 2)[..., 0].max() > 0.0
    assert "has no image" in scenes.messages(skytree)


def files(folder):
    truncated = folder / "truncated.exr"
    truncated.write_bytes((scenes.BUNDLED / "city.exr").read_bytes()[:20000])
    text = folder / "text.exr"
    text.write_text("this is no image")
    empty = folder / "empty.hdr"
    empty.write_bytes(b"")
    directory = folder / "directory.exr"
    directory.mkdir()
    return [truncated, text, empty, directory]


@pytest.mark.parametrize("index", range(4))
def test_files_that_are_no_maps(scene, skytree, tmp_path, index):
    lit(scene)
    path = files(tmp_path)[index]
    image = bpy.data.images.new("broken", 8, 4)
    image.source = "FILE"
    image.filepath = str(path)
    next(n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT").image = image
    picture = scenes.render_skytree(scene, 2)
    assert np.isfinite(picture).all()
    # A truncated file may be read as far as it goes; that is Blender's to say.
    assert index == 0 or path.name in scenes.messages(skytree)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_file_without_permission(scene, skytree, tmp_path):
    path = tmp_path / "secret.exr"
    shutil.copy(scenes.BUNDLED / "city.exr", path)
    path.chmod(0)
    lit(scene)
    image = bpy.data.images.new("secret", 8, 4)
    image.source, image.filepath = "FILE", str(path)
    next(n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT").image = image
    scenes.render_skytree(scene, 1)
    assert "permission" in scenes.messages(skytree)


def test_bad_texels_are_counted_and_kept_out(scene, skytree):
    pixels = np.full((16, 32, 3), 0.5, np.float32)
    pixels[3, 4] = np.nan
    pixels[5, 6] = np.inf
    pixels[7, 8] = -3.0
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.float_image("bad", pixels))
    picture = scenes.render_skytree(scene, 16)
    assert np.isfinite(picture).all() and picture.max() < 2.0
    assert any(word in scenes.messages(skytree) for word in ("negative", "not a number", "texels"))


@pytest.mark.parametrize("name", ["nan.exr", "inf.exr", "negative.exr"])
def test_bad_maps_from_files(scene, name):
    folder = scenes.shared_map("bad")
    found = sorted(p for p in folder.iterdir() if name.split(".")[0] in p.name.lower())
    if not found:
        pytest.skip(f"no map of that kind in {folder}")
    scenes.demo_objects(scene)
    scenes.set_map(scene, found[0])
    assert np.isfinite(scenes.render_skytree(scene, 4)).all()


def test_movie_is_refused_in_words(scene, skytree):
    lit(scene)
    image = bpy.data.images.new("clip", 8, 4)
    image.source, image.filepath = "MOVIE", "/nonexistent/clip.mp4"
    next(n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT").image = image
    scenes.render_skytree(scene, 1)
    assert "movie" in scenes.messages(skytree)


def test_failure_of_the_core_is_a_message(scene, skytree, monkeypatch):
    lit(scene)
    engine = scenes.part(skytree, "engine")

    class Broken:
        def __init__(self, *args, **kwargs):
            raise RuntimeError("the moon is too bright")

    monkeypatch.setattr(engine, "SceneSync", Broken)
    assert "the moon is too bright" in problem(scene, skytree)
    monkeypatch.undo()
    assert_alive(scene)


def test_extreme_settings(scene):
    lit(scene)
    for settings in (
        {"block_count": 1},
        {"block_count": 1 << 20},
        {"filter_width": 10.0},
        {"max_bounces": 64},
    ):
        assert np.isfinite(scenes.render_skytree(scene, 1, **settings)).all(), settings
