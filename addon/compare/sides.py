# SPDX-License-Identifier: GPL-3.0-or-later
"""What a comparison in a view is asked for, and the two sides of it."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, field

from ..environments import BuiltEnvironment
from ..viewport import gpu_draw
from ..viewport.renderer import Picture, RenderSettings
from ..viewport.view import View
from .methods import Clock, Method, method_of
from .report import Step


@dataclass(frozen=True)
class Request:
    """All that the two pictures depend on besides the scene. A method is None for the captured reference."""

    view: View
    settings: RenderSettings
    methods: tuple[Method | None, Method | None]
    clock: Clock

    @classmethod
    def of(cls, view: View, scene) -> Request:
        compared = scene.skytree_compare
        methods = tuple(
            None if side.method == "REFERENCE" else method_of(side, scene.skytree)
            for side in (compared.a, compared.b)
        )
        clock = Clock(compared.clock, compared.samples, compared.seconds)
        return cls(view, RenderSettings.of(scene), methods, clock)


@dataclass
class Side:
    """One of the two pictures and what is known about it."""

    method: Method | None = None
    sampler: Future | None = None
    session: object = None
    picture: Picture | None = None
    texture: tuple | None = None
    seconds: float = 0.0  # of rendering the picture
    taken_at: float = 0.0  # when the picture was taken
    measured_at: int = 0  # samples that the last measurement was asked for
    steps: list[Step] = field(default_factory=list)
    workers: tuple[int, str] = (0, "CPU")  # threads and device of the session
    finished: bool = False
    made_for: tuple | None = None  # (subject, request) of the picture

    def uploaded(self):
        """The picture as a texture, or None."""
        if self.picture is None:
            return None
        if self.texture is None or self.texture[0] is not self.picture:
            self.texture = self.picture, gpu_draw.upload(self.picture.pixels)
        return self.texture[1]


def built_of(side: Side) -> BuiltEnvironment | None:
    """The sampler whose figures tell about a side, once it is built."""
    if side.method is None or not side.method.has_density or side.sampler is None:
        return None
    if not side.sampler.done() or side.sampler.exception() is not None:
        return None
    built = side.sampler.result()
    return built if built.image is not None else None


def sampler_figures_of(side: Side) -> dict | None:
    """Figures of a side's sampler, as far as they are known."""
    built = built_of(side)
    if built is None or built.figures is None or not built.figures.done():
        return None
    return built.figures.result()
