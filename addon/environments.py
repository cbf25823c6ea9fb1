# SPDX-License-Identifier: GPL-3.0-or-later
"""Environment maps and their samplers, shared by all renders and viewports of this Blender.

A sampler belongs to a map and to its settings; a rotation, a strength or a new depsgraph never builds it
again.
"""

from __future__ import annotations

import threading
import time
import weakref
from collections import OrderedDict
from concurrent.futures import Future
from dataclasses import dataclass, field

import numpy as np

from . import native
from .map_figures import MapFigures, map_figures
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
    auto_blocks: bool = False
    compensation: float = 0.0
    filter_samples: int = 0  # FILTERED: what the blur is made for

    @classmethod
    def of(cls, settings) -> SamplerSettings:
        """From scene.skytree; what a sampler does not look at is left at the default, so that it is no
        key."""
        if settings.sampler == "MEDIAN_CUT":
            return cls("MEDIAN_CUT", settings.block_count)
        if settings.sampler == "FILTERED":
            return cls("FILTERED", filter_samples=settings.filter_samples)
        if settings.sampler == "RESAMPLED":  # candidates are the session's; half come from the best kd-tree
            return cls()
        if settings.sampler != "KDTREE":
            return cls(settings.sampler)
        split, probability = settings.split_criterion, settings.block_probability
        compensation = 0.0 if probability == "FITTED" else settings.compensation
        count = cls.block_count if settings.auto_blocks else settings.block_count
        return cls("KDTREE", count, split, probability, settings.auto_blocks, compensation)

    @property
    def has_density(self) -> bool:
        """Whether the sampler draws directions; the filtered map only looks up what surfaces reflect."""
        return self.sampler != "FILTERED"


def candidates_of(settings) -> int:
    """What scene.skytree makes of RenderSession.start's argument `candidates`."""
    return settings.candidates if settings.sampler == "RESAMPLED" else 0


@dataclass
class BuiltEnvironment:
    image: np.ndarray | None
    sampler: object
    settings: SamplerSettings
    name: str = ""
    map_size: tuple[int, int] = (0, 0)  # width, height
    build_seconds: float = 0.0
    messages: Messages = field(default_factory=Messages)
    # compare.metrics.sampler_figures, once somebody asked for them: they cost more than the sampler.
    figures: Future | None = None


class FutureEnvironment(Future):
    """A BuiltEnvironment to come, and when it was first asked for (time.perf_counter)."""

    def __init__(self):
        super().__init__()
        self.asked = time.perf_counter()


class Environments:
    """A least-recently-used cache of maps and samplers, for any thread; `builds` counts samplers built.
    Where more samplers of a map are to be expected, what they have in common is kept with the map.

    Pixels of images are read on the calling thread, since Blender's data may be touched nowhere else."""

    def __init__(self):
        self.builds = 0
        self._maps: OrderedDict = OrderedDict()
        self._statistics: dict = {}  # skytree_core.MapStatistics of maps in _maps
        self._figures: OrderedDict = OrderedDict()
        self._built: OrderedDict[tuple, FutureEnvironment] = OrderedDict()
        self._lock = threading.Lock()

    def get(
        self, environment: Environment, settings: SamplerSettings, messages: Messages
    ) -> BuiltEnvironment:
        """Waits until the sampler is there."""
        built = self._future(environment, settings, lambda build: build()).result()
        messages.extend(built.messages)
        return built

    def request(
        self,
        environment: Environment,
        settings: SamplerSettings,
        *,
        threads: int = 0,
        more_to_come: bool = False,
    ) -> FutureEnvironment:
        """A future BuiltEnvironment: what is not there yet is built on a thread of its own and `threads` in
        all, 0 for all cores. `more_to_come`: the next samplers of the map should be built sooner, which
        costs memory (docs/viewport.md)."""
        return self._future(environment, settings, _on_a_thread, threads, more_to_come)

    def figures(self, environment: Environment) -> MapFigures | None:
        """What the map is like; None before a sampler was built for it."""
        return self._figures.get(environment.expression)

    def sizes(self) -> dict[str, int]:
        """How many maps and samplers are kept."""
        return {"maps": len(self._maps), "samplers": len(self._built)}

    def clear(self):
        """Gives everything back; what is being built is waited for."""
        for thread in list(_threads):
            thread.join()
        with self._lock:
            self._maps.clear()
            self._statistics.clear()
            self._figures.clear()
            self._built.clear()

    def _future(
        self,
        environment: Environment,
        settings: SamplerSettings,
        run,
        threads: int = 0,
        more_to_come: bool = False,
    ) -> FutureEnvironment:
        if environment.expression is None:
            settings = SamplerSettings("UNIFORM")
        key = (environment.expression, settings)
        with self._lock:
            future = self._built.get(key)
            is_new = future is None
            if is_new:
                future = self._built[key] = FutureEnvironment()
            _touch(self._built, key, MAX_SAMPLERS)
        if is_new:
            messages = Messages()
            try:
                image = self._map(environment)
            except ValueError as error:
                messages.warn(str(error), topic="IMAGE")
                image = None
            except BaseException as error:
                self._fail(key, future, error)
                raise

            def make():
                statistics = self._statistics_of(environment.expression, image, more_to_come)
                return make_sampler(image, settings, statistics, threads)

            run(lambda: self._build(key, future, image, environment.name, settings, messages, make))
        return future

    def _map(self, environment: Environment) -> np.ndarray | None:
        if environment.expression is None:
            return None
        with self._lock:
            if environment.expression in self._maps:
                return _touch(self._maps, environment.expression, MAX_MAPS)
        pixels = environment.pixels()
        with self._lock:
            self._maps[environment.expression] = pixels
            _touch(self._maps, environment.expression, MAX_MAPS)
            for expression in set(self._statistics) - set(self._maps):
                del self._statistics[expression]
        return pixels

    def _statistics_of(self, expression, image: np.ndarray | None, wanted: bool):
        """skytree_core.MapStatistics of a map, if it is kept or should be from now on."""
        if image is None:
            return None
        with self._lock:
            if wanted and expression in self._maps and expression not in self._statistics:
                self._statistics[expression] = native.core().MapStatistics(image)
            return self._statistics.get(expression)

    def _build(
        self, key, future: Future, image, name: str, settings: SamplerSettings, messages: Messages, make
    ):
        if image is None:
            settings = SamplerSettings("UNIFORM")
        start = time.perf_counter()
        try:
            sampler = make()
        except BaseException as error:  # whoever waits for it gets it, on whichever thread
            self._fail(key, future, error)
            return
        self.builds += 1
        size = (0, 0) if image is None else (image.shape[1], image.shape[0])
        seconds = time.perf_counter() - start
        future.set_result(BuiltEnvironment(image, sampler, settings, name, size, seconds, messages))
        if image is not None and key[0] not in self._figures:
            _on_a_thread(lambda: self._judge(key[0], image))  # nobody waits for it

    def _judge(self, expression, image):
        figures = map_figures(image)
        with self._lock:
            self._figures[expression] = figures
            _touch(self._figures, expression, MAX_SAMPLERS)

    def _fail(self, key, future: Future, error: BaseException):
        with self._lock:
            if self._built.get(key) is future:
                del self._built[key]  # so that it is tried again
        future.set_exception(error)


_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


def _on_a_thread(build):
    thread = threading.Thread(target=build, name="Skytree sampler", daemon=True)
    _threads.add(thread)
    thread.start()


def make_sampler(image: np.ndarray | None, settings: SamplerSettings, statistics=None, threads: int = 0):
    """`statistics`: a skytree_core.MapStatistics of the image, or None. `threads` build, 0 for all cores."""
    core = native.core()
    if image is None or settings.sampler == "UNIFORM":
        return core.UniformSampler()
    if settings.sampler == "INVERSION":
        return core.InversionSampler(image, threads=threads)
    if settings.sampler == "HIERARCHY":
        return core.HierarchySampler(image, threads=threads)
    if settings.sampler == "FILTERED":
        return core.FilteredMap(image, settings.filter_samples)
    source = image if statistics is None else statistics
    if settings.sampler == "ALIAS":
        return core.AliasSampler(source, threads=threads)
    if settings.sampler == "MEDIAN_CUT":
        return core.KdTreeSampler(source, settings.block_count, "MEDIAN_CUT", "EXACT", threads=threads)
    return core.KdTreeSampler(
        source,
        "AUTO" if settings.auto_blocks else settings.block_count,
        settings.split_criterion,
        settings.block_probability,
        compensation=settings.compensation,
        threads=threads,
    )


def _touch(cache: OrderedDict, key, limit: int):
    cache.move_to_end(key)
    while len(cache) > limit:
        cache.popitem(last=False)
    return cache[key]


environments = Environments()
