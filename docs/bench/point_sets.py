# SPDX-License-Identifier: GPL-3.0-or-later
"""Correlated multi-jittered points against Sobol's: squared error and processor time at equal samples, every
pixel with the same number, all estimators but adaptive sampling. Without Blender:

    build/venv/bin/python docs/bench/point_sets.py HDRI [--scenes spheres room] [--samples 4 16 64 256]

Needs skytree_core (`./build_addon.py package` installs it into build/venv).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import skytree_core as core
from estimators import BEST_BLOCKS, SCENES, error, render

OPTIONS = {"control_variate": True, "product_sampling": True, "learn_visibility": True}


def measure(name: str, title: str, image: np.ndarray, arguments: argparse.Namespace) -> None:
    scene = core.Scene()
    SCENES[name](scene)
    scene.set_environment(image, core.KdTreeSampler(image, **BEST_BLOCKS))
    session = core.RenderSession(1)
    size, options = arguments.size, OPTIONS | {"max_bounces": arguments.bounces}
    reference, _ = render(session, scene, size, arguments.reference, seed=991, light_rays=2, **options)
    for light_rays in (1, 2):
        ratios, times = [], []
        for count in arguments.samples:
            squares, least = {}, {}
            for seed in range(max(2, arguments.seeds // count)):
                for points in ("SOBOL", "CMJ"):  # in turn, so that a busy machine is busy for both
                    pixels, time = render(
                        session,
                        scene,
                        size,
                        count,
                        seed=seed,
                        light_rays=light_rays,
                        point_set=points,
                        **options,
                    )
                    squares.setdefault(points, []).append(error(pixels, reference) ** 2)
                    least[points] = min(time, least.get(points, time))
            ratios.append(np.mean(squares["CMJ"]) / np.mean(squares["SOBOL"]))
            times.append(least["CMJ"] / least["SOBOL"])
        print(
            f"| {name}, {title} | {light_rays} | "
            + " | ".join(f"{ratio:.2f}" for ratio in ratios)
            + " | "
            + " / ".join(f"{time:.2f}" for time in times)
            + " |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("hdri", nargs="+")
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--samples", type=int, nargs="+", default=[4, 16, 64, 256])
    parser.add_argument("--bounces", type=int, default=0)
    parser.add_argument("--size", type=int, nargs=2, default=[80, 60])
    parser.add_argument("--seeds", type=int, default=256, help="of one sample; at N samples an Nth")
    parser.add_argument("--reference", type=int, default=4096, help="samples of the reference")
    arguments = parser.parse_args()
    counts = " | ".join(f"{count} spp" for count in arguments.samples)
    print(f"| CMJ / Sobol: squared error | light rays | {counts} | time |")
    print("|" + "---|" * (len(arguments.samples) + 3))
    for path in arguments.hdri:
        for name in arguments.scenes:
            measure(name, Path(path).stem, core.read_image(path), arguments)


if __name__ == "__main__":
    main()
