# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels tell about the last sync: figures of the sampler, and messages."""

from __future__ import annotations

from dataclasses import dataclass, field

from .messages import Messages


@dataclass
class Status:
    """Figures of the sampler that was last built or used; None where a sampler has no such figure."""

    messages: Messages = field(default_factory=Messages)
    sampler: str = ""
    map_name: str = ""
    map_size: tuple[int, int] = (0, 0)
    blocks: int | None = None
    alpha: float | None = None
    fit_error: float | None = None
    nbytes: int | None = None
    inversion_nbytes: int | None = None
    build_seconds: float | None = None
    uploads: dict = field(default_factory=dict)

    def update(self, sync):
        """From a SceneSync after it has synced."""
        built = sync.built
        self.messages.clear()
        self.messages.extend(sync.messages)
        self.uploads = dict(sync.counts)
        self.sampler = built.settings.sampler
        self.map_name, self.map_size = built.name, built.map_size
        self.nbytes = built.sampler.nbytes
        self.blocks = getattr(built.sampler, "block_count", None)
        self.alpha = getattr(built.sampler, "alpha", None)
        self.fit_error = getattr(built.sampler, "fit_error", None)
        self.build_seconds = getattr(built.sampler, "build_seconds", built.build_seconds)
        self.inversion_nbytes = inversion_nbytes(*built.map_size) if all(built.map_size) else None


def inversion_nbytes(width: int, height: int) -> int:
    """Bytes of marginal and conditional distributions in float32, each with its leading zero."""
    return 4 * (height * (width + 1) + height + 1)


last = Status()
