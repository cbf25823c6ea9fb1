# SPDX-License-Identifier: GPL-3.0-or-later
"""The methods of the related work beside each other on one scene, at equal samples (docs/related.md)."""

from __future__ import annotations

import math

import metrics
import numpy as np
import pictures
import plots
import skytree_core
import stage
from context import Context

TITLE = "The methods of the related work"
SAMPLES = (1, 4, 16, 64)
SHOWN = 16
SEEDS = 2  # errors are means over these
COLUMNS = 5


def methods(image: np.ndarray) -> dict[str, tuple[str, object, dict]]:
    """Key to (title, sampler, options of the session)."""
    tree = stage.build("kdtree", image)
    return {
        "uniform": ("Uniform", skytree_core.UniformSampler(), {}),
        "bsdf": ("BSDF samples alone", tree, {"light_sampling": False}),
        "light": ("Kd-tree alone, no MIS", tree, {"bsdf_sampling": False}),
        "median_cut": (
            "Median cut",
            skytree_core.KdTreeSampler(image, stage.BLOCKS, "MEDIAN_CUT", "EXACT"),
            {},
        ),
        "hierarchical": ("Hierarchical warp", skytree_core.HierarchySampler(image), {}),
        "inversion": ("Inversion", stage.build("inversion", image), {}),
        "kdtree_paper": ("Kd-tree (paper)", stage.build("kdtree_paper", image), {}),
        "kdtree": ("Kd-tree (default)", tree, {}),
        "resampled": ("Resampled, 8 candidates", tree, {"candidates": 8}),
        "filtered": ("Filtered (biased)", skytree_core.FilteredMap(image, SHOWN), {}),
    }


def make(context: Context) -> None:
    entry = context.maps.named("uffizi")
    image = entry.image()
    width, height, reference_samples = (80, 60, 128) if context.quick else (208, 156, 512)
    scene = stage.teapot_stage(image, width, height)
    compared = methods(image)
    context.expect(2 + len(compared))
    halves = stage.reference_halves(
        scene, reference_samples, sampler=stage.build("alias", image), max_bounces=0
    )
    context.step(2)
    rows, tiles = [], []
    reference = (halves[0] + halves[1]) / 2
    exposure = pictures.exposure_for(reference)
    for name, (title, sampler, options) in compared.items():
        shown = None
        for samples in SAMPLES:
            errors = []
            for seed in range(SEEDS):
                picture = scene.render(sampler, samples, seed, max_bounces=0, **options).image
                errors.append(metrics.error_figures(picture, *halves))
                if seed == 0 and samples == SHOWN:
                    shown = picture
            rows.append({"map": entry.name, "method": name, "samples": samples, "nbytes": sampler.nbytes})
            rows[-1] |= {
                key: math.sqrt(sum(e[key] ** 2 for e in errors) / SEEDS) for key in ("nrmse", "nrmse_tc")
            }
        error = next(r["nrmse_tc"] for r in rows if r["method"] == name and r["samples"] == SHOWN)
        tiles.append((pictures.view(shown, exposure), f"{title}\nerror {error:.1%}"))
        context.step()
    context.table("methods", rows)
    grid = [tiles[start : start + COLUMNS] for start in range(0, len(tiles), COLUMNS)]
    sheet = plots.labelled_grid(grid, f"{entry.name}: {SHOWN} samples per pixel, direct light")
    context.picture("methods", sheet)
    plot(context, rows, compared)


def plot(context: Context, rows: list[dict], compared: dict) -> None:
    """Error against samples: slopes show what stratification is left, a floor shows bias."""
    figure, (axes,) = plots.axes_grid(1, 1, 7.2, 4.4, layout="constrained")
    for index, (name, (title, _, _)) in enumerate(compared.items()):
        mine = [row for row in rows if row["method"] == name]
        style = "--" if name == "filtered" else "-"
        color = f"C{index}"
        axes.loglog(
            [row["samples"] for row in mine],
            [row["nrmse_tc"] for row in mine],
            style,
            color=color,
            marker="o",
            markersize=3,
            label=title,
        )
    axes.set(
        xlabel="samples per pixel", ylabel="error (trimmed, relative)", xticks=SAMPLES, xticklabels=SAMPLES
    )
    axes.legend(fontsize=7, ncol=2)
    context.plot("methods_convergence", figure)
