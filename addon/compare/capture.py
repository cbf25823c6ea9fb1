# SPDX-License-Identifier: GPL-3.0-or-later
"""A reference of one view that is rendered in the background."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import native
from ..environments import SamplerSettings, environments
from .methods import REFERENCE_SEEDS
from .metrics import Reference

if TYPE_CHECKING:
    from .view import CompareView


@dataclass(frozen=True)
class CapturedReference:
    reference: Reference
    of: tuple  # CompareView.subject() when it was made
    samples: int


class Capture:
    """A reference that is being rendered: two independent halves, one after the other."""

    def __init__(self, view: CompareView, samples: int):
        self.subject = view.subject()
        self.samples = max(samples // 2, 1)
        self.halves: list[np.ndarray] = []
        settings = view.request.settings
        self.session = native.core().RenderSession(settings.threads, settings.device)
        self._view = view
        self._sampler = environments.request(
            view.scene_sync.environment, SamplerSettings(), threads=settings.threads
        )
        self._started = False

    @property
    def fraction(self) -> float:
        part = self.session.samples_done / self.samples if self._started else 0.0
        return min((len(self.halves) + part) / 2, 1.0)

    def advance(self) -> CapturedReference | None:
        """Goes on; the reference once it is complete. Raises RuntimeError if rendering failed."""
        if not self._started:
            if self._sampler.done():
                self._start()
            return None
        if self.session.running:
            return None
        if self.session.error:
            raise RuntimeError(self.session.error)
        self.halves.append(np.ascontiguousarray(self.session.pixels()[..., :3]))
        if len(self.halves) < 2:
            self._start()
            return None
        return CapturedReference(Reference(*self.halves), self.subject, 2 * self.samples)

    def _start(self):
        request = self._view.request
        seed = request.settings.seed ^ REFERENCE_SEEDS[len(self.halves)]
        options = {**request.settings.options(), "seed": seed, "candidates": 0}
        options["sampler"] = self._sampler.result().sampler
        width, height, border = request.view.scaled(1)
        self.session.start(self._view.scene_sync.scene, width, height, self.samples, region=border, **options)
        self._started = True
