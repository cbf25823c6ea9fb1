# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 2: the blocks' probabilities in descending order and the one-parameter model of them, for every map;
alpha by least squares, by likelihood and by least second moment. Ergun, Kurt, Ozturk, SCCG 2012."""

from __future__ import annotations

import numpy as np
import plots
import skytree_core
from context import Context
from stage import BLOCKS

TITLE = "Figure 2: empirical and fitted pdf"
OBJECTIVES = {
    "LEAST_SQUARES": ("least squares", "#1f4e79", "-"),
    "LIKELIHOOD": ("likelihood", "#4c9a6a", "--"),
    "SECOND_MOMENT": ("second moment", "#8a5fa8", ":"),
}
PAPERS = ("uffizi", "doge2")


def make(context: Context) -> None:
    shown = context.maps.some(*PAPERS)
    entries = shown if context.quick else context.maps.all
    context.expect(len(entries))
    trees, rows = {}, []
    for entry in entries:
        tree = skytree_core.KdTreeSampler(entry.image(), BLOCKS, "SSE", "FITTED", statistics="PIXELS")
        fits = {name: skytree_core.fit_rank_model(tree.empirical, name) for name in OBJECTIVES}
        trees[entry.name] = (tree.empirical, fits)
        rows += [row_of(entry.name, tree.empirical, name, fit) for name, fit in fits.items()]
        context.step()
    context.table("figure2", rows)
    context.table("figure2_medians", medians(rows))
    context.plot("figure2", papers_pair([entry.name for entry in shown], trees))
    context.plot("figure2_all", all_maps(trees))


def row_of(name: str, empirical: np.ndarray, objective: str, fit) -> dict:
    model = skytree_core.rank_probabilities(fit.alpha, len(empirical))
    positive = empirical > 0
    return {
        "map": name,
        "blocks": len(empirical),
        "objective": objective,
        "alpha": fit.alpha,
        "rms_residual": fit.rms_error,
        "largest_residual": float(np.abs(model - empirical).max()),
        "kl_divergence": fit.kl_divergence,
        "largest_ratio": fit.largest_ratio,
        "rank_of_largest_ratio": int(np.argmax(empirical / model)) + 1,
        "smallest_ratio": float((empirical[positive] / model[positive]).min()),
        "second_moment": fit.second_moment,
    }


def medians(rows: list[dict]) -> list[dict]:
    """Over all maps; `worst` is the largest."""
    found = []
    for objective in OBJECTIVES:
        of = [row for row in rows if row["objective"] == objective]
        entry = {"objective": objective, "maps": len(of)}
        for column in ("alpha", "kl_divergence", "largest_ratio", "second_moment"):
            values = [row[column] for row in of]
            entry |= {f"{column}_median": float(np.median(values)), f"{column}_worst": max(values)}
        found.append(entry)
    return found


def papers_pair(names: list[str], trees: dict):
    figure, axes = plots.axes_grid(2, len(names), 5.8 * len(names), 7.4)
    for column, name in enumerate(names):
        empirical, fits = trees[name]
        for row in (0, 1):
            draw(axes[row * len(names) + column], empirical, fits, logarithmic=row == 1)
        axes[column].set_title(f"{name}: the first blocks, linear", fontsize=10)
        axes[column].set_xlim(-1, min(150, len(empirical)))
        axes[len(names) + column].set_title("all blocks, both axes logarithmic", fontsize=10)
        axes[column].legend(frameon=False, fontsize=9)
    axes[0].set_ylabel("probability of the block")
    figure.suptitle(f"Probabilities of {BLOCKS} blocks and the model 1 / (log(1 + n/α)(α + x))", fontsize=12)
    figure.tight_layout()
    return figure


def all_maps(trees: dict):
    columns = 4
    rows = -(-len(trees) // columns)
    figure, axes = plots.axes_grid(rows, columns, 13, 2.3 * rows + 0.7, sharex=True)
    for axis, (name, (empirical, fits)) in zip(axes, trees.items(), strict=False):
        draw(axis, empirical, fits, logarithmic=True, size=2)
        axis.set_title(name, fontsize=9)
        axis.tick_params(labelsize=7)
        axis.set_xlabel("")
    for axis in axes[len(trees) :]:
        axis.set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    names = [label.split(":")[0] for label in labels]
    figure.legend(handles, names, loc="lower center", ncol=4, frameon=False, fontsize=9)
    figure.tight_layout(rect=(0, 0.35 / (2.3 * rows + 0.7), 1, 1))
    return figure


def draw(axis, empirical: np.ndarray, fits: dict, logarithmic: bool, size: float = 3) -> None:
    ranks = np.arange(1, len(empirical) + 1)
    color = plots.COLORS["empirical"]
    axis.plot(ranks, empirical, ".", ms=size, color=color, label="empirical: sorted shares of the light")
    for name, fit in fits.items():
        title, color, style = OBJECTIVES[name]
        model = skytree_core.rank_probabilities(fit.alpha, len(empirical))
        axis.plot(ranks, model, style, lw=1.5, color=color, label=f"{title}: α = {fit.alpha:.4g}")
    axis.set_xlabel("rank of the block")
    if logarithmic:
        axis.set_xscale("log")
        axis.set_yscale("log")
        lowest = empirical[empirical > 0].min()
        models = [skytree_core.rank_probabilities(fit.alpha, len(empirical)) for fit in fits.values()]
        highest = max(empirical[0], *(model[0] for model in models))
        axis.set_ylim(max(lowest, 1e-7) / 2, 2 * highest)
