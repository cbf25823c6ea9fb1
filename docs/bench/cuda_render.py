# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixel samples per second of the CUDA renderer by scene and sampler, at 1920 x 1080.

    build/venv/bin/python docs/bench/cuda_render.py --map FILE

Needs an NVIDIA GPU. Prints a table; a warm session's fastest of three renders each.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np
import skytree_core as sky

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "make_figures"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "demo"))
import shapes
import stage
from benchmarks_page import table

SIZE = (1920, 1080)
SAMPLERS = ("kdtree", "kdtree_paper", "inversion", "inversion_binary", "alias")


def textured_spheres(image: np.ndarray, width: int, height: int) -> stage.Stage:
    """25 spheres on a table, by turns principled, diffuse and glossy, all with a texture."""
    scene = stage.Stage(image, width, height)
    texture = scene.scene.add_texture(np.random.default_rng(1).random((256, 256, 3), dtype=np.float32))
    ball = shapes.sphere(48)
    x, y, z = ball.normals.T
    uv = np.stack([np.arctan2(y, x) / (2 * math.pi) + 0.5, np.arccos(np.clip(z, -1, 1)) / math.pi], 1)
    mesh = scene.scene.add_mesh(
        ball.vertices.astype(np.float32),
        ball.triangles,
        ball.triangles,
        ball.normals.astype(np.float32),
        uv.astype(np.float32),
    )
    for i in range(25):
        closure = {
            "weight": 1.0,
            "type": ("PRINCIPLED", "DIFFUSE", "GLOSSY")[i % 3],
            "color": (0.8, 0.7, 0.6),
        }
        closure |= {"roughness": 0.2 + 0.02 * i, "color_texture": texture}
        if i % 3 == 0:
            closure |= {"metallic": 0.3, "roughness_texture": texture}
        place = np.diag([0.5, 0.5, 0.5, 1.0])
        place[:3, 3] = (1.1 * (i % 5 - 2), 1.1 * (i // 5 - 2), 0.5)
        scene.scene.add_instance(mesh, place, materials=[scene.scene.add_material([closure])])
    scene.add(shapes.table(), stage.TABLE, scale=3)
    scene.look(position=(0.3, -8.0, 4.6), target=(0.05, 0.0, 0.3), lens=50)
    return scene


def rate(scene: stage.Stage, sampler, samples: int, bounces: int, gpu: str) -> float:
    """Millions of pixel samples per second."""
    seconds = [scene.render(sampler, samples, max_bounces=bounces, device=gpu).seconds for _ in range(3)]
    return scene.width * scene.height * samples / min(seconds) / 1e6


def rows(image: np.ndarray, gpu: str, samples: int = 64) -> list[list[str]]:
    samplers = {name: stage.build(name, image) for name in SAMPLERS} | {"uniform": sky.UniformSampler()}
    teapot, spheres = stage.teapot_stage(image, *SIZE), textured_spheres(image, *SIZE)
    found = []
    for name, sampler in samplers.items():
        rates = (
            rate(teapot, sampler, samples, 0, gpu),
            rate(teapot, sampler, samples, 4, gpu),
            rate(spheres, sampler, samples, 4, gpu),
        )
        found.append([name, *(f"{value:.1f}" for value in rates)])
        print(*found[-1], file=sys.stderr, flush=True)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--map", type=Path, required=True, help="environment map")
    arguments = parser.parse_args()
    gpu = next((device for device in sky.devices() if device.type == "CUDA"), None)
    if gpu is None:
        sys.exit(f"No GPU: {sky.cuda_problem()}")
    print(f"Millions of pixel samples per second on {gpu.name}, {SIZE[0]} x {SIZE[1]}:\n")
    heads = ["sampler", "teapot, direct light", "teapot, 4 bounces", "textured spheres, 4 bounces"]
    print(table(heads, rows(sky.read_image(arguments.map), gpu.id)))


if __name__ == "__main__":
    main()
