# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices in Python: what is listed, what may be asked for, and that the CPU takes over with a reason."""

import os
import subprocess
import sys

import numpy as np
import pytest
import skytree_core as sky

PERSPECTIVE = np.array([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, -1.001, -0.2], [0, 0, -1, 0]])
CAMERA = np.array([[1, 0, 0, 0], [0, 0, -1, -4], [0, 1, 0, 0.5], [0, 0, 0, 1]], float)


def make_scene():
    scene = sky.Scene()
    corners = np.array([[-1, 0, 0], [1, 0, 0], [1, 0, 1.5], [-1, 0, 1.5]], np.float32)
    mesh = scene.add_mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    scene.add_instance(mesh, np.eye(4), [scene.add_material([{"type": "DIFFUSE", "color": (0.8, 0.4, 0.2)}])])
    scene.set_camera(CAMERA, PERSPECTIVE)
    image = np.random.default_rng(3).random((16, 32, 3), dtype=np.float32)
    image[3, 5] = 300
    scene.set_environment(image, sky.KdTreeSampler(image, block_count=64))
    return scene


def render(session, scene):
    session.start(scene, 48, 32, 4, max_bounces=1, seed=2)
    assert session.wait(300)
    assert session.error is None
    return session.pixels()


def test_the_cpu_comes_first():
    first = sky.devices()[0]
    assert (first.type, first.id) == ("CPU", "CPU") and first.name


@pytest.mark.parametrize("device", ["GPU", "CUDA:", "CUDA:x", "cuda", "CUDA:-1", ""])
def test_an_unknown_device_is_named(device):
    with pytest.raises(ValueError, match="device must be"):
        sky.RenderSession(device=device)


def test_without_a_gpu_the_cpu_finishes_and_says_why():
    scene = make_scene()
    expected = render(sky.RenderSession(1), scene)
    session = sky.RenderSession(1, device="CUDA:99")
    np.testing.assert_array_equal(render(session, scene), expected)
    assert "The CPU finishes the frame" in session.warning
    assert session.stats["device"].endswith("+ CPU")


def test_a_missing_driver_is_named():
    code = (
        "import skytree_core as s; print(s.cuda_problem()); print([d.type for d in s.devices()]);"
        "print(s.RenderSession(1, device='CUDA').warning)"
    )
    environment = os.environ | {"SKYTREE_CUDA_DRIVER": "/nonexistent/libcuda.so.1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    problem, devices, warning = done.stdout.splitlines()
    assert "/nonexistent" in problem or "without nvcc" in problem
    assert devices == "['CPU']" and warning == "None"


@pytest.mark.skipif(sky.cuda_problem() is not None, reason=str(sky.cuda_problem()))
def test_cuda_renders_the_cpus_image():
    scene = make_scene()
    gpus = [device for device in sky.devices() if device.type == "CUDA"]
    expected = render(sky.RenderSession(1), scene)
    for gpu in gpus:
        session = sky.RenderSession(1, device=gpu.id)
        pixels = render(session, scene)
        assert session.warning is None
        assert session.stats["device"] == gpu.name
        # The ray tracers round differently (docs/cuda.md); a flat quad leaves no room for more than that.
        np.testing.assert_allclose(pixels, expected, rtol=2e-3, atol=1e-4)
