# SPDX-License-Identifier: GPL-3.0-or-later
"""Warnings of the World panel, and that their Fix buttons put things right."""

import time

import bpy
import numpy as np
import pytest
import scenes
from scenes import part


@pytest.fixture(autouse=True)
def forgotten(skytree):
    """Earlier tests have lit pictures by the same maps."""
    part(skytree, "environments").environments.clear()


def problems(skytree, scene):
    return part(skytree, "problems.panel").find(scene)


def operators(skytree, scene) -> set[str]:
    return {problem.operator for problem in problems(skytree, scene)}


def fix(operator: str, **options):
    group, name = operator.split(".")
    return getattr(getattr(bpy.ops, group), name)(**options)


def build(skytree, scene):
    """What is known of the map's pixels once they have lit a picture."""
    module = part(skytree, "environments")
    messages = part(skytree, "messages").Messages()
    store = part(skytree, "images").ImageStore()
    environment = part(skytree, "world").read_world(scene.world, store, messages)
    module.environments.get(environment, module.SamplerSettings(), messages)
    end = time.perf_counter() + 30.0
    while module.environments.figures(environment) is None:
        assert time.perf_counter() < end
        time.sleep(0.01)


def map_of(scene):
    texture = next(n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT")
    return texture.image


def test_bundled_map_has_no_problem(skytree, scene):
    scenes.set_map(scene, scenes.bundled("courtyard"))
    assert problems(skytree, scene) == []


@pytest.mark.parametrize("world", ["none", "color", "nodes"])
def test_no_hdri(skytree, scene, world):
    scene.world = None if world == "none" else bpy.data.worlds.new("World")
    if world == "nodes":
        scenes.nodes_of(scene.world)
    assert operators(skytree, scene) == {"skytree.add_hdri"}
    assert fix("skytree.add_hdri", name="city") == {"FINISHED"}
    assert problems(skytree, scene) == []
    assert map_of(scene).filepath.endswith("city.exr")
    assert scenes.render_skytree(scene, 1)[..., :3].std() > 0.05


def test_missing_file(skytree, scene, tmp_path):
    image = scenes.bundled("forest")
    scenes.set_map(scene, image)
    image.filepath = str(tmp_path / "gone.exr")
    image.reload()
    assert operators(skytree, scene) == {"skytree.open_hdri"}
    assert "gone.exr" in problems(skytree, scene)[0].text
    with pytest.raises(RuntimeError, match="gone.exr"):
        fix("skytree.open_hdri", filepath=str(tmp_path / "gone.exr"))
    (tmp_path / "text.exr").write_text("no image")
    with pytest.raises(RuntimeError, match="text.exr"):
        fix("skytree.open_hdri", filepath=str(tmp_path / "text.exr"))
    fix("skytree.open_hdri", filepath=str(scenes.BUNDLED / "city.exr"))
    assert problems(skytree, scene) == []
    assert len([n for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT"]) == 1


def packed(skytree, name: str, pixels: np.ndarray):
    return part(skytree, "problems.world_nodes").packed_image(name, pixels.astype(np.float32))


def test_bad_texels(skytree, scene):
    pixels = scenes.smooth_map() ** 4
    pixels[3, 5] = np.nan
    pixels[10, 0] = -1.0
    pixels[20, 63, 1] = np.inf
    scenes.set_map(scene, packed(skytree, "bad", pixels))
    assert problems(skytree, scene) == []  # nobody has looked at the pixels yet
    build(skytree, scene)
    assert operators(skytree, scene) == {"skytree.repair_hdri"}
    assert problems(skytree, scene)[0].text.startswith("3 texels")
    assert fix("skytree.repair_hdri") == {"FINISHED"}
    build(skytree, scene)
    assert problems(skytree, scene) == []
    mended = scenes.part(skytree, "images").read_pixels(map_of(scene))[..., :3]
    assert np.isfinite(mended).all() and (mended >= 0.0).all()
    good = np.isfinite(pixels).all(axis=2) & (pixels >= 0).all(axis=2)
    np.testing.assert_allclose(mended[good], pixels[good], rtol=1e-6)
    assert mended[3, 5, 0] == pytest.approx(pixels[2:5, 4:7, 0][good[2:5, 4:7]].mean(), rel=1e-4)


def test_ringing_is_no_problem(skytree, scene):
    pixels = scenes.smooth_map() ** 4
    pixels[5:9, 3:9] = -1e-4
    scenes.set_map(scene, packed(skytree, "ringing", pixels))
    build(skytree, scene)
    assert problems(skytree, scene) == []


def test_repair_keeps_a_sun_out_of_gamut(skytree, scene):
    """Its blue is below zero, and its neighbours are a thousand times darker."""
    pixels = scenes.smooth_map()
    pixels[8, 20] = 1000.0, 400.0, -2.0
    pixels[3, 5] = np.nan
    scenes.set_map(scene, packed(skytree, "saturated", pixels))
    build(skytree, scene)
    assert problems(skytree, scene)[0].text.startswith("1 texels")
    assert fix("skytree.repair_hdri") == {"FINISHED"}
    mended = scenes.part(skytree, "images").read_pixels(map_of(scene))[..., :3]
    np.testing.assert_allclose(mended[8, 20], (1000.0, 400.0, 0.0))


def test_clipped_sun(skytree, scene):
    pixels = scenes.smooth_map()
    pixels[8:10, 20:23] = 300.0
    scenes.set_map(scene, packed(skytree, "clipped", pixels))
    build(skytree, scene)
    assert operators(skytree, scene) == {"skytree.open_hdri"}
    assert "6 texels share the value 300" in problems(skytree, scene)[0].text
    pixels[8, 20] = 900.0
    pixels[9, 21] = 800.0
    scenes.set_map(scene, packed(skytree, "whole", pixels))
    build(skytree, scene)
    assert problems(skytree, scene) == []


def test_smooth_map(skytree, scene):
    pixels = 1.0 + 0.05 * scenes.smooth_map()
    scenes.set_map(scene, packed(skytree, "smooth", pixels))
    build(skytree, scene)
    assert operators(skytree, scene) == {"skytree.use_uniform"}
    fix("skytree.use_uniform")
    assert scene.skytree.sampler == "UNIFORM" and problems(skytree, scene) == []


def test_gain_of_known_maps(skytree):
    figures = part(skytree, "map_figures").map_figures
    assert figures(np.ones((16, 32, 3), np.float32)).gain == pytest.approx(1.0)
    assert figures(np.zeros((4, 8, 3), np.float32)).gain == 1.0
    half = np.zeros((64, 128, 3), np.float32)
    half[:32] = 5.0  # half of all directions: uniform sampling wastes every other sample
    assert figures(half).gain == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0), (0.4, 0.3, 1.2)])
def test_bake_shows_the_same_world(skytree, cycles, rotation):
    """A world of an HDRI is baked: the map must lie where it lay before."""
    scene = cycles
    scenes.set_map(scene, scenes.float_image("smooth", scenes.smooth_map()), rotation, strength=1.5)
    scene.camera.rotation_euler = (1.3, 0.0, 0.4)
    scenes.at_pixel_centers(scene)
    before = scenes.render_skytree(scene)[..., :3]
    assert fix("skytree.bake_world", width=256, samples=4) == {"FINISHED"}
    after = scenes.render_skytree(scene)[..., :3]
    np.testing.assert_allclose(after, before, rtol=0.02, atol=0.02)
    assert map_of(scene) is not None and len(bpy.data.scenes) == 1 and len(bpy.data.cameras) == 1


def test_unreadable_node_is_baked(skytree, cycles):
    scene = cycles
    tree, background = scenes.world_tree(scene)
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs["Color"], background.inputs["Color"])
    assert operators(skytree, scene) == {"skytree.bake_world"}
    assert noise.name in problems(skytree, scene)[0].text
    scene.camera.rotation_euler.x = 1.8
    theirs = scenes.render_cycles(scene, 16)[..., :3]
    fix("skytree.bake_world", width=512, samples=4)
    assert problems(skytree, scene) == []
    ours = scenes.render_skytree(scene, 16)[..., :3]
    np.testing.assert_allclose(ours, theirs, atol=0.04)


def test_panel_draws(skytree, scene):
    """The panel's code runs; a stub stands for Blender's layout."""

    class Layout:
        words: list[str] = []

        def label(self, text="", icon="NONE"):
            self.words.append(text)

        def operator(self, name, text="", icon="NONE"):
            self.words.append(text)

        operator_menu_enum = lambda self, name, prop, text="", icon="NONE": self.words.append(text)  # noqa: E731

        def box(self, **_):
            return self

        column = row = box

    class Panel:
        layout = Layout()

    class Context:
        engine = "SKYTREE"

    Context.scene = scene
    scene.world = None
    panel = part(skytree, "problems.panel").SKYTREE_WORLD_PT_problems
    assert panel.poll(Context)
    panel.draw(Panel, Context)
    assert "Add HDRI" in Layout.words and any("no HDRI" in word for word in Layout.words)
