# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 3: the chrome-steel teapot at 16 samples per pixel, inversion and kd-tree, at equal samples and at
equal time (Ergun, Kurt and Ozturk, SCCG 2012)."""

from __future__ import annotations

import metrics
import numpy as np
import pictures
import plots
import stage
from context import Context
from PIL import Image

TITLE = "Figure 3: the chrome-steel teapot"
SAMPLES = 16
SEEDS = 4  # errors are means over these
COMPARED = ("inversion", "kdtree_paper", "kdtree")


def make(context: Context) -> None:
    entry = context.maps.named("uffizi")
    image = entry.image()
    width, height, reference_samples = (160, 96, 64) if context.quick else (320, 192, 256)
    rounds = 1 if context.quick else 3
    context.expect(5 + 2 * SEEDS)
    scene = stage.teapot_stage(image, width, height)
    samplers = {name: stage.build(name, image) for name in COMPARED}
    halves = stage.reference_halves(scene, reference_samples, sampler=stage.build("alias", image))
    context.step(4)

    def error(name: str, samples: int) -> tuple[np.ndarray, dict]:
        """The image with seed 0, and the errors' root mean squares over SEEDS."""
        images = [scene.render(samplers[name], samples, seed).image for seed in range(SEEDS)]
        figures = [metrics.error_figures(picture, *halves) for picture in images]
        means = {
            key: float(np.sqrt(np.mean([f[key] ** 2 for f in figures])))
            for key in ("nrmse", "nrmse_tc", "relmse")
        }
        return images[0], means

    times = stage.fastest(scene, samplers, SAMPLES, rounds)
    context.step()
    equal, rows = {}, []
    for name in COMPARED:
        equal[name] = error(name, SAMPLES)
        context.step(SEEDS / len(COMPARED))
        row = {"map": entry.name, "method": name, "samples": SAMPLES, **equal[name][1]}
        row |= {"table_bytes": samplers[name].nbytes, "blocks": getattr(samplers[name], "block_count", 0)}
        rows.append(row | {"renders": SEEDS, "reference_samples": 2 * reference_samples})
    ratio_to(rows, "nrmse_tc")
    context.table("figure3", rows)
    context.picture("figure3", sheet(f"{entry.name}: {SAMPLES} samples per pixel", halves, equal, {}))

    timed, time_rows = {}, []
    for name in COMPARED:
        samples = max(1, round(SAMPLES * times["inversion"].seconds / times[name].seconds))
        timed[name] = error(name, samples)
        context.step(SEEDS / len(COMPARED))
        row = {"map": entry.name, "device": stage.devices()["CPU"], "method": name}
        row |= {"seconds_of_16_samples": times[name].seconds, "samples_in_equal_time": samples}
        time_rows.append(row | timed[name][1])
    ratio_to(time_rows, "nrmse_tc")
    context.table("figure3_times", time_rows)
    counts = {row["method"]: row["samples_in_equal_time"] for row in time_rows}
    context.picture(
        "figure3_times",
        sheet(f"{entry.name}: the time of {SAMPLES} samples by inversion", halves, timed, counts),
    )


def ratio_to(rows: list[dict], column: str) -> None:
    """Adds what each error is times inversion's."""
    for row in rows:
        row[f"{column}_over_inversion"] = row[column] / rows[0][column]


def sheet(title: str, halves, rendered: dict, counts: dict[str, int]) -> Image.Image:
    """The reference and each method, and below each method its scaled difference."""
    reference = (halves[0] + halves[1]) / 2
    exposure = pictures.exposure_for(reference)
    factor = pictures.difference_factor(reference, [image for image, _ in rendered.values()], exposure)
    first = [(pictures.view(reference, exposure), "Reference\n ")]
    blank = Image.new("RGB", first[0][0].size, pictures.PAPER)
    second = [(blank, "")]
    for name, (image, figures) in rendered.items():
        count = f"{counts[name]} samples, " if counts else ""
        first.append(
            (pictures.view(image, exposure), f"{stage.METHODS[name]}\n{count}error {figures['nrmse_tc']:.1%}")
        )
        second.append((pictures.difference(image, reference, exposure, factor), f"\nDifference × {factor:g}"))
    return plots.labelled_grid([first, second], title)
