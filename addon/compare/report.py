# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes a comparison as files: PNG, one multi-layer EXR, CSV, JSON and a self-contained HTML page.

Equal renders make equal files to the bit, but for what tells of time: in JSON it stands under "times", in
CSV in the columns of TIME_FIELDS, and the page shows both.
"""

from __future__ import annotations

import csv
import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .image_files import png_bytes, write_exr
from .metrics import Reference, efficiency, error_figures

ERROR_FIELDS = ("rmse", "relmse", "nrmse_tc", "mean_difference")
TIME_FIELDS = ("render_seconds", "device_seconds", "efficiency")


@dataclass(frozen=True)
class Step:
    """A side after `samples` samples per pixel: its errors and what it cost so far.

    `device_seconds` is what equal time means: processor time of all threads, or a GPU's time on the
    clock."""

    samples: int
    errors: dict[str, float]
    render_seconds: float
    device_seconds: float

    @property
    def efficiency(self) -> float | None:
        return efficiency(self.errors["nrmse_tc"], self.device_seconds)


@dataclass(frozen=True)
class Side:
    """One of the two that are compared. `image` is (H,W,3) linear, row 0 at the top; `sampler` says how it
    was made and how well its pdf fits the map."""

    label: str
    sampler: dict
    image: np.ndarray
    steps: list[Step]

    @property
    def last(self) -> Step:
        return self.steps[-1]


@dataclass(frozen=True)
class Comparison:
    """What a report tells. `settings` holds all that the pixels depend on, `machine` where they were made."""

    a: Side
    b: Side
    reference: Reference
    settings: dict
    machine: dict
    started: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def sides(self) -> dict[str, Side]:
        return {"a": self.a, "b": self.b}

    @property
    def images(self) -> dict[str, np.ndarray]:
        """A, B and the reference, (H,W,3) linear."""
        return {"a": self.a.image, "b": self.b.image, "reference": self.reference.image}


def make_step(
    samples: int, image: np.ndarray, reference: Reference, render_seconds: float, device_seconds: float
) -> Step:
    return Step(samples, error_figures(image, reference), render_seconds, device_seconds)


def difference_factor(comparison: Comparison, display_white: float) -> float:
    """A power of two by which differences are multiplied, so that all but their largest percent fit below
    white."""
    truth = comparison.reference.image
    largest = max(float(np.percentile(np.abs(side.image - truth), 99)) for side in comparison.sides.values())
    return 2.0 ** math.floor(math.log2(display_white / largest)) if largest > 0 else 1.0


def write_report(
    comparison: Comparison,
    folder: Path,
    shown: dict[str, np.ndarray],
    display_name: str,
    exposure: float = 1.0,
) -> dict[str, Path]:
    """Writes all files into `folder` (made where it is missing) and returns their paths by name.

    `shown` has A, B and the reference as one looks at them, (H,W,3) uint8 sRGB, by the names "a", "b" and
    "reference"; `display_name` says how they were made. Differences are |image - reference| x `exposure` x a
    stated factor through the sRGB curve alone. Raises OSError if the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    truth = comparison.reference.image
    a, b = comparison.a.image, comparison.b.image
    factor = difference_factor(comparison, 1.0 / exposure)
    differences = {"difference_a": a - truth, "difference_b": b - truth, "difference_ab": a - b}
    pictures = shown | {
        name: _difference_picture(image, exposure * factor) for name, image in differences.items()
    }
    encoded = {name: png_bytes(pixels) for name, pixels in pictures.items()}

    document = document_of(
        comparison, {"view": display_name, "exposure": exposure, "difference_factor": factor}
    )
    paths = {}
    for name, data in encoded.items():
        paths[name] = folder / f"{name}.png"
        paths[name].write_bytes(data)
    layers = {"A": a, "B": b, "Reference": truth}
    layers |= {
        "Difference_A": differences["difference_a"],
        "Difference_B": differences["difference_b"],
        "Difference_AB": differences["difference_ab"],
    }
    paths["exr"] = folder / "comparison.exr"
    write_exr(
        paths["exr"], layers, {"skytree": json.dumps({k: v for k, v in document.items() if k != "times"})}
    )
    paths["csv"] = folder / "convergence.csv"
    write_csv(comparison, paths["csv"])
    paths["json"] = folder / "report.json"
    paths["json"].write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")

    from .html import page

    paths["html"] = folder / "report.html"
    paths["html"].write_text(page(comparison, document, encoded), encoding="utf-8")
    return paths


def _difference_picture(difference: np.ndarray, factor: float) -> np.ndarray:
    from ..pictures.plots import encode_srgb

    return (encode_srgb(np.abs(difference) * factor) * 255.0 + 0.5).astype(np.uint8)


def document_of(comparison: Comparison, display: dict) -> dict:
    """The report as JSON values; all under "times" may differ from run to run, nothing else may."""
    results, times = {}, {"started": comparison.started}
    for key, side in comparison.sides.items():
        results[key] = {
            "label": side.label,
            "sampler": side.sampler,
            "samples": side.last.samples,
            "errors": side.last.errors,
            "convergence": [{"samples": step.samples, **step.errors} for step in side.steps],
        }
        times[key] = [
            {"samples": step.samples, **{name: getattr(step, name) for name in TIME_FIELDS}}
            for step in side.steps
        ]
    return {
        "settings": comparison.settings,
        "machine": comparison.machine,
        "display": display,
        "notes": comparison.notes,
        "results": results,
        "times": times,
    }


def write_csv(comparison: Comparison, path: Path) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["side", "label", "samples", *ERROR_FIELDS, *TIME_FIELDS])
        for key, side in comparison.sides.items():
            for step in side.steps:
                errors = (step.errors[name] for name in ERROR_FIELDS)
                times = ("" if (value := getattr(step, name)) is None else value for name in TIME_FIELDS)
                writer.writerow([key, side.label, step.samples, *errors, *times])
