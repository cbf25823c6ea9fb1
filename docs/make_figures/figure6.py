# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 6: spheres of several materials by reference, inversion and kd-tree, with scaled differences as
insets (Ergun, Kurt and Ozturk, SCCG 2012)."""

from __future__ import annotations

import metrics
import numpy as np
import pictures
import plots
import stage
from context import Context
from PIL import Image, ImageDraw

TITLE = "Figure 6: spheres of several materials"
SAMPLES = 16
SEEDS = 4  # errors are means over these
COMPARED = ("inversion", "kdtree_paper", "kdtree")
TITLES = {"inversion": "Inversion", "kdtree_paper": "Kd-tree (paper)", "kdtree": "Kd-tree (default)"}
MATERIALS = {
    "Diffuse": {"type": "DIFFUSE", "color": (0.66, 0.17, 0.1)},
    "Plastic": {"type": "PRINCIPLED", "color": (0.02, 0.16, 0.5), "roughness": 0.3},
    "Glossy 0.5": {"type": "GLOSSY", "color": (0.75, 0.75, 0.75), "roughness": 0.5},
    "Gold 0.3": {"type": "GLOSSY", "color": (1.0, 0.72, 0.32), "roughness": 0.3},
    "Ward 0.4/0.1": {"type": "WARD", "color": (0.72, 0.74, 0.78), "alpha_x": 0.4, "alpha_y": 0.1},
}


def make(context: Context) -> None:
    entry = context.maps.named("uffizi")
    image = entry.image()
    size, reference_samples = (80, 64) if context.quick else (192, 256)
    samplers = {name: stage.build(name, image) for name in COMPARED}
    reference_sampler = stage.build("alias", image)
    context.expect(5 * len(MATERIALS))
    grid, rows = [], []
    for material, closure in MATERIALS.items():
        scene = stage.sphere_stage(image, size, closure)
        halves = stage.reference_halves(scene, reference_samples, sampler=reference_sampler, max_bounces=0)
        mask = scene.render(reference_sampler, 4, max_bounces=0, film_transparent=True).alpha > 0.999
        context.step(4)
        images = {}
        for name, sampler in samplers.items():
            renders = [scene.render(sampler, SAMPLES, seed, max_bounces=0).image for seed in range(SEEDS)]
            images[name] = renders[0]
            rows.append({"map": entry.name, "material": material, "method": name, "samples": SAMPLES})
            rows[-1] |= errors(renders, halves, mask)
        context.step()
        for row in rows[-len(COMPARED) :]:
            row["nrmse_tc_over_inversion"] = row["nrmse_tc"] / rows[-len(COMPARED)]["nrmse_tc"]
        grid.append(line(images, (halves[0] + halves[1]) / 2, rows[-len(COMPARED) :]))
    context.table("figure6", rows)
    sheet = plots.labelled_grid(grid, f"{entry.name}: {SAMPLES} samples per pixel", list(MATERIALS))
    context.picture("figure6", sheet)


def errors(renders: list[np.ndarray], halves, mask: np.ndarray) -> dict[str, float]:
    """Over the sphere alone; root mean squares over the renders."""
    found = [
        metrics.error_figures(*(picture[mask][None] for picture in (render, *halves))) for render in renders
    ]
    return {
        key: float(np.sqrt(np.mean([f[key] ** 2 for f in found]))) for key in ("nrmse", "nrmse_tc", "relmse")
    }


def line(
    images: dict, reference: np.ndarray, rows: list[dict], titles: dict[str, str] = TITLES
) -> list[tuple[Image.Image, str]]:
    """One material: the reference and every method with its difference as an inset."""
    exposure = pictures.exposure_for(reference)
    factor = pictures.difference_factor(reference, images.values(), exposure)
    tiles = [(pictures.view(reference, exposure), "Reference\n ")]
    for row in rows:
        image = images[row["method"]]
        tile = pictures.view(image, exposure)
        inset = pictures.difference(image, reference, exposure, factor)
        inset = inset.resize((tile.width * 2 // 5, tile.height * 2 // 5), Image.Resampling.BOX)
        corner = (tile.width - inset.width, tile.height - inset.height)
        ImageDraw.Draw(tile).rectangle((corner[0] - 2, corner[1] - 2, *tile.size), pictures.PAPER)
        tile.paste(inset, corner)
        text = f"{titles[row['method']]}\nerror {row['nrmse_tc']:.1%}, inset × {factor:g}"
        tiles.append((tile, text))
    return tiles
