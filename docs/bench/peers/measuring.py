# SPDX-License-Identifier: GPL-3.0-or-later
"""One case: its references, the rounds in which all methods take turns, and the figures of every image."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

import flip_evaluator
import numpy as np
from cases import METHODS, REFERENCES, SAMPLES, SEEDS, Case
from stores import Renderers, make_reference, reference_files, rendered_by

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "demo"))
import metrics

FIGURES = ("nrmse_tc", "relmse_tc", "flip", "mean_difference")
MIDDLE_GREY = 0.3  # display value, linear, of a reference's mean
UNCERTAIN_SHARE = 0.001
WARM_UP_SEED = 77


def flip_error(image: np.ndarray, reference: np.ndarray) -> float:
    """Mean LDR-FLIP of two linear images (H,W,3) as a viewport shows them: exposed by the reference's mean,
    clipped, sRGB.

    P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", HPG 2020; NVIDIA's evaluator.
    """
    exposure = MIDDLE_GREY / reference.mean()
    shown = [display(exposure * a) for a in (reference, image)]
    return float(flip_evaluator.evaluate(*shown, "LDR", inputsRGB=True, applyMagma=False)[1])


def display(linear: np.ndarray) -> np.ndarray:
    """sRGB's transfer function after clipping to [0,1]."""
    clipped = np.clip(linear, 0, 1)
    curve = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return np.ascontiguousarray(curve, np.float32)


def image_figures(image: np.ndarray, halves: list[np.ndarray]) -> dict[str, float]:
    """FIGURES of an image (H,W,3) against the mean of two independent halves.

    Where a firefly sits in the reference, the error and the correction by the halves' difference are large
    numbers that leave noise when subtracted: the 0.1 % of pixels in which the halves differ most are left out
    too.
    """
    own = ((halves[0] - halves[1]) ** 2).sum(axis=2)
    sound = own <= np.quantile(own, 1 - UNCERTAIN_SHARE)
    found = metrics.error_figures(*(a[sound][:, None] for a in (image, *halves)))
    found["mean_difference"] = float(image.mean(dtype=float) / np.mean(halves, dtype=float) - 1)
    found["flip"] = flip_error(image, (halves[0] + halves[1]) / 2)
    return {name: found[name] for name in FIGURES}


def mean_and_error(halves: list[np.ndarray]) -> dict[str, float]:
    """Mean of a reference, and its standard error by the halves' difference (pixels are independent)."""
    per_pixel = ((halves[0] - halves[1]).mean(axis=2, dtype=np.float64) / 2) ** 2
    mean = np.mean(halves, dtype=np.float64)
    return {"mean": float(mean), "standard_error": math.sqrt(per_pixel.mean() / per_pixel.size)}


def renew_if_outdated(renderers: Renderers, case: Case) -> None:
    """Skytree's own reference outlives its wheel as long as is_outdated says no; one by this wheel stays,
    since then a difference is a bias."""
    files = reference_files(renderers, case, "SKYTREE")
    if rendered_by(files[0]) == renderers.wheel:
        return
    image, _ = renderers.render(case, REFERENCES["SKYTREE"][0], max(SAMPLES), WARM_UP_SEED)
    if is_outdated(image, [np.load(file) for file in files]):
        make_reference(renderers, case, "SKYTREE", fresh=True)


def is_outdated(image: np.ndarray, halves: list[np.ndarray]) -> bool:
    """Whether a reference's mean is off today's image by more than noise, or it is noisier than that image of
    an eighth of its samples: fireflies of yesterday's engine would be subtracted from today's error."""
    difference = image.mean(axis=2, dtype=np.float64) - np.mean(halves, axis=(0, 3), dtype=np.float64)
    noise = difference.std() / math.sqrt(difference.size)
    own = ((halves[0] - halves[1]).mean(axis=2, dtype=np.float64) / 2) ** 2
    changed = abs(difference.mean()) > max(4 * noise, 0.002 * image.mean())
    return bool(changed or own.mean() > 0.5 * (difference**2).mean())


def steps_of(case_count: int) -> int:
    """How often measure() calls `advance` for that many cases."""
    return case_count * (len(REFERENCES) + len(METHODS) * (1 + len(SAMPLES) * len(SEEDS)))


def measure(renderers: Renderers, case: Case, map_file: Path, advance: Callable[[], None]) -> dict:
    """All that is known of one case, as plain data."""
    renderers.open(case, map_file)
    halves = {}
    for engine in REFERENCES:
        make_reference(renderers, case, engine)
        if engine == "SKYTREE":
            renew_if_outdated(renderers, case)
        halves[engine] = [np.load(file) for file in reference_files(renderers, case, engine)]
        advance()
    for method in METHODS:  # fills caches, compiles Mitsuba's kernels
        for samples in SAMPLES if METHODS[method].engine == "MITSUBA" else SAMPLES[:1]:
            renderers.render(case, method, samples, WARM_UP_SEED)
        advance()
    found = {
        name: {"cpu_seconds": {n: [] for n in SAMPLES}, "figures": {n: [] for n in SAMPLES}}
        for name in METHODS
    }
    for seed in SEEDS:
        for samples in SAMPLES:
            for method in METHODS:
                image, seconds = renderers.render(case, method, samples, seed)
                figures = image_figures(image, halves[METHODS[method].engine])
                found[method]["cpu_seconds"][samples].append(seconds)
                found[method]["figures"][samples].append(figures)
                advance()
    return {
        "case": {"scene": case.scene, "map": case.map, "bounces": case.bounces},
        "references": {engine: mean_and_error(images) for engine, images in halves.items()},
        "methods": found,
    }
