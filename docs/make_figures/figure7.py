# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 7: an extremely anisotropic sphere by reference, kd-tree and filtered importance sampling (Ergun,
Kurt and Ozturk, SCCG 2012; Krivanek and Colbert, CGF 27(4), 2008), beside a round lobe, for which the filter
is made."""

from __future__ import annotations

import figure6
import plots
import skytree_core
import stage
from context import Context

TITLE = "Figure 7: anisotropic Ward, filtered importance sampling"
INPUTS = ("figure6.py",)
SAMPLES = 64
SEEDS = 4
MATERIALS = {
    "Ward 0.5 × 0.001": {"type": "WARD", "color": (0.9, 0.9, 0.9), "alpha_x": 0.5, "alpha_y": 0.001},
    "Ward 0.2 × 0.2": {"type": "WARD", "color": (0.9, 0.9, 0.9), "alpha_x": 0.2, "alpha_y": 0.2},
}
TITLES = {
    "kdtree_paper": "Kd-tree (paper)",
    "kdtree": "Kd-tree (default)",
    "bsdf": "BSDF samples alone",
    "filtered": "Filtered (biased)",
    "filtered_bias": "Filtered, no noise",
}


def make(context: Context) -> None:
    entry = context.maps.named("uffizi")
    image = entry.image()
    size, reference_samples = (80, 256) if context.quick else (192, 512)
    filtered = skytree_core.FilteredMap(image, SAMPLES)
    samplers = {name: stage.build(name, image) for name in ("kdtree_paper", "kdtree")}
    samplers |= {"bsdf": skytree_core.UniformSampler(), "filtered": filtered}
    reference_sampler = stage.build("alias", image)
    context.expect(6 * len(MATERIALS))
    grid, rows = [], []
    for material, closure in MATERIALS.items():
        scene = stage.sphere_stage(image, size, closure)
        halves = stage.reference_halves(scene, reference_samples, sampler=reference_sampler, max_bounces=0)
        mask = scene.render(reference_sampler, 4, max_bounces=0, film_transparent=True).alpha > 0.999
        context.step(3)
        renders = {
            name: [
                scene.render(sampler, SAMPLES, seed, max_bounces=0, light_sampling=name != "bsdf").image
                for seed in range(SEEDS)
            ]
            for name, sampler in samplers.items()
        }
        context.step()
        # What is left of the error where there is no noise: the bias.
        renders["filtered_bias"] = [scene.render(filtered, reference_samples, 77, max_bounces=0).image]
        context.step(2)
        row = []
        for name, found in renders.items():
            samples = reference_samples if name == "filtered_bias" else SAMPLES
            row.append({"map": entry.name, "material": material, "method": name, "samples": samples})
            row[-1] |= figure6.errors(found, halves, mask)
        rows += row
        images = {name: found[0] for name, found in renders.items()}
        grid.append(figure6.line(images, (halves[0] + halves[1]) / 2, row, TITLES))
    context.table("figure7", rows)
    row_titles = [material.replace(" ", "\n", 1) for material in MATERIALS]
    title = f"{entry.name}: {SAMPLES} samples per pixel, the filter made for {SAMPLES}"
    context.picture("figure7", plots.labelled_grid(grid, title, row_titles))
