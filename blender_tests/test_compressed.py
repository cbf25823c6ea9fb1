# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds lit by a compressed map alone: from a file, from a .blend that carries it; a damaged file."""

import bpy
import numpy as np
import pytest
import scenes
from scenes import part


@pytest.fixture
def file(skytree, scene, tmp_path):
    """A compressed map of one of Blender's, written by the operator."""
    scenes.set_map(scene, scenes.bundled("city"))
    path = tmp_path / "city.skymap"
    assert bpy.ops.skytree.compress_hdri(filepath=str(path), kilobytes=8) == {"FINISHED"}
    assert 8000 < path.stat().st_size <= 8192
    return path


def texture(scene):
    return next(node for node in scene.world.node_tree.nodes if node.type == "TEX_ENVIRONMENT")


def test_light_from_the_file_alone(skytree, scene, file):
    core = part(skytree, "native").core()
    assert bpy.ops.skytree.open_hdri(filepath=str(file)) == {"FINISHED"}
    assert texture(scene).image.filepath == str(file)
    assert part(skytree, "problems.panel").find(scene) == []
    alone = scenes.render_skytree(scene, 4)
    assert alone[..., :3].std() > 0.05
    scenes.set_map(scene, scenes.float_image("city blocks", core.CompressedMap.load(file).image()))
    np.testing.assert_allclose(alone, scenes.render_skytree(scene, 4), rtol=1e-5, atol=1e-5)


def test_packed_into_a_blend_file(skytree, scene, file, tmp_path):
    bpy.ops.skytree.open_hdri(filepath=str(file))
    before = scenes.render_skytree(scene, 2)
    texture(scene).image.pack()
    file.unlink()
    blend = tmp_path / "packed.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), check_existing=False)
    bpy.ops.wm.open_mainfile(filepath=str(blend), load_ui=False)
    scenes.assert_same_picture(scenes.render_skytree(bpy.context.scene, 2), before)


def test_a_damaged_file_is_named(skytree, scene, file):
    bpy.ops.skytree.open_hdri(filepath=str(file))
    data = bytearray(file.read_bytes())
    data[4000] ^= 1
    file.write_bytes(data)
    messages = part(skytree, "messages").Messages()
    store = part(skytree, "images").ImageStore()
    part(skytree, "world").read_world(scene.world, store, messages)
    (text,) = messages.texts()
    assert "city.skymap: damaged" in text and "copy it again" in text
    with pytest.raises(RuntimeError, match="damaged"):
        bpy.ops.skytree.open_hdri(filepath=str(file))


def test_a_world_without_a_map_cannot_be_compressed(skytree, scene, tmp_path):
    scene.world = bpy.data.worlds.new("Grey")
    with pytest.raises(RuntimeError, match="no image to compress"):
        bpy.ops.skytree.compress_hdri(filepath=str(tmp_path / "none.skymap"))
