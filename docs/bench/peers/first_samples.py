#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Which settings look best in the first samples of a preview: FLIP at 1 to 16 samples per pixel.

    python docs/bench/peers/first_samples.py [--picture FILE]

From build/venv, with dist/skytree-*.zip and build/bpy-4.5. A table by variant goes to the terminal and to
build/reports/first_samples.json, the picture to docs/images/blue_noise.png.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "demo")]
import matplotlib  # noqa: E402
from cases import Case  # noqa: E402
from demo import bundled_map, newest_zip  # noqa: E402
from measuring import MIDDLE_GREY, display, image_figures  # noqa: E402
from peers import BLENDER, REPORTS, ROOT, open_blender  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

BEST, PAPER = "Skytree, best, even", "Skytree, paper"  # viewports do not sample adaptively
BLUE = {"blue_noise": True}
PREVIEW_FILTER = {"pixel_filter": "BLACKMAN_HARRIS", "filter_width": 1.5}
# Name: method, settings over it. The pixel filter decides which reference it is held against.
VARIANTS = {
    "best": (BEST, {}),
    "best, blue noise": (BEST, BLUE),
    "paper": (PAPER, {}),
    "paper, blue noise": (PAPER, BLUE),
    "inversion, blue noise": (BEST, {**BLUE, "sampler": "INVERSION"}),
    "texel alias table, blue noise": (BEST, {**BLUE, "sampler": "ALIAS"}),
    "best, Blackman-Harris 1.5": (BEST, PREVIEW_FILTER),
    "best, Blackman-Harris 1.5, blue noise": (BEST, {**PREVIEW_FILTER, **BLUE}),
}
CASES = (Case("spheres", "city"), Case("suzanne", "interior"))
SAMPLES = (1, 2, 4, 8, 16)
SEEDS = (0, 1)
REFERENCE_SAMPLES = 256  # of each half
FIGURES = ("flip", "nrmse_tc")


def measure(renderers, case: Case, console: Console) -> tuple[dict, dict]:
    """-> {variant: {samples: {figure: mean over seeds}}}, {(variant, samples): image of seed 0}."""
    renderers.open(case, bundled_map(BLENDER, f"{case.map}.exr"))
    halves: dict[str, list[np.ndarray]] = {}
    found, images = {}, {}
    for name, (method, settings) in VARIANTS.items():
        kind = settings.get("pixel_filter", "BOX")
        if kind not in halves:
            filtered = PREVIEW_FILTER if kind != "BOX" else {}
            halves[kind] = [
                renderers.render(case, BEST, REFERENCE_SAMPLES, 1001 + half, filtered)[0] for half in (0, 1)
            ]
            images[kind] = (halves[kind][0] + halves[kind][1]) / 2
        found[name] = {}
        for samples in SAMPLES:
            rendered = [renderers.render(case, method, samples, seed, settings)[0] for seed in SEEDS]
            figures = [image_figures(image, halves[kind]) for image in rendered]
            found[name][samples] = {f: statistics.mean(x[f] for x in figures) for f in FIGURES}
            images[name, samples] = rendered[0]
        console.print(f"{case.key}: {name}", highlight=False)
    return found, images


def draw(images: dict, file: Path) -> None:
    """Rows: without, with blue noise; columns: the picture and its error at 1 and at 4 samples."""
    reference = images["BOX"]
    exposure = MIDDLE_GREY / reference.mean()
    figure, axes = plt.subplots(2, 4, figsize=(13, 5.4))
    for row, name in enumerate(("best", "best, blue noise")):
        for pair, samples in enumerate((1, 4)):
            image = images[name, samples]
            error = exposure * (image - reference).mean(axis=2)
            axes[row, 2 * pair].imshow(display(exposure * image), interpolation="nearest")
            limit = 0.6 / samples**0.7
            axes[row, 2 * pair + 1].imshow(
                error, cmap="gray", vmin=-limit, vmax=limit, interpolation="nearest"
            )
            axes[row, 2 * pair].set_title(f"{name}, {samples} spp", fontsize=10)
            axes[row, 2 * pair + 1].set_title("its error", fontsize=10)
    for axis in axes.flat:
        axis.set_axis_off()
    figure.tight_layout()
    figure.savefig(file, dpi=120)
    plt.close(figure)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "images" / "blue_noise.png")
    arguments, console = parser.parse_args(), Console()
    report = {}
    with open_blender(newest_zip().resolve()) as renderers:
        for case in CASES:
            report[case.key], images = measure(renderers, case, console)
            if case is CASES[0]:
                draw(images, arguments.picture)
    REPORTS.mkdir(parents=True, exist_ok=True)
    (REPORTS / "first_samples.json").write_text(json.dumps(report, indent=1) + "\n")
    for figure in FIGURES:
        for key, found in report.items():
            table = Table("", *(f"{n} spp" for n in SAMPLES), title=f"{key}: {figure}")
            for name, by in found.items():
                table.add_row(name, *(f"{by[n][figure]:.4f}" for n in SAMPLES))
            console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
