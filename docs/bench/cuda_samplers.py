# SPDX-License-Identifier: GPL-3.0-or-later
"""What drawing a direction costs on a GPU, for the kd-tree, inversion and alias tables.

    ./build_addon.py bench --only cuda [--samples 500] [--map FILE ...]

With an NVIDIA GPU: nanoseconds per direction of a kernel that does nothing else, and frames per second of
the renderer by map, method and samples per pixel (the paper's Figures 4 and 5). With and without one:
instructions, loads and 32-byte memory sectors per direction, counted by executing the compiled kernels (PTX)
on the processor, which needs nvcc. Writes build/reports/cuda_samplers.csv and docs/cuda_samplers.md.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import os
import shutil
import struct
import subprocess
import sys
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from statistics import median

import cuda_samplers_page
import numpy as np
import skytree_core as sky
from ptx_counter import Kernel, Memory

ROOT = Path(__file__).resolve().parents[2]
REPORT = ROOT / "build" / "reports" / "cuda_samplers.csv"
PAGE = ROOT / "docs" / "cuda_samplers.md"
METHODS = {
    "kdtree_fitted": lambda image: sky.KdTreeSampler(image, 1024),
    "kdtree_warp": lambda image: least_variance_tree(image, "CONSTANT"),
    "kdtree_linear": lambda image: least_variance_tree(image, "LINEAR"),
    "inversion_guided": lambda image: sky.InversionSampler(image),
    "inversion_binary": lambda image: sky.InversionSampler(image, method="binary"),
    "alias": lambda image: sky.AliasSampler(image),
    "uniform": lambda image: sky.UniformSampler(),
}
WIDTHS = (1024, 2048, 4096)
SAMPLES_PER_PIXEL = (1, 4, 16, 64)  # 16: the paper's Figure 4
FRAME_SIZE = 512
TIMED_THREADS, TIMED_SAMPLES = 1 << 20, 256  # of one launch of the microbenchmark


@dataclass(frozen=True)
class Row:
    """One figure: a line of the CSV."""

    map: str
    method: str
    samples_per_pixel: int  # 0: it is about one direction
    quantity: str
    value: float


def least_variance_tree(image: np.ndarray, block_density: str) -> sky.KdTreeSampler:
    criteria = {"split_criterion": "MIN_VARIANCE", "block_probability": "MIN_VARIANCE"}
    return sky.KdTreeSampler(image, 1024, block_density=block_density, **criteria)


def synthetic_map(width: int) -> np.ndarray:
    """A sky with a sun and texture: the shape of an HDRI, at any size."""
    height = width // 2
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    u, v = u / width, v / height
    sky_part = 0.3 + 0.7 * np.exp(-3 * v) + 0.2 * np.sin(40 * u) * np.sin(25 * v)
    sun = 2e4 * np.exp(-((u - 0.3) ** 2 + (v - 0.25) ** 2 / 4) / 2e-5)
    noise = np.random.default_rng(1).random((height, width), dtype=np.float32) * 0.3
    return np.repeat((sky_part + sun + noise)[..., None], 3, axis=2).astype(np.float32)


def compile_ptx(nvcc: str) -> str:
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


def counts(nvcc: str, samples: int, maps: dict[str, np.ndarray]) -> list[Row]:
    ptx = compile_ptx(nvcc)
    kernels = {name: Kernel(ptx, name) for name in METHODS}
    u = np.random.default_rng(5).random((samples, 3), dtype=np.float32)
    rows = []
    for map_name, image in maps.items():
        for method, make in METHODS.items():
            sampler = make(image)
            *costs, same = count(kernels[method], sampler, u)
            if not same:
                sys.exit(f"{method}, {map_name}: the kernel drew other directions than the CPU does.")
            figures = (*costs, sampler.nbytes)
            quantities = cuda_samplers_page.COUNTS
            rows += [Row(map_name, method, 0, *pair) for pair in zip(quantities, figures, strict=True)]
            said = ", ".join(f"{f:.4g} {q}" for q, f in zip(quantities, figures, strict=True))
            print(f"{map_name}, {method}: {said}", flush=True)
    return rows


def sphere(rows: int = 64):
    theta, phi = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, rows), np.linspace(0, 2 * np.pi, 2 * rows), indexing="ij"
    )
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    a = (np.arange(rows - 1)[:, None] * 2 * rows + np.arange(2 * rows - 1)).reshape(-1, 1)
    triangles = np.concatenate([a + [0, 2 * rows, 2 * rows + 1], a + [0, 2 * rows + 1, 1]])
    return points.reshape(-1, 3).astype(np.float32), triangles.astype(np.int32)


def times(gpu, maps: dict[str, np.ndarray]) -> list[Row]:
    """Of the kernel that draws directions and does nothing else."""
    ordinal, rows = int(gpu.id.partition(":")[2]), []
    for map_name, image in maps.items():
        for method, make in METHODS.items():
            seconds, _ = sky._native._time_sampler(make(image), ordinal, TIMED_THREADS, TIMED_SAMPLES, 9)
            nanoseconds = 1e9 * median(seconds) / (TIMED_THREADS * TIMED_SAMPLES)
            rows.append(Row(map_name, method, 0, "ns per direction", nanoseconds))
            print(f"{map_name}, {method}: {nanoseconds:.4f} ns per direction", flush=True)
    return rows


def frames(gpu, maps: dict[str, np.ndarray]) -> list[Row]:
    """Of the renderer: a chrome sphere lit by the map, direct light."""
    points, triangles = sphere()
    scene = sky.Scene()
    mesh = scene.add_mesh(points, triangles, corners=triangles, corner_normals=points)
    chrome = scene.add_material([{"type": "GLOSSY", "color": (0.9, 0.9, 0.9), "roughness": 0.3}])
    scene.add_instance(mesh, np.eye(4), [chrome])
    scene.set_camera(
        np.array([[1, 0, 0, 0], [0, 0, -1, -3], [0, 1, 0, 0], [0, 0, 0, 1]], float),
        np.array([[2.2, 0, 0, 0], [0, 2.2, 0, 0], [0, 0, -1.001, -0.2], [0, 0, -1, 0]]),
    )
    rows = []
    for map_name, image in maps.items():
        for method, make in METHODS.items():
            scene.set_environment(image, make(image))
            session = sky.RenderSession(1, device=gpu.id)
            for samples in SAMPLES_PER_PIXEL:
                seconds = []
                for _ in range(6):  # the first sends the scene
                    session.start(scene, FRAME_SIZE, FRAME_SIZE, samples, max_bounces=0)
                    session.wait(600)
                    if session.warning:
                        sys.exit(session.warning)
                    seconds.append(session.render_seconds)
                rate = 1 / median(seconds[1:])
                rows.append(Row(map_name, method, samples, "frames per second", rate))
                print(f"{map_name}, {method}, {samples} samples per pixel: {rate:.1f} fps", flush=True)
    return rows


def gpu_and_reason():
    """The GPU to measure, or None and why there is nothing to measure."""
    gpus = [device for device in sky.devices() if device.type == "CUDA"]
    if not gpus:
        return None, sky.cuda_problem()
    driver = ctypes.CDLL(os.environ.get("SKYTREE_CUDA_DRIVER") or "libcuda.so.1")
    if hasattr(driver, "cuemuCounter"):
        return None, "The CUDA driver here executes kernels on the processor: its times mean nothing."
    return gpus[0], None


def read_maps(files: list[Path]) -> dict[str, np.ndarray]:
    maps = {f"synthetic {width}x{width // 2}": synthetic_map(width) for width in WIDTHS}
    for file in files:
        image = sky.read_image(str(file))
        maps[f"{file.stem} {image.shape[1]}x{image.shape[0]}"] = image
    return maps


def read_csv(file: Path) -> list[Row]:
    with file.open(newline="") as lines:
        return [
            Row(r["map"], r["method"], int(r["samples_per_pixel"]), r["quantity"], float(r["value"]))
            for r in csv.DictReader(lines)
        ]


def write_csv(rows: list[Row], report: Path):
    report.parent.mkdir(parents=True, exist_ok=True)
    with report.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Row)])
        writer.writerows(astuple(row) for row in rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=200, help="directions per method and map to count")
    parser.add_argument("--map", type=Path, nargs="*", default=[], help="more maps than the synthetic ones")
    parser.add_argument("--nvcc", default=shutil.which("nvcc"), help="CUDA's compiler (default: on PATH)")
    parser.add_argument("--page", type=Path, default=PAGE, help="the page to write")
    parser.add_argument("--csv", type=Path, default=REPORT, help="the table to write")
    parser.add_argument("--times", type=Path, help="take the times from such a table of another machine …")
    parser.add_argument("--gpu", help="… and this name of its GPU")
    arguments = parser.parse_args()
    if bool(arguments.times) != bool(arguments.gpu):
        parser.error("--times and --gpu belong together")
    maps = read_maps(arguments.map)
    gpu, reason = gpu_and_reason()
    rows, name = [], gpu.name if gpu else None
    if arguments.times:
        rows += [row for row in read_csv(arguments.times) if row.quantity in cuda_samplers_page.TIMES]
        name = arguments.gpu
    elif gpu:
        print(f"Times on {gpu.name}:", flush=True)
        rows += times(gpu, maps) + frames(gpu, maps)
    else:
        print(f"No GPU: {reason} So there are no times; counted instead:", flush=True)
    if arguments.nvcc:
        rows += counts(arguments.nvcc, arguments.samples, maps)
    else:
        print("nvcc, which counting needs, was not found.", flush=True)
    write_csv(rows, arguments.csv)
    page = cuda_samplers_page.page(rows, name, reason, arguments.samples)
    arguments.page.write_text(page)
    print(f"\n{page}")


if __name__ == "__main__":
    main()
