# SPDX-License-Identifier: GPL-3.0-or-later
"""The two figures of `bench --peers`: error against time, and efficiency over the best peer by case."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from analysis import JUDGED, Result, geometric_mean
from cases import METHODS, SAMPLES
from matplotlib.ticker import NullFormatter

STYLES = {
    "Skytree, best": {"color": "#d1495b", "marker": "o", "linewidth": 2.2, "zorder": 5},
    "Skytree, best, even": {"color": "#d1495b", "marker": "o", "linestyle": "--", "linewidth": 1},
    "Skytree, paper": {"color": "#edae49", "marker": "o"},
    "Cycles": {"color": "#00798c", "marker": "s"},
    "Mitsuba, independent": {"color": "#9aa5b1", "marker": "^"},
    "Mitsuba, multijitter": {"color": "#30638e", "marker": "^"},
}
RATIO_TICKS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})


def draw(results: list[Result], folder: Path, name: str) -> list[Path]:
    """Writes NAME-error.png and NAME-ratio.png."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for part, figure in (("error", error_figure(results)), ("ratio", ratio_figure(results))):
        file = folder / f"{name}-{part}.png"
        figure.savefig(file, dpi=130)
        plt.close(figure)
        made.append(file)
    return made


def title_of(scene: str, bounces: int) -> str:
    return f"{scene}, {bounces} bounces" if bounces else scene


def error_figure(results: list[Result]):
    """A panel a scene: nRMSE_tc against microseconds a pixel, geometric means over the maps."""
    groups = list(dict.fromkeys((r.case.scene, r.case.bounces) for r in results))
    columns = min(4, len(groups))
    count = -(-len(groups) // columns)
    size = (max(3.1 * columns, 6.2), 2.8 * count + 0.5)
    figure, axes = plt.subplots(count, columns, figsize=size, squeeze=False, layout="constrained")
    for axis in axes.flat[len(groups) :]:
        axis.set_axis_off()
    for axis, (scene, bounces) in zip(axes.flat, groups, strict=False):
        chosen = [r for r in results if (r.case.scene, r.case.bounces) == (scene, bounces)]
        for method in METHODS:
            times = [geometric_mean([n * r.microseconds(method) for r in chosen]) for n in SAMPLES]
            errors = [geometric_mean([r.error(method, n) for r in chosen]) for n in SAMPLES]
            spreads = [geometric_mean([max(r.spread(method, n), 1e-6) for r in chosen]) for n in SAMPLES]
            axis.errorbar(times, errors, yerr=spreads, markersize=4, label=method, **STYLES[method])
        axis.set(xscale="log", yscale="log", title=title_of(scene, bounces))
        axis.grid(which="major", alpha=0.3)
        axis.yaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel("processor time, µs a pixel")
    for axis in axes[:, 0]:
        axis.set_ylabel("nRMSE_tc")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncol=3 if columns < 3 else 6, frameon=False)
    return figure


def ratio_figure(results: list[Result]):
    """A row a case: efficiency of best mode over the best peer at each judged sample count."""
    figure, axis = plt.subplots(figsize=(8, 0.2 * len(results) + 1.6))
    labels = [f"{title_of(r.case.scene, r.case.bounces)}, {r.case.map}" for r in results]
    for n, color in zip(JUDGED, ("#f4a6b0", "#d1495b", "#7a1f30"), strict=True):
        ratios = [r.over_best_peer("Skytree, best", n) for r in results]
        axis.plot(ratios, range(len(results)), "o", color=color, markersize=5, label=f"{n} spp")
    axis.axvline(1, color="#555555", linewidth=1)
    axis.axvline(5, color="#555555", linewidth=1, linestyle=":")
    axis.set_yticks(range(len(results)), labels)
    axis.invert_yaxis()
    axis.set(
        xscale="log", xlabel="efficiency of Skytree's best mode over the best peer (1: equal; dotted: 5×)"
    )
    axis.set_xticks([x for x in RATIO_TICKS if axis.get_xlim()[0] <= x <= axis.get_xlim()[1]])
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.grid(axis="y", alpha=0.25)
    axis.legend(frameon=False, ncol=len(JUDGED), loc="lower right", bbox_to_anchor=(1, 1))
    figure.tight_layout()
    return figure
