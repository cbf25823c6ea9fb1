# SPDX-License-Identifier: GPL-3.0-or-later
"""What each step from plain next-event estimation to the best mode is worth: error at equal samples,
processor time of a pixel sample, efficiency 1 / (nRMSE^2 time) relative to the first line. Direct light of
small scenes, without Blender:

    build/venv/bin/python docs/bench/estimators.py HDRI [--samples 4 16 64] [--scenes spheres room chrome]

With --light-rays the steps are best mode with one to four of them instead, and with as many as it measures
to pay.

Needs skytree_core (`./build_addon.py package` installs it into build/venv).
"""

from __future__ import annotations

import argparse
import math

import numpy as np
import skytree_core as core

BLOCKS = {"split_criterion": "MIN_VARIANCE", "block_probability": "MIN_VARIANCE"}
BEST_BLOCKS = {**BLOCKS, "compensation": 0.5}


def adding(options: dict, steps: dict) -> list[tuple[str, dict, dict]]:
    """Steps of best mode's blocks, each with the options of those before it."""
    added = []
    for name, more in steps.items():
        options = options | more
        added.append((name, BEST_BLOCKS, options))
    return added


# Name, sampler, arguments of RenderSession.start.
STEPS = [
    ("paper: SSE blocks, fitted alpha", {}, {}),
    ("constant blocks", {**BLOCKS, "block_density": "CONSTANT"}, {}),
    ("linear blocks", BLOCKS, {}),
    *adding(
        {},
        {
            "+ compensation": {},
            "+ control variate": {"control_variate": True},
            "+ four light rays": {"light_rays": 4},
            "+ product sampling": {"product_sampling": True},
            "+ learnt visibility": {"learn_visibility": True},
            "+ adaptive sampling": {"adaptive_sampling": True},
            "+ light rays as measured": {"light_rays": 0},
        },
    ),
]
BEST = STEPS[-1]
# How many light rays pay; 0: as measured.
LIGHT_RAYS = [
    (f"best, light rays: {n or 'as measured'}", BEST_BLOCKS, BEST[2] | {"light_rays": n})
    for n in (1, 2, 3, 4, 0)
]


def sphere(columns: int = 64, rows: int = 32) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = np.meshgrid(np.pi * np.arange(rows + 1) / rows, 2 * np.pi * np.arange(columns) / columns)
    theta, phi = theta.T, phi.T
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    i, k = np.divmod(np.arange(rows * columns), columns)
    a, b = i * columns + k, i * columns + (k + 1) % columns
    triangles = np.concatenate(
        [np.stack([a, a + columns, b + columns], -1), np.stack([a, b + columns, b], -1)]
    )
    triangles = triangles[np.concatenate([i < rows - 1, i > 0])]  # those at the poles have no area
    return points.reshape(-1, 3).astype(np.float32), triangles.astype(np.int32)


def add_quad(scene: core.Scene, corners: list, material: int) -> None:
    mesh = scene.add_mesh(np.array(corners, np.float32), np.array([(0, 1, 2), (0, 2, 3)], np.int32))
    scene.add_instance(mesh, np.eye(4), [material])


def add_sphere(scene: core.Scene, center: tuple, radius: float, material: int) -> None:
    points, triangles = sphere()
    mesh = scene.add_mesh(points, triangles, corner_normals=points, corners=triangles)
    matrix = np.diag([radius, radius, radius, 1.0])
    matrix[:3, 3] = center
    scene.add_instance(mesh, matrix, [material])


def look(scene: core.Scene, eye: tuple, target: tuple, field_of_view: float) -> None:
    z = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    x = np.cross((0, 0, 1), z) / np.linalg.norm(np.cross((0, 0, 1), z))
    matrix = np.eye(4)
    matrix[:3, :] = np.stack([x, np.cross(z, x), z, eye], -1)
    w = math.tan(field_of_view / 2)
    projection = np.array([[1 / w, 0, 0, 0], [0, 4 / 3 / w, 0, 0], [0, 0, -1.0002, -0.20002], [0, 0, -1, 0]])
    scene.set_camera(matrix, projection)


def spheres(scene: core.Scene) -> None:
    """The benchmark scene: grey ground, a diffuse, a glossy 0.2 and a glossy 0.5 sphere."""
    grey = scene.add_material([{"type": "DIFFUSE", "color": (0.5, 0.5, 0.5)}])
    add_quad(scene, [(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)], grey)
    closures = [
        {"type": "DIFFUSE", "color": (0.8, 0.8, 0.8)},
        {"type": "GLOSSY", "color": (0.9, 0.9, 0.9), "roughness": 0.2},
        {"type": "GLOSSY", "color": (0.9, 0.9, 0.9), "roughness": 0.5},
    ]
    for x, closure in zip((-2.2, 0.0, 2.2), closures, strict=True):
        add_sphere(scene, (x, 0, 1), 1.0, scene.add_material([closure]))
    look(scene, (0, -7.5, 5.5), (0, 0.2, 0.55), 2 * math.atan(18 / 40))


def chrome(scene: core.Scene) -> None:
    """A nearly smooth ball on a grey ground: its noise is that of BSDF samples."""
    grey = scene.add_material([{"type": "DIFFUSE", "color": (0.5, 0.5, 0.5)}])
    add_quad(scene, [(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)], grey)
    metal = scene.add_material([{"type": "GLOSSY", "color": (0.9, 0.9, 0.9), "roughness": 0.1}])
    add_sphere(scene, (0, 0, 1), 1.0, metal)
    look(scene, (0, -5, 2), (0, 0, 0.9), 0.6)


def room(scene: core.Scene) -> None:
    """A diffuse room lit through one window in the wall at x = 3."""
    white = scene.add_material([{"type": "DIFFUSE", "color": (0.7, 0.7, 0.7)}])
    for z in (0, 3):
        add_quad(scene, [(-3, -3, z), (3, -3, z), (3, 3, z), (-3, 3, z)], white)
    for a, b in (((-3, -3), (-3, 3)), ((-3, -3), (3, -3)), ((-3, 3), (3, 3))):
        add_quad(scene, [(*a, 0), (*b, 0), (*b, 3), (*a, 3)], white)
    for y0, y1, z0, z1 in ((-3, 3, 0, 0.8), (-3, 3, 2.2, 3), (-3, -1, 0.8, 2.2), (1, 3, 0.8, 2.2)):
        add_quad(scene, [(3, y0, z0), (3, y1, z0), (3, y1, z1), (3, y0, z1)], white)
    add_sphere(scene, (0, 1, 0.7), 0.7, white)
    look(scene, (-2.8, -2.6, 1.6), (1, 0.6, 1), 1.3)


SCENES = {"spheres": spheres, "room": room, "chrome": chrome}


def render(session, scene, size, samples, **options) -> tuple[np.ndarray, float]:
    """The picture, by default of direct light, and microseconds of processor time per pixel sample."""
    session.start(scene, *size, samples, **{"max_bounces": 0, "pixel_filter": "BOX"} | options)
    session.wait(1e6)
    if session.error:
        raise RuntimeError(session.error)
    pixels = np.array(session.pixels()[..., :3], np.float64)
    return pixels, 1e6 * session.stats["cpu_seconds"] / (size[0] * size[1] * samples)


def error(pixels: np.ndarray, reference: np.ndarray) -> float:
    """nRMSE without the worst 0.1 % of the pixels."""
    squares = np.sort(((pixels - reference) ** 2).mean(-1), axis=None)
    return math.sqrt(squares[: int(0.999 * squares.size)].mean()) / reference.mean()


def measure(name: str, steps, image: np.ndarray, size, counts, seeds: int, reference_samples: int) -> None:
    scene = core.Scene()
    SCENES[name](scene)
    scene.set_environment(image, core.KdTreeSampler(image, **BEST[1]))
    session = core.RenderSession(1)
    reference, _ = render(session, scene, size, reference_samples, seed=991, **BEST[2])
    samplers = [core.KdTreeSampler(image, **arguments) for _, arguments, _ in steps]
    print(f"\n{name}: nRMSE at {', '.join(map(str, counts))} samples; us per pixel sample; efficiency")
    squares = np.zeros((len(steps), len(counts)))
    times = np.full((len(steps), len(counts)), np.inf)
    for seed in range(seeds):  # interleaved, so that a busy machine is busy for all
        for i, (_, _, options) in enumerate(steps):
            for k, count in enumerate(counts):
                pixels, time = render(session, scene, size, count, seed=seed, sampler=samplers[i], **options)
                squares[i, k] += error(pixels, reference) ** 2 / seeds
                times[i, k] = min(times[i, k], time)
    efficiency = 1 / (squares * times)
    for i, (label, _, _) in enumerate(steps):
        errors = " ".join(f"{math.sqrt(e):.4f}" for e in squares[i])
        gains = " ".join(f"{g:.2f}" for g in efficiency[i] / efficiency[0])
        print(f"{label:34} {errors}   {times[i, -1]:.3f}   {gains}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("hdri")
    parser.add_argument("--samples", type=int, nargs="+", default=[4, 16, 64])
    parser.add_argument("--size", type=int, nargs=2, default=[80, 60])
    parser.add_argument("--scenes", nargs="+", default=["spheres", "room"], choices=list(SCENES))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--light-rays", action="store_true", help="numbers of light rays instead of the steps"
    )
    parser.add_argument("--reference", type=int, default=4096, help="samples of the reference")
    a = parser.parse_args()
    image = core.read_image(a.hdri)
    for name in a.scenes:
        measure(name, LIGHT_RAYS if a.light_rays else STEPS, image, a.size, a.samples, a.seeds, a.reference)


if __name__ == "__main__":
    main()
