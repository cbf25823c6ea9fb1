# SPDX-License-Identifier: GPL-3.0-or-later
"""The device that renders: from the scene, the preferences and the command line; what is said without a GPU.

With a driver (a GPU, or one that executes the kernels on the processor) CUDA's picture is the CPU's."""

import sys

import bpy
import numpy as np
import pytest
import scenes


@pytest.fixture
def devices(skytree):
    return scenes.part(skytree, "devices")


@pytest.mark.parametrize(
    ("arguments", "device"),
    [
        (["blender", "-b"], None),
        (["blender", "-b", "--", "--skytree-device", "CUDA"], "CUDA"),
        (["blender", "--", "--other", "--skytree-device=CUDA:1"], "CUDA:1"),
        (["blender", "--skytree-device", "CUDA", "--"], None),  # before the "--" it is Blender's to refuse
        (["blender", "--", "--skytree-device"], ""),
    ],
)
def test_command_line(devices, arguments, device):
    assert devices.device_from_command_line(arguments) == device


def test_the_command_line_outweighs_the_scene(devices, scene, monkeypatch):
    scene.skytree.device = "CPU"
    assert devices.render_device(scene.skytree) == "CPU"
    monkeypatch.setattr(sys, "argv", ["blender", "--", "--skytree-device", "CUDA:3"])
    assert devices.render_device(scene.skytree) == "CUDA:3"


def test_the_scene_asks_for_the_preferred_gpu(devices, scene):
    scene.skytree.device = "CUDA"
    assert devices.render_device(scene.skytree).startswith("CUDA")


def settings_of_every_sampler():
    """All values of `sampler`, and for the kd-tree of `block_probability`; new ones are found here."""
    choices = bpy.types.Scene.bl_rna.properties["skytree"].fixed_type.properties
    for sampler in [i.identifier for i in choices["sampler"].enum_items]:
        if sampler == "KDTREE":
            for probability in [i.identifier for i in choices["block_probability"].enum_items]:
                yield {"sampler": sampler, "block_probability": probability}
        else:
            yield {"sampler": sampler}


def test_cuda_renders_the_cpus_picture_of_the_demo_with_every_sampler(devices, scene, capsys):
    """Embree rounds a hit in other bits than our own tracer (docs/cuda.md); where that decides at an edge
    between two surfaces, one sample of a pixel is another. Nothing else differs."""
    if problem := devices.cuda_problem():
        pytest.skip(problem)
    if bpy.app.version < (4, 0):
        pytest.skip("the demo's materials have the names that nodes have from Blender 4.0 on")
    sys.path.insert(0, str(scenes.ROOT / "docs" / "demo"))
    import scene as demo

    for thing in list(scene.objects):
        bpy.data.objects.remove(thing)
    demo.build(scene, scenes.BUNDLED / "city.exr")
    scene.render.resolution_x, scene.render.resolution_y = 96, 54
    scene.skytree.learn_visibility = scene.skytree.adaptive_sampling = False  # the CPU alone does
    tried = 0
    for settings in settings_of_every_sampler():
        expected = scenes.render_skytree(scene, samples=4, max_bounces=3, device="CPU", **settings)
        pixels = scenes.render_skytree(scene, samples=4, max_bounces=3, device="CUDA", **settings)
        off = np.abs(pixels - expected) > 1e-3 * (0.1 + np.abs(expected))
        share, means = off.mean(), pixels.mean() / expected.mean() - 1
        with capsys.disabled():
            print(
                f"{settings}: {off.sum()} of {off.size} values differ by more than 1e-3, means by {means:.1e}"
            )
        assert expected[..., :3].std() > 0.01  # there is something to see
        assert share < 0.01 and abs(means) < 2e-3, settings
        tried += 1
    assert tried >= 6


def test_the_preferences_choose_among_several_gpus(devices, skytree, scene, monkeypatch):
    native = scenes.part(skytree, "native")
    gpus = [device for device in native.core().devices() if device.type == "CUDA"]
    if len(gpus) < 2:
        pytest.skip(f"one GPU or none is here: {devices.cuda_problem() or gpus[0].name}")
    preferences = bpy.context.preferences.addons[skytree.__name__].preferences
    before = preferences.gpu
    try:
        for gpu in gpus:
            preferences.gpu = gpu.id
            scene.skytree.device = "CUDA"
            assert devices.render_device(scene.skytree) == gpu.id
    finally:
        preferences.gpu = before


def test_cuda_renders_the_cpus_picture_or_says_why_not(devices, skytree, scene):
    scene.skytree.samples = 2
    expected = scenes.render_skytree(scene)
    scene.skytree.device = "CUDA"
    pixels = scenes.render_skytree(scene)
    problem = devices.cuda_problem()
    said = [text for severity, text in scenes.part(skytree, "status").last.messages if severity == "WARNING"]
    if problem:
        np.testing.assert_array_equal(pixels, expected)
        assert any("The CPU finishes the frame" in text for text in said)
    else:
        np.testing.assert_allclose(pixels, expected, rtol=2e-3, atol=1e-4)
        assert not any("The CPU finishes the frame" in text for text in said)
