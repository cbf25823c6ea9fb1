# SPDX-License-Identifier: GPL-3.0-or-later
"""What the viewport draws, drawn offscreen: an engine may ask for a GPU context, also without a window."""

import bpy
import numpy as np
import pytest
import scenes
from scenes import part

WIDTH, HEIGHT = 64, 48


@pytest.fixture
def drawn(skytree, scene):
    """drawn(function): what function() draws in region coordinates, (HEIGHT, WIDTH, 4), bottom row first."""
    task = {}

    class DrawingEngine(bpy.types.RenderEngine):
        bl_idname = "SKYTREE_TEST_DRAW"
        bl_label = "Drawing test"
        bl_use_gpu_context = True

        def render(self, depsgraph):
            try:
                gpu_draw = part(skytree, "viewport.gpu_draw")
                task["image"] = gpu_draw.render_offscreen(WIDTH, HEIGHT, task["draw"], task["background"])
            except Exception as error:
                task["error"] = error
            render = depsgraph.scene_eval.render
            result = self.begin_result(0, 0, render.resolution_x, render.resolution_y)
            self.end_result(result)

    bpy.utils.register_class(DrawingEngine)

    def draw(function, background=(0.0, 0.0, 0.0, 1.0)):
        task.clear()
        task.update(draw=function, background=background)
        scene.render.engine = DrawingEngine.bl_idname
        bpy.ops.render.render()
        scene.render.engine = "SKYTREE"
        if "error" in task:
            raise task["error"]
        return task["image"]

    yield draw
    scene.render.engine = "SKYTREE"
    bpy.utils.unregister_class(DrawingEngine)


def noise(height, width, seed=0, scale=1.0):
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = np.random.default_rng(seed).random((height, width, 3), np.float32) * scale
    return pixels


def test_image_is_drawn_as_it_is(skytree, drawn):
    gpu_draw = part(skytree, "viewport.gpu_draw")
    pixels = noise(HEIGHT, WIDTH, scale=50.0)
    image = drawn(lambda: gpu_draw.draw_image(gpu_draw.upload(pixels), 0, 0, WIDTH, HEIGHT, smooth=False))
    np.testing.assert_allclose(image, pixels, rtol=1e-3, atol=1e-5)  # half floats


def test_largest_values_stay_finite(skytree, drawn):
    gpu_draw = part(skytree, "viewport.gpu_draw")
    pixels = np.full((HEIGHT, WIDTH, 4), 1e9, np.float32)
    pixels[..., 3] = 0.0
    image = drawn(lambda: gpu_draw.draw_image(gpu_draw.upload(pixels), 0, 0, WIDTH, HEIGHT))
    assert np.isfinite(image).all()


def test_coarse_image_is_interpolated(skytree, drawn):
    gpu_draw = part(skytree, "viewport.gpu_draw")
    ramp = np.ones((1, 8, 4), np.float32)
    ramp[0, :, :3] = np.linspace(0.0, 1.0, 8)[:, None]

    def draw():
        texture = gpu_draw.upload(ramp)
        gpu_draw.draw_image(texture, 0, 24, WIDTH, 24)
        gpu_draw.draw_image(texture, 0, 0, WIDTH, 24, smooth=False)

    image = drawn(draw)
    assert len(np.unique(image[40, :, 0])) > 40 and (np.diff(image[40, :, 0]) >= 0.0).all()
    np.testing.assert_allclose(image[10, :, 0], np.repeat(ramp[0, :, 0], 8), atol=1e-3)


def test_part_of_an_image(skytree, drawn):
    gpu_draw = part(skytree, "viewport.gpu_draw")
    pixels = noise(HEIGHT, WIDTH)

    def draw():
        texture = gpu_draw.upload(pixels)
        gpu_draw.draw_image(texture, 0, 0, WIDTH // 2, HEIGHT, uv=(0.5, 0.0, 1.0, 1.0), smooth=False)

    image = drawn(draw)
    np.testing.assert_allclose(image[:, : WIDTH // 2], pixels[:, WIDTH // 2 :], atol=1e-3)
    assert (image[:, WIDTH // 2 :, :3] == 0.0).all()


def test_alpha_is_premultiplied(skytree, drawn):
    gpu_draw = part(skytree, "viewport.gpu_draw")
    pixels = np.full((HEIGHT, WIDTH, 4), 0.25, np.float32)
    pixels[..., 3] = 0.5
    image = drawn(
        lambda: gpu_draw.draw_image(gpu_draw.upload(pixels), 0, 0, WIDTH, HEIGHT), (1.0, 1.0, 1.0, 1.0)
    )
    np.testing.assert_allclose(image[..., :3], 0.75, atol=1e-3)


@pytest.mark.parametrize("look", ["Standard", "default", "exposed"])
def test_view_transform_is_blenders(skytree, scene, drawn, look):
    """The table on the GPU gives what Blender writes when it saves through the scene's view transform."""
    gpu_draw, transforms = part(skytree, "viewport.gpu_draw"), part(skytree, "viewport.display_transform")
    view = scene.view_settings
    if look == "Standard":
        view.view_transform = "Standard"
    if look == "exposed":
        view.exposure, view.gamma = 1.3, 1.2
    pixels = noise(HEIGHT, WIDTH)
    # From far below to far above white, even in stops, of all hues.
    pixels[..., :3] = 2.0 ** (pixels[..., :3] * 3.0 - 1.5 + np.linspace(-7.0, 4.0, WIDTH)[:, None])
    wanted = part(skytree, "viewport.display").displayed(pixels[..., :3], scene, depth="16")
    table = transforms.bake(scene)

    def draw():
        gpu_draw.draw_image(
            gpu_draw.upload(pixels), 0, 0, WIDTH, HEIGHT, colors=gpu_draw.VIEW_TRANSFORM, view_transform=table
        )

    image = drawn(draw)[..., :3]
    difference = np.abs(image - wanted)
    print(f"{view.view_transform}: mean {difference.mean():.5f}, largest {difference.max():.4f}")
    assert difference.mean() < 0.005 and np.percentile(difference, 99) < 0.03


def test_shapes_and_text(skytree, drawn):
    gpu_draw = part(skytree, "viewport.gpu_draw")

    def draw():
        gpu_draw.rectangle(4, 4, 10, 6, (1.0, 0.0, 0.0, 1.0))
        gpu_draw.frame(20, 4, 12, 10, (0.0, 1.0, 0.0, 1.0), 2)
        gpu_draw.polyline([(4, 40), (60, 40)], (0.0, 0.0, 1.0, 1.0), 2)
        gpu_draw.text(4, 20, "spp", 14)

    image = drawn(draw)
    assert (image[4:10, 4:14, 0] == 1.0).all() and (image[3, 4:14, 0] == 0.0).all()
    assert image[4:14, 20:32, 1].sum() == pytest.approx(12 * 10 - 8 * 6)
    assert (image[39:41, 6:58, 2] == 1.0).all() and (image[43, :, 2] == 0.0).all()
    assert image[16:36, :40, :3].max() > 0.5


def test_renderer_draws_its_picture(skytree, scene, drawn):
    import test_viewport

    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled())
    scene.skytree.preview_samples = 2
    renderer = part(skytree, "viewport.renderer").ViewportRenderer()
    try:
        test_viewport.update(renderer)
        test_viewport.look(skytree, renderer, test_viewport.view_through_camera(skytree, WIDTH, HEIGHT))
        test_viewport.finish(renderer)
        image = drawn(renderer.draw)
        np.testing.assert_allclose(image[..., :3], renderer.pixels()[..., :3], rtol=2e-3, atol=1e-3)
    finally:
        renderer.close()


def test_problem_is_written_over_the_picture(skytree, drawn):
    hooks = part(skytree, "viewport.hooks")
    image = drawn(lambda: hooks.draw_problem("out of memory", WIDTH), (1.0, 1.0, 1.0, 1.0))
    assert image[16:30, :, :3].min() < 0.6
