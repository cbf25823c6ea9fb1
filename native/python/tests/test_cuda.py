# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices in Python: what is listed, what may be asked for, and that the CPU takes over with a reason."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

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


def run_python(code: str, **variables) -> subprocess.CompletedProcess:
    """In a process of its own: a driver is loaded once, and some of its settings count at its end."""
    environment = os.environ | variables
    folder = os.path.dirname(__file__)
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=folder, capture_output=True, text=True
    )


def test_a_missing_driver_is_named():
    code = (
        "import skytree_core as s; print(s.cuda_problem()); print([d.type for d in s.devices()]);"
        "print(s.RenderSession(1, device='CUDA').warning)"
    )
    done = run_python(code, SKYTREE_CUDA_DRIVER="/nonexistent/libcuda.so.1")
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


def has_emulator() -> bool:
    path = os.environ.get("SKYTREE_CUDA_DRIVER")
    return bool(path) and sky.cuda_problem() is None and hasattr(ctypes.CDLL(path), "cuemuCounter")


@pytest.mark.skipif(not has_emulator(), reason="the driver cannot be told to fail: it is not the emulator")
def test_a_driver_that_does_not_start_is_named():
    done = run_python("import skytree_core as s; print(s.cuda_problem())", CUEMU_INIT_ERROR="999")
    assert "cuInit" in done.stdout and "CUDA_ERROR_UNKNOWN" in done.stdout, done.stdout + done.stderr


@pytest.mark.skipif(not has_emulator(), reason="leaks are counted by the emulator, and it is not here")
def test_nothing_is_left_on_the_gpu_at_exit():
    code = (
        "import test_cuda as t; session = t.sky.RenderSession(1, device='CUDA');"
        "t.render(session, t.make_scene()); assert session.warning is None, session.warning"
    )
    done = run_python(code, CUEMU_LEAKS="2")
    assert done.returncode == 0, done.stdout + done.stderr  # 86: something was left


@pytest.mark.skipif(sky.cuda_problem() is not None, reason=str(sky.cuda_problem()))
def test_the_pixels_are_a_view_that_stays():
    scene = make_scene()
    session = sky.RenderSession(1, device="CUDA")
    pixels = render(session, scene)
    assert not pixels.flags.writeable and not pixels.flags.owndata
    before = pixels.copy()
    session.start(scene, 48, 32, 2, seed=9)
    session.wait(300)
    del session
    np.testing.assert_array_equal(pixels, before)
    own = np.empty((32, 48, 4), np.float32)
    session = sky.RenderSession(1, device="CUDA")
    render(session, scene)
    assert session.pixels(own) is own
    np.testing.assert_array_equal(own, before)


@pytest.mark.skipif(sky.cuda_problem() is not None, reason=str(sky.cuda_problem()))
def test_the_benchmark_measures(monkeypatch):
    # On an emulator its times mean nothing, but what would be measured on a GPU runs.
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[3] / "docs" / "bench")
    bench = pytest.importorskip("cuda_samplers", reason="it needs the repository around it")
    monkeypatch.setattr(bench, "TIMED_THREADS", 64)
    monkeypatch.setattr(bench, "FRAME_SIZE", 16)
    monkeypatch.setattr(bench, "SAMPLES_PER_PIXEL", (1, 2))
    gpu = next(device for device in sky.devices() if device.type == "CUDA")
    maps = {"small": bench.synthetic_map(64)}
    times, frames = bench.times(gpu, maps), bench.frames(gpu, maps)
    assert [row.method for row in times] == list(bench.METHODS) and all(row.value > 0 for row in times)
    assert len(frames) == 2 * len(bench.METHODS) and all(row.value > 0 for row in frames)
    page = bench.cuda_samplers_page.page(times + frames, gpu.name, None, 0)
    assert f"Frames per second on {gpu.name}" in page and "kdtree_warp" in page


@pytest.mark.skipif(sky.cuda_problem() is not None, reason=str(sky.cuda_problem()))
def test_the_render_benchmark_measures(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[3] / "docs" / "bench")
    bench = pytest.importorskip("cuda_render", reason="it needs the repository around it")
    monkeypatch.setattr(bench, "SIZE", (16, 9))
    gpu = next(device for device in sky.devices() if device.type == "CUDA")
    image = np.random.default_rng(3).random((16, 32, 3), dtype=np.float32)
    rows = bench.rows(image, gpu.id, samples=1)
    assert [row[0] for row in rows] == [*bench.SAMPLERS, "uniform"] and {len(row) for row in rows} == {4}
