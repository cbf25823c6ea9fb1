# SPDX-License-Identifier: GPL-3.0-or-later
"""The closing claim of Ergun, Kurt and Ozturk (SCCG 2012), "can be extended to multi-dimensional functions
such as BRDFs": spheres lit through BSDF samples alone, by the models' own sampling and by kd-trees over their
tables, with errors at equal samples and bytes."""

from __future__ import annotations

import math

import figure6
import numpy as np
import pictures
import plots
import shapes
import skytree_core
import stage
from context import Context

TITLE = "BRDFs: kd-trees in three and four dimensions"
SAMPLES = 16
SEEDS = 4
COLOR = (0.85, 0.85, 0.85)
# Name, the model's closure, its table.
MATERIALS = {
    "Ward 0.2": ("WARD", 0.2, 0.2),
    "Ward 0.02": ("WARD", 0.02, 0.02),
    "Ward 0.4, 0.05": ("WARD", 0.4, 0.05),
    "Ward 0.5, 0.001": ("WARD", 0.5, 0.001),
    "GGX 0.3": ("GGX", 0.3, 0.3),
    "GGX 0.4, 0.1": ("GGX", 0.4, 0.1),
}
TREES = {
    "kdtree": ("Kd-tree", {}),
    "kdtree_paper": (
        "Kd-tree (paper)",
        {"split_criterion": "SSE", "block_probability": "FITTED"},
    ),
    "one_block": ("One block", {"block_count": 1, "slice_count": 1}),
}


def closure_of(model: str, alpha_x: float, alpha_y: float) -> dict:
    if model == "WARD":
        return {"type": "WARD", "color": COLOR, "alpha_x": alpha_x, "alpha_y": alpha_y}
    # GLOSSY's anisotropy divides alpha on one axis and multiplies it on the other; negative: wide along x.
    ratio = math.sqrt(alpha_y / alpha_x)
    alpha = math.sqrt(alpha_x * alpha_y)
    return {"type": "GLOSSY", "color": COLOR, "roughness": math.sqrt(alpha), "anisotropy": ratio - 1}


def sphere(image: np.ndarray, size: int, closure: dict, brdf=None) -> stage.Stage:
    made = stage.Stage(image, size, size, light_from=math.radians(-50))
    if brdf is not None:
        closure = {"type": "TABULATED", "color": COLOR, "brdf": made.scene.add_brdf(brdf)}
    made.add(shapes.sphere(64), closure)
    made.look(position=(0, -6.0, 0.6), target=(0, 0, 0), lens=88)
    return made


def make(context: Context) -> None:
    entry = context.maps.named("uffizi")
    image = entry.image()
    white = np.ones((2, 4, 3), np.float32)
    size, reference_samples = (64, 32) if context.quick else (192, 96)
    sampler = stage.build("alias", image)
    context.expect(len(MATERIALS) * (2 + len(TREES)) + 1)
    context.table("brdf_stretch", stretch_rows())
    context.step()
    grid, rows, times = [], [], []
    for material, (model, alpha_x, alpha_y) in MATERIALS.items():
        closure = closure_of(model, alpha_x, alpha_y)
        make_table = skytree_core.BrdfTable.ward if model == "WARD" else skytree_core.BrdfTable.ggx
        table = make_table(alpha_x, alpha_y)
        trees = {name: skytree_core.BrdfKdTree(table, **options) for name, (_, options) in TREES.items()}
        stages = {"analytic": (sphere(image, size, closure), sphere(white, size, closure))}
        for name, tree in trees.items():
            stages[name] = sphere(image, size, closure, tree), sphere(white, size, closure, tree)
        halves = {
            name: stage.reference_halves(stages[name][0], reference_samples, sampler=sampler, max_bounces=0)
            for name in ("analytic", "kdtree")
        }
        model_mean, table_mean = (sum(halves[name]) / 2 for name in ("analytic", "kdtree"))
        mask = stages["analytic"][0].render(sampler, 4, max_bounces=0, film_transparent=True).alpha > 0.999
        table_error = np.abs(table_mean - model_mean)[mask].mean() / model_mean[mask].mean()
        context.step()
        images = {}
        for name, (lit, furnace) in stages.items():
            # Each against its own converged picture: what the table differs from the model is no noise.
            reference = halves["analytic" if name == "analytic" else "kdtree"]
            renders = [bsdf_samples(lit, sampler, seed) for seed in range(SEEDS)]
            images[name] = renders[0]
            row = {"material": material, "method": name, "samples": SAMPLES}
            row |= figure6.errors(renders, reference, mask)
            row["furnace_deviation"] = furnace_deviation(furnace, mask)
            row["tree_bytes"] = trees[name].nbytes if name in trees else 0
            row["table_bytes"] = table.nbytes if name in trees else 0
            row["blocks"] = trees[name].block_count if name in trees else 0
            row["slices"] = trees[name].slice_count if name in trees else 0
            row["table_error"] = float(table_error) if name in trees else 0.0
            rows.append(row)
            if name in trees:
                times.append(
                    {"material": material, "method": name, "build_seconds": trees[name].build_seconds}
                )
            context.step()
        own = rows[-len(stages) :]
        for row in own:
            row["nrmse_tc_over_analytic"] = row["nrmse_tc"] / own[0]["nrmse_tc"]
        grid.append(line(images, table_mean, own))
    context.table("brdf", rows)
    context.table("brdf_times", times)
    title = f"{entry.name}: {SAMPLES} BSDF samples per pixel, no light samples"
    context.picture(
        "brdf", plots.labelled_grid(grid, title, [name.replace(" ", "\n", 1) for name in MATERIALS])
    )


def bsdf_samples(made: stage.Stage, sampler, seed: int) -> np.ndarray:
    return made.render(sampler, SAMPLES, seed, max_bounces=0, light_sampling=False).image


def furnace_deviation(made: stage.Stage, mask: np.ndarray) -> float:
    """Standard deviation of one BSDF sample's weight over its mean, all over the sphere: noise of the
    sampling alone, without a map."""
    uniform = skytree_core.UniformSampler()
    renders = np.stack(
        [made.render(uniform, 1, seed, max_bounces=0, light_sampling=False).image[mask] for seed in range(32)]
    )
    return float(np.sqrt(renders.var(axis=0, ddof=1).mean()) / renders.mean())


def stretch_rows() -> list[dict]:
    """What an elongated lobe's table and tree lose if the lobe is not made round in them, as no measured one
    is: over views from 0 to 70 degrees, albedo, mean difference of values, deviation of a sample's weight."""
    rng = np.random.default_rng(1)
    height, azimuth = rng.uniform(0.34, 1, 40000), rng.uniform(0, 2 * np.pi, 40000)
    radius = np.sqrt(1 - height**2)
    views = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1).astype(np.float32)
    numbers = rng.random((40000, 2))
    rows = []
    for alphas in ((0.4, 0.1), (0.4, 0.05), (0.5, 0.01)):
        tables = {on: skytree_core.BrdfTable.ward(*alphas, stretched=on) for on in (True, False)}
        for on, table in tables.items():
            tree = skytree_core.BrdfKdTree(table)
            directions, pdf = tree.sample(views, numbers)
            above = pdf > 0
            where = views[above], directions[above]
            scale = directions[above, 2] / pdf[above]
            weights = np.zeros(len(pdf))
            weights[above] = table.evaluate(*where)[:, 0] * scale
            difference = np.abs(tables[True].evaluate(*where)[:, 0] * scale - weights[above]).mean()
            row = {"material": f"Ward {alphas[0]}, {alphas[1]}", "stretched": "yes" if on else "no"}
            row |= {"albedo": float(weights.mean()), "deviation": float(weights.std() / weights.mean())}
            rows.append(row | {"value_difference": float(difference / weights.mean())})
    return rows


def line(images: dict, reference: np.ndarray, rows: list[dict]) -> list:
    exposure = pictures.exposure_for(reference)
    tiles = [(pictures.view(reference, exposure), "Table, converged\n ")]
    for row in rows:
        name = row["method"]
        title = TREES[name][0] if name in TREES else "Model's formula"
        text = f"{title}\nerror {row['nrmse_tc']:.0%}, {row['tree_bytes'] / 1000:.0f} kB"
        tiles.append((pictures.view(images[name], exposure), text))
    return tiles
