# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints what blocks of linear density cost in variance, for docs/method.md.

    python docs/measure_linear_blocks.py MAP...

Variance per sample of irradiance without occlusion, averaged over planes that face the six axes, relative to
sampling the interpolated map exactly. It is computed, not sampled: squared cosines add up to 1 over the six
axes, so the second moment is the integral of L^2 / pdf, taken at 3 x 3 points of Gauss and Legendre in every
cell between texel centres.
"""

import argparse
import statistics
from pathlib import Path

import numpy as np
import skytree_core as sky

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
POINTS = np.array([0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5])
WEIGHTS = np.array([5, 8, 5]) / 18
CHOICE = ("MIN_VARIANCE", "MIN_VARIANCE")


class Quadrature:
    """Radiance, directions and weights at nine points of every cell."""

    def __init__(self, image: np.ndarray):
        luminance = image @ LUMINANCE
        height, width = luminance.shape
        padded = np.concatenate((luminance[:1], luminance, luminance[-1:]))
        padded = np.concatenate((padded, padded[:, :1]), axis=1)
        borders = np.concatenate(([0], (np.arange(height) + 0.5) / height, [1]))
        rise = np.diff(borders)
        self.rows = []
        for f, row_weight in zip(POINTS, WEIGHTS, strict=True):
            theta = np.pi * (borders[:-1] + f * rise)
            between = padded[:-1] * (1 - f) + padded[1:] * f
            for g, column_weight in zip(POINTS, WEIGHTS, strict=True):
                radiance = between[:, :-1] * (1 - g) + between[:, 1:] * g
                phi = 2 * np.pi * (0.5 - (np.arange(width) + 0.5 + g) / width)
                weight = row_weight * column_weight * 2 * np.pi**2 / width * rise * np.sin(theta)
                directions = np.empty((height + 1, width, 3), np.float32)
                directions[..., 0] = np.sin(theta)[:, None] * np.cos(phi)
                directions[..., 1] = np.sin(theta)[:, None] * np.sin(phi)
                directions[..., 2] = np.cos(theta)[:, None]
                self.rows.append((radiance.astype(np.float64), weight[:, None], directions))
        self.power = sum((w * light).sum() for light, w, _ in self.rows)
        irradiances = np.zeros(6)
        for light, w, directions in self.rows:
            for axis in range(3):
                for side in range(2):
                    cosine = np.maximum(directions[..., axis] * (1 - 2 * side), 0)
                    irradiances[2 * axis + side] += (w * light * cosine).sum()
        self.means = (irradiances**2).sum()

    def variance(self, sampler) -> float:
        square = sum(
            (w * light**2 / sampler.pdf(directions.reshape(-1, 3)).reshape(light.shape)).sum()
            for light, w, directions in self.rows
        )
        return (square - self.means) / (self.power**2 - self.means)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("maps", nargs="+", type=Path)
    arguments = parser.parse_args()
    columns = ["texels (alias)", "constant 256", "linear 256", "constant 1024", "linear 1024", "linear AUTO"]
    print("| map | " + " | ".join(columns) + " | blocks of AUTO |")
    print("|---" * (len(columns) + 2) + "|")
    rows = []
    for path in arguments.maps:
        image = np.clip(np.nan_to_num(sky.read_image(path), nan=0, posinf=0, neginf=0), 0, None)
        quadrature = Quadrature(image)
        automatic = sky.KdTreeSampler(image, "AUTO", *CHOICE)
        samplers = [sky.AliasSampler(image)]
        for count in (256, 1024):
            samplers.append(sky.KdTreeSampler(image, count, *CHOICE, block_density="CONSTANT"))
            samplers.append(sky.KdTreeSampler(image, count, *CHOICE))
        rows.append([quadrature.variance(sampler) for sampler in (*samplers, automatic)])
        cells = " | ".join(f"{v:.3f}" for v in rows[-1])
        print(f"| {path.stem} | {cells} | {automatic.block_count} |", flush=True)
    for title, pick in (("median", statistics.median), ("worst", max)):
        print(
            f"| **{title}** | "
            + " | ".join(f"{pick(column):.3f}" for column in zip(*rows, strict=True))
            + " | |"
        )


if __name__ == "__main__":
    main()
