# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints what the methods of the related work cost or gain, for docs/related.md.

    python docs/measure_related.py MAP... [--samples 200000]

Irradiance on an unoccluded surface, over six orientations. The first table has variances per traced ray
relative to drawing texels exactly in proportion to their interpolated luminance (AliasSampler, independent
numbers): 1 is as noisy, below 1 better. Columns with "of 256" take 256 stratified samples at once; 256 times
the variance of their mean is shown. The second table has the errors of the biased methods: root mean square
over 400 orientations in per cent of the mean irradiance, without any noise.
"""

import argparse
import statistics
from pathlib import Path

import numpy as np
import skytree_core as sky
from measure_variance import NORMALS, interpolated_luminance

GROUP = 256
CANDIDATES = 8
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


def spread(estimates):
    """Variance of (n, normals) estimates, mean over the normals."""
    return np.asarray(estimates, np.float64).var(axis=0).mean()


def independent(sampler, light, count, seed):
    generator = np.random.default_rng(seed)
    directions, pdf = sampler.sample(generator.random((count, 3), dtype=np.float32))
    return spread((light(directions) / pdf)[:, None] * np.maximum(directions @ NORMALS.T, 0))


def stratified(sampler, light, count, seed):
    groups = count // GROUP
    u = np.concatenate([sky.stratified(GROUP, seed * 100003 + group) for group in range(groups)])
    directions, pdf = sampler.sample(u)
    estimates = (light(directions) / pdf)[:, None] * np.maximum(directions @ NORMALS.T, 0)
    return GROUP * spread(estimates.reshape(groups, GROUP, -1).mean(axis=1))


def resampled(sampler, light, count, seed):
    generator = np.random.default_rng(seed)
    variances = []
    for normal in NORMALS:

        def product(directions, normal=normal):
            return light(directions) * np.maximum(directions @ normal, 0)

        u = generator.random((count // len(NORMALS), CANDIDATES, 3), dtype=np.float32)
        directions, weights = sky.resampled(sampler, product, u, generator.random(len(u)))
        variances.append((product(directions) * weights).var())
    return np.mean(variances)


def cosine_directions(normal, u):
    """Directions about `normal` with density cosine / pi."""
    tangent = np.roll(normal, 1)
    bitangent = np.cross(normal, tangent)
    radius, angle = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    height = np.sqrt(1 - u[:, 0])
    return (
        np.outer(radius * np.cos(angle), tangent)
        + np.outer(radius * np.sin(angle), bitangent)
        + np.outer(height, normal)
    ).astype(np.float32)


def bsdf_alone(light, count, seed):
    generator = np.random.default_rng(seed)
    return np.mean(
        [np.pi**2 * light(cosine_directions(n, generator.random((count // 6, 2)))).var() for n in NORMALS]
    )


def balance_heuristic(sampler, light, count, seed):
    """One light and one BSDF sample; per ray, of which it takes two."""
    generator = np.random.default_rng(seed)
    variances = []
    for normal in NORMALS:
        by_light, pdf = sampler.sample(generator.random((count // 6, 3), dtype=np.float32))
        by_bsdf = cosine_directions(normal, generator.random((count // 6, 2)))
        total = 0.0
        for directions, density in ((by_light, pdf), (by_bsdf, sampler.pdf(by_bsdf))):
            cosine = np.maximum(directions @ normal, 0)
            total = total + light(directions) * cosine / (density + cosine / np.pi)
        variances.append(2 * total.var())
    return np.mean(variances)


def sphere_points(count):
    """Directions spread evenly over the sphere."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)


def exact_irradiance(image, normals):
    """Sums over 2 x 2 points in each texel of the interpolated map: (normals,) luminance."""
    height, width = 2 * image.shape[0], 2 * image.shape[1]
    result = np.zeros(len(normals))
    phi = np.pi * (1 - 2 * (np.arange(width) + 0.5) / width)
    for row in range(height):
        theta = (row + 0.5) * np.pi / height
        solid_angle = 2 * np.pi / width * (np.cos(row * np.pi / height) - np.cos((row + 1) * np.pi / height))
        directions = np.stack(
            [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.full(width, np.cos(theta))], axis=1
        )
        light = interpolated_luminance(image, directions.astype(np.float32)) * solid_angle
        result += np.maximum(directions @ normals.T, 0).T @ light
    return result


def biases(image):
    """Errors in per cent of the methods that have them."""
    normals = sphere_points(400)
    exact = exact_irradiance(image, normals)
    harmonics = sky.harmonic_irradiance(sky.harmonic_coefficients(image), normals) @ LUMINANCE
    answers = {"9 harmonics": harmonics}
    for count in (64, 1024):
        directions, power = sky.KdTreeSampler(image, count, "MEDIAN_CUT", "EXACT").point_lights()
        answers[f"{count} point lights"] = np.maximum(normals @ directions.T, 0) @ (power @ LUMINANCE)
    offsets = np.random.default_rng(7).random((len(normals), 2))
    lattice = np.stack([(np.arange(4096) + 0.5) / 4096, np.arange(4096) * 0.6180339887498949 % 1], axis=1)
    for samples in (16, 256):
        filtered = sky.FilteredMap(image, samples)
        estimates = []
        for normal, offset in zip(normals, offsets, strict=True):
            other = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
            tangent = np.cross(normal, other) / np.linalg.norm(np.cross(normal, other))
            frame = np.stack([tangent, np.cross(normal, tangent), normal])
            local = cosine_directions(np.array([0.0, 0.0, 1.0]), (lattice + offset) % 1)
            pdf = np.maximum(local[:, 2], 1e-4) / np.pi
            light = filtered.lookup(image, (local @ frame).astype(np.float32), pdf.astype(np.float32))
            estimates.append(np.pi * (light @ LUMINANCE).mean())
        answers[f"filtered, {samples}"] = np.array(estimates)
    return {
        name: 100 * np.sqrt(np.mean((value - exact) ** 2)) / exact.mean() for name, value in answers.items()
    }, harmonics.min() < 0


def variances(image, count):
    def light(directions):
        return interpolated_luminance(image, directions)

    alias, tree = (
        sky.AliasSampler(image),
        sky.KdTreeSampler(image, 1024, "MIN_VARIANCE", "MIN_VARIANCE", block_density="CONSTANT"),
    )
    hierarchy = sky.HierarchySampler(image)
    exact = independent(alias, light, count, 1)
    found = {
        "kd-tree": independent(tree, light, count, 2),
        "hierarchical": independent(hierarchy, light, count, 2),
        "median cut 64": independent(sky.KdTreeSampler(image, 64, "MEDIAN_CUT", "EXACT"), light, count, 2),
        "median cut 1024": independent(
            sky.KdTreeSampler(image, 1024, "MEDIAN_CUT", "EXACT"), light, count, 2
        ),
        "alias, of 256": stratified(alias, light, count, 3),
        "kd-tree, of 256": stratified(tree, light, count, 3),
        "hierarchical, of 256": stratified(hierarchy, light, count, 3),
        "resampled 8": resampled(tree, light, count, 4),
        "BSDF alone": bsdf_alone(light, count, 5),
        "kd-tree and BSDF, MIS": balance_heuristic(tree, light, count, 6),
    }
    return {name: value / exact for name, value in found.items()}


def print_table(rows, last, digits):
    columns = list(next(iter(rows.values())))
    print("| map | " + " | ".join(columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(digits(row[column]) for column in columns) + " |")
    for title, pick in last:
        print(
            f"| **{title}** | "
            + " | ".join(digits(pick([r[c] for r in rows.values()])) for c in columns)
            + " |"
        )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("maps", nargs="+", type=Path)
    parser.add_argument("--samples", type=int, default=200_000)
    arguments = parser.parse_args()
    by_variance, by_bias, negative = {}, {}, []
    for path in arguments.maps:
        image = np.clip(np.nan_to_num(sky.read_image(path), nan=0, posinf=0, neginf=0), 0, None)
        by_variance[path.stem] = variances(image, arguments.samples)
        by_bias[path.stem], has_negative = biases(image)
        negative += [path.stem] if has_negative else []
    last = (("median", statistics.median), ("worst", max))
    print("Variance per traced ray\n")
    print_table(by_variance, last, lambda v: f"{v:.2f}" if v < 10 else f"{v:.0f}")
    print("\nError without noise, per cent\n")
    print_table(by_bias, last, lambda v: f"{v:.2g}" if v < 10 else f"{v:.0f}")
    print("\nHarmonics below zero in some direction:", ", ".join(negative) or "none")


if __name__ == "__main__":
    main()
