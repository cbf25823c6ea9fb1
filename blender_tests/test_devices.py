# SPDX-License-Identifier: GPL-3.0-or-later
"""The device that renders: from the scene, the preferences and the command line; what is said without a GPU.

With a driver (a GPU, or one that executes the kernels on the processor) CUDA's picture is the CPU's."""

import sys

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
