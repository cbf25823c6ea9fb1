# SPDX-License-Identifier: GPL-3.0-or-later
"""One comparison of a scene from its settings to its report on disk."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np

from .. import native
from ..environments import SamplerSettings
from ..properties import BLOCK_PROBABILITIES, SPLIT_CRITERIA
from ..viewport import display
from .methods import METHODS, Clock, Method, method_of
from .reader import read_for_render
from .render import Progress, Renderer, compare, timestamp
from .report import Comparison, write_report

CHOICES = tuple(item[0] for item in METHODS if item[0])
PICTURES = ("a", "b", "reference")
BEST = Method(SamplerSettings())  # renders the reference


def side_choice(text: str) -> SimpleNamespace:
    """What `kdtree:1024:SSE:FITTED` and the like choose; ValueError says what may be written."""
    name, *parts = text.upper().split(":")
    if name not in CHOICES:
        raise ValueError(f'"{text}" is no method; there are {", ".join(CHOICES).lower()}')
    if len(parts) > 3 or (parts and name != "KDTREE"):
        raise ValueError(f'"{text}": only kdtree takes settings, as kdtree:BLOCKS:SPLIT:PROBABILITY')
    default = SamplerSettings()
    count, split, probability = (*parts, *("", "", "")[len(parts) :])
    if count and not (count.isdigit() and int(count)):
        raise ValueError(f'"{text}": "{count}" is no number of blocks')
    for value, items in ((split, SPLIT_CRITERIA), (probability, BLOCK_PROBABILITIES)):
        names = [item[0] for item in items]
        if value and value not in names:
            raise ValueError(f'"{text}": "{value}" is none of {", ".join(names)}')
    return SimpleNamespace(
        method=name,
        block_count=int(count or default.block_count),
        split_criterion=split or default.split_criterion,
        block_probability=probability or default.block_probability,
    )


class ReportJob:
    """The comparison that scene.skytree_compare asks for; `overrides` may hold a, b (see side_choice),
    samples, seconds and reference_samples, None where the scene's own count."""

    def __init__(self, scene, overrides=None):
        settings, compared = scene.skytree, scene.skytree_compare
        overrides = overrides or SimpleNamespace(
            a=None, b=None, samples=None, seconds=None, reference_samples=None
        )
        self.scene = scene
        self.a: Method = self._method(overrides.a or compared.a, settings)
        self.b: Method = self._method(overrides.b or compared.b, settings)
        kind = "TIME" if overrides.seconds else "SAMPLES" if overrides.samples else compared.clock
        self.clock = Clock(kind, overrides.samples or compared.samples, overrides.seconds or compared.seconds)
        self.reference_samples = overrides.reference_samples or compared.reference_samples
        if min(self.clock.samples, self.reference_samples) < 1 or self.clock.seconds <= 0:
            raise ValueError("Samples and seconds must be positive")
        self.comparison: Comparison | None = None

    @staticmethod
    def _method(choice, settings) -> Method:
        if choice.method == "REFERENCE":
            raise ValueError("A report renders its own reference: choose a sampler for A and for B")
        return method_of(choice, settings)

    def run(self, folder: Path, tell: Callable[[Progress], None]) -> dict[str, Path]:
        """All four steps, one after the other. Raises ValueError, RuntimeError, OSError or CompareCancelled,
        as each of them may."""
        tell(Progress("reading the scene", 0.0))
        self.read(tell)
        self.render()
        tell(Progress("writing the report", 1.0))
        shown = {key: self.show(key, self.scene) for key in PICTURES}
        return self.write(folder, shown)

    def read(self, tell: Callable[[Progress], None]):
        """For the main thread: takes all that it needs from Blender."""
        self._started = timestamp()
        self.renderer = read_for_render(self.scene, lambda depsgraph: Renderer(depsgraph, tell))
        self.renderer.prepare((self.a, self.b, BEST))
        self._told = self._settings(self.renderer)
        self._exposure = 2.0**self.scene.view_settings.exposure

    def render(self):
        """For any thread."""
        a, b, reference = compare(self.renderer, self.a, self.b, self.clock, BEST, self.reference_samples)
        self.comparison = Comparison(
            a,
            b,
            reference,
            self._told,
            self._machine(),
            self._started,
            self.renderer.sync.messages.texts(),
        )

    def show(self, key: str, scene, rows: slice = slice(None)) -> tuple[np.ndarray, str]:
        """For the main thread: rows of A, B or the reference ("a", "b", "reference") through the scene's view
        transform, and how that is called."""
        to_display, name = display.view_of(scene)
        return to_display(self.comparison.images[key][rows]), name

    def parts_to_show(self) -> list[tuple[str, slice]]:
        """Arguments of `show` for all of PICTURES in turn, each soon done."""
        return [
            (key, rows) for key in PICTURES for rows in display.bands(*self.comparison.images[key].shape[:2])
        ]

    def write(self, folder: Path, shown: dict[str, tuple[np.ndarray, str]]) -> dict[str, Path]:
        """For any thread: the files by name. `shown` is what `show` returned for each of PICTURES."""
        pictures = {key: picture for key, (picture, _) in shown.items()}
        return write_report(self.comparison, folder, pictures, shown["reference"][1], self._exposure)

    def summary(self) -> list[str]:
        lines = []
        for key, side in self.comparison.sides.items():
            step = side.last
            cost = f"{step.samples} samples, {step.device_seconds:.2f} s of {self.renderer.device}"
            errors = f"nRMSE_tc {step.errors['nrmse_tc']:.4g}, relMSE {step.errors['relmse']:.4g}"
            lines.append(f"{key.upper()}: {side.label}, {cost}, {errors}")
        return lines

    def _settings(self, renderer: Renderer) -> dict:
        scene, settings = self.scene, self.scene.skytree
        environment = renderer.sync.built
        equal = (
            {"samples": self.clock.samples}
            if self.clock.kind == "SAMPLES"
            else {"device_seconds": self.clock.seconds}
        )
        x0, y0, x1, y1 = renderer.film.region
        return {
            "file": os.path.basename(bpy.data.filepath) or "unsaved",
            "scene": scene.name,
            "frame": scene.frame_current,
            "world": environment.name,
            "map": "{} x {}".format(*environment.map_size),
            "resolution": f"{x1 - x0} x {y1 - y0}",
            "clock": {"SAMPLES": "equal samples", "TIME": "equal time"}[self.clock.kind],
            **equal,
            "reference_samples": self.reference_samples,
            "reference_method": BEST.label,
            "seed": settings.seed,
            "max_bounces": settings.max_bounces,
            "pixel_filter": settings.pixel_filter,
            "filter_width": round(settings.filter_width, 6),
        }

    def _machine(self) -> dict:
        core = native.core()
        return {
            "skytree": getattr(core, "__version__", "unknown"),
            "blender": bpy.app.version_string,
            "device": self.renderer.device,
            "processor": processor_name(),
            "system": platform.platform(),
        }


def processor_name() -> str:
    """As the system calls it; "unknown" where it does not say."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    named = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return f"{named or platform.machine()}, {os.cpu_count()} threads"
