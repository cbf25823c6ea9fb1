# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints how much variance each choice of constant blocks and probabilities costs, for docs/method.md.

    python docs/measure_variance.py MAP... [--blocks 1024] [--samples 2000000]

For every map and combination: the variance per sample of the irradiance on an unoccluded surface, averaged
over six orientations, over that of drawing texels exactly in proportion to their interpolated luminance
(AliasSampler). 1 is as good as a table of every texel. The spread of the alias sampler against itself with
other random numbers is printed as `noise`.
"""

import argparse
import statistics
from pathlib import Path

import numpy as np
import skytree_core as sky

CHOICES = {
    "RANGE FITTED": ("RANGE", "FITTED"),
    "VARIANCE FITTED": ("VARIANCE", "FITTED"),
    "SSE FITTED": ("SSE", "FITTED"),
    "SSE EXACT": ("SSE", "EXACT"),
    "SSE MIN_VARIANCE": ("SSE", "MIN_VARIANCE"),
    "MIN_VARIANCE FITTED": ("MIN_VARIANCE", "FITTED"),
    "MIN_VARIANCE EXACT": ("MIN_VARIANCE", "EXACT"),
    "MIN_VARIANCE": ("MIN_VARIANCE", "MIN_VARIANCE"),
}
NORMALS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)


def interpolated_luminance(image, directions):
    """Bilinear between texel centres, wrapping in u, clamped at the poles."""
    luminance = image @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    height, width = luminance.shape
    x = (0.5 - np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi)) * width - 0.5
    theta = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
    y = np.clip(theta / np.pi * height - 0.5, 0, height - 1)
    x0, y0 = np.floor(x).astype(int), y.astype(int)
    fx, fy = x - x0, y - y0
    y1 = np.minimum(y0 + 1, height - 1)
    top = luminance[y0, x0 % width] * (1 - fx) + luminance[y0, (x0 + 1) % width] * fx
    bottom = luminance[y1, x0 % width] * (1 - fx) + luminance[y1, (x0 + 1) % width] * fx
    return top * (1 - fy) + bottom * fy


def variance(sampler, image, count, seed):
    """Of one sample's estimate of irradiance, mean over NORMALS; and the largest weight over its mean."""
    generator = np.random.default_rng(seed)
    sums, squares, largest = np.zeros(len(NORMALS)), np.zeros(len(NORMALS)), 0.0
    for _ in range(0, count, 1 << 18):
        directions, pdf = sampler.sample(generator.random((1 << 18, 3), dtype=np.float32))
        weight = interpolated_luminance(image, directions) / pdf
        largest = max(largest, weight.max() / weight.mean())
        estimates = weight[:, None] * np.maximum(directions @ NORMALS.T, 0)
        sums += estimates.sum(axis=0, dtype=np.float64)
        squares += (estimates.astype(np.float64) ** 2).sum(axis=0)
    n = (count + (1 << 18) - 1) // (1 << 18) * (1 << 18)
    return (squares / n - (sums / n) ** 2).mean(), largest


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("maps", nargs="+", type=Path)
    parser.add_argument("--blocks", type=int, default=1024)
    parser.add_argument("--samples", type=int, default=2_000_000)
    arguments = parser.parse_args()
    columns = ["noise", "UNIFORM", *CHOICES]
    print("| map | " + " | ".join(columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    rows = {name: [] for name in columns}
    weights = {name: [] for name in columns}
    for path in arguments.maps:
        image = np.clip(np.nan_to_num(sky.read_image(path), nan=0, posinf=0, neginf=0), 0, None)
        alias = sky.AliasSampler(image)
        exact = variance(alias, image, arguments.samples, 1)[0]
        samplers = {"noise": alias, "UNIFORM": sky.UniformSampler()}
        for name, choice in CHOICES.items():
            samplers[name] = sky.KdTreeSampler(image, arguments.blocks, *choice, block_density="CONSTANT")
        for name, sampler in samplers.items():
            value, largest = variance(sampler, image, arguments.samples, 2)
            rows[name].append(value / exact)
            weights[name].append(largest)
        cells = [f"{rows[name][-1]:.{2 if rows[name][-1] < 10 else 0}f}" for name in columns]
        print(f"| {path.stem} | " + " | ".join(cells) + " |", flush=True)
    for title, pick in (("median", statistics.median), ("worst", max)):
        print(f"| **{title}** | " + " | ".join(f"{pick(rows[name]):.2f}" for name in columns) + " |")
    print(
        "| largest weight, median | "
        + " | ".join(f"{statistics.median(weights[n]):.3g}" for n in columns)
        + " |"
    )


if __name__ == "__main__":
    main()
