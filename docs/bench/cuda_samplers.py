# SPDX-License-Identifier: GPL-3.0-or-later
"""What drawing a direction costs on a GPU, for the kd-tree, inversion and alias tables.

    python docs/bench/cuda_samplers.py [--samples 500] [--counts]

With an NVIDIA GPU: frames per second of a sphere lit by the map, by map size and samples per pixel (the
paper's Figures 4 and 5). Without one: instructions, loads and 32-byte memory sectors per sample, counted by
executing the compiled kernels (PTX) on the processor; no times. That needs nvcc. Both need skytree_core.
"""

from __future__ import annotations

import argparse
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import skytree_core as sky
from ptx_counter import Kernel, Memory

ROOT = Path(__file__).resolve().parents[2]
METHODS = {
    "kdtree_fitted": lambda image: sky.KdTreeSampler(image),
    "kdtree_warp": lambda image: sky.KdTreeSampler(
        image, split_criterion="MIN_VARIANCE", block_probability="MIN_VARIANCE"
    ),
    "inversion_guided": lambda image: sky.InversionSampler(image),
    "inversion_binary": lambda image: sky.InversionSampler(image, method="binary"),
    "alias": lambda image: sky.AliasSampler(image),
    "uniform": lambda image: sky.UniformSampler(),
}
WIDTHS = (1024, 2048, 4096)


def synthetic_map(width: int) -> np.ndarray:
    """A sky with a sun and texture: the shape of an HDRI, at any size."""
    height = width // 2
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    u, v = u / width, v / height
    sky_part = 0.3 + 0.7 * np.exp(-3 * v) + 0.2 * np.sin(40 * u) * np.sin(25 * v)
    sun = 2e4 * np.exp(-((u - 0.3) ** 2 + (v - 0.25) ** 2 / 4) / 2e-5)
    noise = np.random.default_rng(1).random((height, width), dtype=np.float32) * 0.3
    return np.repeat((sky_part + sun + noise)[..., None], 3, axis=2).astype(np.float32)


def compile_ptx() -> str:
    nvcc = shutil.which("nvcc") or "/usr/local/cuda/bin/nvcc"
    if not Path(nvcc).exists():
        sys.exit("There is no GPU here, and nvcc, which counting needs, was not found.")
    source = Path(__file__).with_name("cuda_samplers.cu")
    command = [nvcc, "-std=c++17", "-fmad=false", "-arch=compute_75", f"-I{ROOT}", f"-I{ROOT / 'native'}"]
    done = subprocess.run([*command, "-ptx", "-o", "/dev/stdout", source], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"nvcc failed:\n{done.stderr}")
    return done.stdout


def count(kernel: Kernel, sampler, u: np.ndarray):
    """Instructions, loads and sectors of tables per sample; whether direction and pdf are the CPU's."""
    view, tables = sky._native._sampler_tables(sampler)
    memory = Memory()
    view = bytearray(view)
    for offset, data in tables:
        struct.pack_into("<Q", view, offset, memory.add(data))
    table_regions = len(tables)
    numbers = memory.add(np.ascontiguousarray(u, np.float32).tobytes())
    out = memory.add(bytes(16 * len(u)))
    param = memory.add(bytes(view) + struct.pack("<QQI", numbers, out, len(u)) + bytes(8))
    instructions = sectors = 0
    for thread in range(len(u)):
        instructions += kernel(memory, param, thread)
        sectors += sum(region < table_regions for region, _ in memory.sectors)
    loads = sum(n for region, n in memory.loads.items() if region < table_regions)
    drawn = np.frombuffer(bytes(memory.regions[table_regions + 1]), np.float32).reshape(-1, 4)
    directions, pdf = sampler.sample(u)
    same = np.array_equal(drawn[:, :3], directions) and np.array_equal(drawn[:, 3], pdf)
    return instructions / len(u), loads / len(u), sectors / len(u), same


def report_counts(samples: int):
    print(f"No GPU is used: {sky.cuda_problem() or 'counts were asked for'}")
    print(f"Executed PTX per sample, means of {samples} samples; tables alone are counted as memory.\n")
    columns = ["map", "method", "instructions", "loads", "32-byte sectors", "table bytes", "the CPU's bits"]
    print("|", " | ".join(columns), "|")
    print("|", " | ".join(["---"] * len(columns)), "|")
    ptx = compile_ptx()
    kernels = {name: Kernel(ptx, name) for name in METHODS}
    u = np.random.default_rng(5).random((samples, 3), dtype=np.float32)
    for width in WIDTHS:
        image = synthetic_map(width)
        for name, make in METHODS.items():
            sampler = make(image)
            instructions, loads, sectors, same = count(kernels[name], sampler, u)
            print(
                f"| {width}x{width // 2} | {name} | {instructions:.0f} | {loads:.1f} | {sectors:.1f} "
                f"| {sampler.nbytes} | {'yes' if same else 'NO'} |",
                flush=True,
            )


def sphere(rows: int = 64):
    theta, phi = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, rows), np.linspace(0, 2 * np.pi, 2 * rows), indexing="ij"
    )
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    a = (np.arange(rows - 1)[:, None] * 2 * rows + np.arange(2 * rows - 1)).reshape(-1, 1)
    triangles = np.concatenate([a + [0, 2 * rows, 2 * rows + 1], a + [0, 2 * rows + 1, 1]])
    return points.reshape(-1, 3).astype(np.float32), triangles.astype(np.int32)


def report_frames(gpu):
    print(f"{gpu.name}, 512x512 pixels, direct light\n")
    print("| map | method | samples per pixel | frames per second |\n| --- | --- | --- | --- |")
    points, triangles = sphere()
    for width in WIDTHS:
        image = synthetic_map(width)
        scene = sky.Scene()
        mesh = scene.add_mesh(points, triangles, corners=triangles, corner_normals=points)
        chrome = scene.add_material([{"type": "GLOSSY", "color": (0.9, 0.9, 0.9), "roughness": 0.3}])
        scene.add_instance(mesh, np.eye(4), [chrome])
        scene.set_camera(
            np.array([[1, 0, 0, 0], [0, 0, -1, -3], [0, 1, 0, 0], [0, 0, 0, 1]], float),
            np.array([[2.2, 0, 0, 0], [0, 2.2, 0, 0], [0, 0, -1.001, -0.2], [0, 0, -1, 0]]),
        )
        for name, make in METHODS.items():
            scene.set_environment(image, make(image))
            session = sky.RenderSession(1, device=gpu.id)
            for samples in (1, 4, 16, 64):
                seconds = []
                for _ in range(6):  # the first sends the scene
                    session.start(scene, 512, 512, samples, max_bounces=0)
                    session.wait(600)
                    if session.warning:
                        sys.exit(session.warning)
                    seconds.append(session.render_seconds)
                rate = 1 / np.median(seconds[1:])
                print(f"| {width}x{width // 2} | {name} | {samples} | {rate:.1f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=500, help="per method and map, for the counts")
    parser.add_argument("--counts", action="store_true", help="count even where there is a GPU")
    arguments = parser.parse_args()
    gpus = [device for device in sky.devices() if device.type == "CUDA"]
    if gpus and not arguments.counts:
        report_frames(gpus[0])
    else:
        report_counts(arguments.samples)


if __name__ == "__main__":
    main()
