# SPDX-License-Identifier: GPL-3.0-or-later
"""Environment maps and their samplers, shared by all renders and viewports of this Blender.

A sampler belongs to a map and to its settings; a rotation, a strength or a new depsgraph never builds it
again.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np

from . import native
from .messages import Messages
from .world import Environment

MAX_MAPS = 2
MAX_SAMPLERS = 8


@dataclass(frozen=True)
class SamplerSettings:
    sampler: str = "KDTREE"
    block_count: int = 1024
    split_criterion: str = "MIN_VARIANCE"
    block_probability: str = "MIN_VARIANCE"

    @classmethod
    def of(cls, settings) -> SamplerSettings:
        """From scene.skytree; what a sampler does not look at is left at the default, so that it is no
        key."""
        if settings.sampler != "KDTREE":
            return cls(settings.sampler)
        return cls("KDTREE", settings.block_count, settings.split_criterion, settings.block_probability)


@dataclass
class BuiltEnvironment:
    image: np.ndarray | None
    sampler: object
    settings: SamplerSettings
    name: str = ""
    map_size: tuple[int, int] = (0, 0)  # width, height
    build_seconds: float = 0.0
    messages: Messages = field(default_factory=Messages)


class Environments:
    """A least-recently-used cache of maps and samplers; `builds` counts samplers built."""

    def __init__(self):
        self.builds = 0
        self._maps: OrderedDict = OrderedDict()
        self._built: OrderedDict = OrderedDict()
        self._lock = threading.Lock()

    def get(
        self, environment: Environment, settings: SamplerSettings, messages: Messages
    ) -> BuiltEnvironment:
        with self._lock:
            built = self._get(environment, settings)
        messages.extend(built.messages)
        return built

    def clear(self):
        with self._lock:
            self._maps.clear()
            self._built.clear()

    def _get(self, environment: Environment, settings: SamplerSettings) -> BuiltEnvironment:
        if environment.expression is None:
            settings = SamplerSettings("UNIFORM")
        key = (environment.expression, settings)
        if key not in self._built:
            self._built[key] = self._build(environment, settings)
        return _touch(self._built, key, MAX_SAMPLERS)

    def _map(self, environment: Environment) -> np.ndarray | None:
        if environment.expression is None:
            return None
        if environment.expression not in self._maps:
            self._maps[environment.expression] = environment.pixels()
        return _touch(self._maps, environment.expression, MAX_MAPS)

    def _build(self, environment: Environment, settings: SamplerSettings) -> BuiltEnvironment:
        messages = Messages()
        try:
            image = self._map(environment)
        except ValueError as error:
            messages.warn(str(error))
            image = None
        if image is None:
            settings = SamplerSettings("UNIFORM")
        start = time.perf_counter()
        sampler = make_sampler(image, settings)
        self.builds += 1
        return BuiltEnvironment(
            image,
            sampler,
            settings,
            environment.name,
            (0, 0) if image is None else (image.shape[1], image.shape[0]),
            time.perf_counter() - start,
            messages,
        )


def make_sampler(image: np.ndarray | None, settings: SamplerSettings):
    core = native.core()
    if image is None or settings.sampler == "UNIFORM":
        return core.UniformSampler()
    if settings.sampler == "INVERSION":
        return core.InversionSampler(image)
    if settings.sampler == "ALIAS":
        return core.AliasSampler(image)
    return core.KdTreeSampler(
        image, settings.block_count, settings.split_criterion, settings.block_probability
    )


def _touch(cache: OrderedDict, key, limit: int):
    cache.move_to_end(key)
    while len(cache) > limit:
        cache.popitem(last=False)
    return cache[key]


environments = Environments()
