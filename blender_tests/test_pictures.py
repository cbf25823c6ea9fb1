# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the map and the overlay's geometry: what they show, on maps whose picture is known."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import scenes
from scenes import part

HEIGHT, WIDTH = 32, 64


@pytest.fixture
def tree(skytree):
    """(map, kd-tree) of a smooth map with a sun."""
    image = scenes.smooth_map(WIDTH, HEIGHT)
    image[8, 20] = 500.0
    core = part(skytree, "native").core()
    return image, core.KdTreeSampler(image, 64, "SSE", "FITTED")


# Drawing


def test_lines_and_numerals(skytree):
    raster = part(skytree, "pictures.raster")
    image = np.zeros((20, 30, 3))
    raster.curve(image, [2, 12, 12], [3, 3, 9], (1, 0, 0))
    lit = {(int(y), int(x)) for y, x in zip(*np.nonzero(image[..., 0]), strict=True)}
    assert lit == {(3, x) for x in range(2, 13)} | {(y, 12) for y in range(3, 10)}
    image[:] = 0
    raster.text(image, 5, 6, "7", (0, 1, 0), scale=1)
    rows = ["".join(" #"[int(v > 0)] for v in row) for row in image[6:11, 5:8, 1]]
    assert rows == ["###", "  #", "  #", " # ", " # "]
    raster.curve(image, [-5, 50], [-5, 50], (1, 1, 1))  # what lies outside is left out


def test_resizing_keeps_the_mean(skytree):
    raster = part(skytree, "pictures.raster")
    image = np.random.default_rng(0).random((30, 50, 3)).astype(np.float32)
    small = raster.resize(image, 6, 10)
    assert small.shape == (6, 10, 3)
    assert np.allclose(small[1, 2], image[5:10, 10:15].mean(axis=(0, 1)), atol=1e-6)
    assert np.array_equal(raster.resize(image, 60, 100)[::2, ::2], image)


# Pictures


def test_blocks_are_framed_where_they_are(skytree, tree):
    pictures = part(skytree, "pictures.plots")
    image, _ = tree
    bounds = np.array([[0, 0, 32, 32], [32, 0, 64, 32]])
    framed = pictures.blocks_picture(image, bounds, 4 * HEIGHT, 4 * WIDTH)
    plain = pictures.map_picture(image, 4 * HEIGHT, 4 * WIDTH)
    changed = np.abs(framed - plain).max(axis=2) > 1e-6
    assert changed[:, 128].all() and changed[0].all() and changed[:, 0].all()
    assert not changed[5:120, 5:120].any() and not changed[5:120, 135:250].any()


def test_the_rebuilt_map_is_flat_inside_a_block(skytree, tree):
    image, sampler = tree
    rebuilt = part(skytree, "pictures.plots").rebuilt_picture(image, sampler.reconstruct(), HEIGHT, WIDTH)
    x0, y0, x1, y1 = max(sampler.bounds.tolist(), key=lambda b: (b[2] - b[0]) * (b[3] - b[1]))
    block = rebuilt[int(y0) : int(y1), int(x0) : int(x1)]
    assert block.shape[0] * block.shape[1] > 8
    assert np.ptp(block.reshape(-1, 3), axis=0).max() < 1e-5


def test_the_fitted_pdf_is_a_distribution(skytree):
    pictures = part(skytree, "pictures.plots")
    fitted = pictures.fitted_probabilities(2.5, 300)
    assert fitted.sum() == pytest.approx(1.0)
    assert (np.diff(fitted) < 0).all()


def test_the_pdf_plot_shows_dots_and_line(skytree):
    """Data of twice the model lie above its line, data of half of it below; equal axes for both."""
    pictures = part(skytree, "pictures.plots")
    fitted = pictures.fitted_probabilities(3.0, 200)

    def mean_row(picture, color):
        return np.nonzero((np.abs(picture - color).max(axis=2) < 1e-6).any(axis=1))[0].mean()

    for factor, is_above in ((2.0, True), (0.5, False)):
        picture = pictures.pdf_picture(fitted * factor, 3.0, 300, 300)
        dots, line = (mean_row(picture, color) for color in (pictures.EMPIRICAL, pictures.FITTED))
        assert (dots < line) == is_above


def test_false_colours_have_a_step_a_stop(skytree):
    """Half the map at 1, the other half four stops brighter: colours are that many steps of the scale
    apart, and the histogram has two bars for the sphere of equal height."""
    pictures = part(skytree, "pictures.plots")
    image = np.ones((HEIGHT, WIDTH, 3), np.float32)
    image[:, : WIDTH // 2 - 1] = 16.0
    shown = pictures.exposure_picture(image, 256, 256)
    low, high = (pictures.colormap(np.array((s + 8.5) / pictures.STOPS)) for s in (0, 4))
    assert np.allclose(shown[10, 250], low, atol=1e-5)
    assert np.allclose(shown[10, 5], high, atol=1e-5)
    bars = (np.abs(shown[128:] - pictures.INK).max(axis=2) < 1e-6)[:90].sum(axis=0)
    heights = sorted(bars[bars > 20])
    assert heights[0] == pytest.approx(heights[-1], rel=0.1)


def test_bad_texels_do_not_spoil_pictures(skytree):
    pictures = part(skytree, "pictures.plots")
    image = np.ones((16, 32, 3), np.float32)
    image[3, 4], image[5, 6], image[7, 8] = np.nan, np.inf, -5.0
    for shown in (pictures.map_picture(image, 64, 128), pictures.exposure_picture(image, 128, 128)):
        assert np.isfinite(shown).all() and shown.min() >= 0.0 and shown.max() <= 1.0


@pytest.mark.parametrize("kind", ["BLOCKS", "PDF", "EXPOSURE"])
def test_each_kind_of_picture(skytree, tree, kind):
    map_pictures, environments = part(skytree, "pictures.map_pictures"), part(skytree, "environments")
    image, sampler = tree
    settings = environments.SamplerSettings()
    built = environments.BuiltEnvironment(image, sampler, settings, "map", (WIDTH, HEIGHT))
    shown = map_pictures.picture(built, kind, 128, 128)
    assert shown.shape == (128, 128, 3) and shown.std() > 0.02
    uniform = part(skytree, "native").core().UniformSampler()
    built = environments.BuiltEnvironment(image, uniform, settings, "map", (WIDTH, HEIGHT))
    assert (map_pictures.picture(built, kind, 128, 128) is None) == (kind != "EXPOSURE")


# The overlay


def test_blocks_cover_the_sphere_once(skytree, tree):
    geometry = part(skytree, "pictures.overlay_geometry")
    _, sampler = tree
    bounds = np.asarray(sampler.bounds)
    angles = geometry.block_solid_angles(bounds, WIDTH, HEIGHT)
    assert angles.sum() == pytest.approx(4 * np.pi)
    colors = geometry.density_colors(np.asarray(sampler.probabilities), angles, 0.5)
    fills, shades, lines = geometry.blocks(bounds, WIDTH, HEIGHT, colors)
    assert len(fills) == len(shades) and len(lines) % 2 == 0
    for points in (fills, lines):
        assert np.allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-5)
    corners = fills.reshape(-1, 3, 3).astype(np.float64)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert areas.sum() == pytest.approx(4 * np.pi, rel=2e-3)


def test_blocks_lie_where_the_sampler_says(skytree, tree):
    """The pdf at a block's middle direction is the block's probability per solid angle."""
    geometry = part(skytree, "pictures.overlay_geometry")
    _, sampler = tree
    bounds = np.asarray(sampler.bounds, np.float64)
    x, y = (bounds[:, 0] + bounds[:, 2]) / 2, (bounds[:, 1] + bounds[:, 3]) / 2
    directions = geometry.directions(x / WIDTH, y / HEIGHT).astype(np.float32)
    expected = np.asarray(sampler.probabilities) / geometry.block_solid_angles(bounds, WIDTH, HEIGHT)
    assert np.allclose(sampler.pdf(directions), expected, rtol=1e-3)


def test_dots_lie_at_their_directions(skytree):
    geometry = part(skytree, "pictures.overlay_geometry")
    directions = np.array([(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0.0, 0.8)], np.float32)
    corners = geometry.dots(directions, 0.01).reshape(4, 6, 3)
    assert np.allclose(corners.mean(axis=1), directions, atol=1e-4)
    assert np.abs(corners - directions[:, None]).max() == pytest.approx(0.01, rel=0.3)
    u = geometry.low_discrepancy(1000)
    assert u.shape == (1000, 3) and u.min() >= 0.0 and u.max() < 1.0
    assert np.allclose(u.mean(axis=0), 0.5, atol=0.01)


def test_the_overlay_turns_with_the_map(skytree, scene):
    """A direction of the map's frame is placed where the rotated world shows it."""
    overlay, world = part(skytree, "pictures.overlay"), part(skytree, "world")
    scenes.set_map(scene, scenes.float_image("turned", scenes.smooth_map()), rotation=(0.3, 0.0, 1.1))
    images, messages = part(skytree, "images").ImageStore(), part(skytree, "messages").Messages()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    environment = world.read_world(depsgraph.scene_eval.world, images, messages)
    settings = scene.skytree_overlay
    settings.place, settings.radius = "ORIGIN", 3.0
    placed = np.array(overlay.placement(settings, environment, None, 100.0))
    direction = np.array((0.48, 0.6, 0.64))
    in_world = placed[:3, :3] @ direction
    assert np.allclose(environment.world_to_env @ in_world, 3.0 * direction, atol=1e-5)


def test_captions_say_what_is_drawn(skytree, tree):
    caption = part(skytree, "pictures.panel").caption
    current = SimpleNamespace(built=SimpleNamespace(sampler=tree[1]))
    assert "64 blocks" in caption("BLOCKS", current)
    assert f"alpha {tree[1].alpha:.3g}" in caption("PDF", current)
    assert "Grey" in caption("EXPOSURE", None) and caption("PDF", None) == ""
