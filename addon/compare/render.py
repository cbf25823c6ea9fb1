# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders the two sides of a comparison and its reference, one after the other, without a window.

Sample counts alone decide the pixels: under the clock TIME they are found first, by a short trial, so that a
comparison at equal time is repeated to the bit by one at the samples that it reports.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from .. import native
from ..camera import Film, camera_matrices, film_of
from ..environments import BuiltEnvironment, environments
from ..sync.scene import SceneSync
from ..viewport.renderer import RenderSettings
from .methods import REFERENCE_SEEDS, Clock, Method
from .metrics import Reference, sampler_figures
from .report import Side, make_step

POLL_SECONDS = 0.05
TRIAL_SAMPLES = 8


class CompareCancelled(Exception):
    """The user asked to stop; nothing is wrong."""


@dataclass(frozen=True)
class Progress:
    text: str
    fraction: float


class Renderer:
    """One synced scene that any method renders. `tell(Progress)` may raise CompareCancelled at any time."""

    def __init__(self, depsgraph, tell: Callable[[Progress], None] = lambda progress: None):
        scene = depsgraph.scene_eval
        self.settings = RenderSettings.of(scene)
        self.film: Film = film_of(scene.render)
        self.tell = tell
        self.sync = SceneSync(flat=True)
        self.sync.sync(depsgraph)
        self.sync.set_camera(*camera_matrices(scene.camera, None, depsgraph, self.film))
        self.session = native.core().RenderSession(self.settings.threads, self.settings.device)
        self.device = ""  # what rendered, once something was rendered
        self._built = {}

    def prepare(self, methods: Iterable[Method]):
        """Begins to build the samplers. Reading the map's pixels belongs to the main thread, all else may be
        called on another one."""
        for method in methods:
            self._built[method.sampler] = environments.request(
                self.sync.environment, method.sampler, threads=self.settings.threads
            )

    def built(self, method: Method) -> BuiltEnvironment:
        if method.sampler not in self._built:
            self.prepare([method])
        built = self._built[method.sampler].result()
        self.sync.messages.extend(built.messages)
        return built

    def device_seconds(self) -> float:
        """What the last render cost: processor time of all threads, or a GPU's time on the clock."""
        stats = self.session.stats
        if self.settings.device == "CPU":
            return stats["cpu_seconds"]
        return max(stats["seconds"] - stats["commit_seconds"], 0.0)

    def render(
        self, method: Method, first: int, count: int, seed: int, tell: Callable[[float], None]
    ) -> np.ndarray:
        """The mean of samples first ... first + count - 1: (H,W,3) float32 of the region, row 0 at the
        top."""
        self.session.start(
            self.sync.scene,
            self.film.width,
            self.film.height,
            count,
            region=self.film.region,
            first_sample=first,
            sampler=self.built(method).sampler,
            light_sampling=method.light_sampling,
            **{**self.settings.options(), "seed": seed, "candidates": method.candidates},
        )
        try:
            while not self.session.wait(POLL_SECONDS):
                tell(self.session.samples_done / count)
        finally:
            self.session.cancel()
        if self.session.error:
            raise RuntimeError(self.session.error)
        if self.session.warning:
            self.sync.messages.warn(self.session.warning)
        self.device = self.session.stats["device"]
        return np.ascontiguousarray(self.session.pixels()[::-1, :, :3])

    def reference(self, method: Method, samples: int) -> Reference:
        halves = []
        for index, seed in enumerate(REFERENCE_SEEDS):

            def tell(done, index=index):
                self.tell(Progress("reference", (index + done) / 2))

            halves.append(self.render(method, 0, max(samples // 2, 1), self.settings.seed ^ seed, tell))
        return Reference(*halves)

    def samples_in(self, method: Method, seconds: float) -> int:
        """How many samples fit into `seconds` of the device's time, by a trial; at least 1."""
        trial = TRIAL_SAMPLES
        while True:
            self.render(method, 0, trial, self.settings.seed, lambda done: self.tell(Progress("trial", 0.0)))
            spent = self.device_seconds()
            if spent >= 0.1 * seconds or trial >= 1 << 16:
                return max(1, round(trial * seconds / max(spent, 1e-9)))
            trial *= 4

    def side(self, name: str, method: Method, samples: int, reference: Reference) -> Side:
        """Renders `samples` samples and measures the error at 1, 2, 4, ... of them."""
        total, steps, done = None, [], 0
        render_seconds = device_seconds = 0.0
        for target in checkpoints(samples):

            def tell(part, target=target, done=done):
                self.tell(Progress(f"{name}, {method.label}", (done + part * (target - done)) / samples))

            image = self.render(method, done, target - done, self.settings.seed, tell).astype(np.float64)
            render_seconds += self.session.render_seconds
            device_seconds += self.device_seconds()
            total = image if total is None else (total * done + image * (target - done)) / target
            done = target
            steps.append(make_step(done, total, reference, render_seconds, device_seconds))
        return Side(method.label, self.describe(method), total.astype(np.float32), steps)

    def describe(self, method: Method) -> dict:
        """Settings of a method and figures of its sampler."""
        told = dict(method.settings)
        if not method.light_sampling:
            return told
        built = self.built(method)
        told["nbytes"] = int(built.sampler.nbytes)
        for name in ("alpha", "fit_error", "block_count"):
            value = getattr(built.sampler, name, None)
            if value is not None and math.isfinite(value):
                told[name] = value
        if built.image is not None and method.has_density:
            self.tell(Progress(f"fit of {method.label} to the map", 1.0))
            told |= sampler_figures(built.sampler, built.image) or {}
        return told


def checkpoints(samples: int) -> Iterator[int]:
    """1, 2, 4, ... and `samples` itself."""
    step = 1
    while step < samples:
        yield step
        step *= 2
    yield samples


def compare(
    renderer: Renderer, a: Method, b: Method, clock: Clock, reference_method: Method, reference_samples: int
) -> tuple[Side, Side, Reference]:
    """Renders the reference, then A and B; raises ValueError, RuntimeError or CompareCancelled."""
    reference = renderer.reference(reference_method, reference_samples)
    sides = []
    for name, method in (("A", a), ("B", b)):
        samples = clock.samples if clock.kind == "SAMPLES" else renderer.samples_in(method, clock.seconds)
        sides.append(renderer.side(name, method, samples, reference))
    return (*sides, reference)


def timestamp() -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
