# SPDX-License-Identifier: GPL-3.0-or-later
"""Two renders of one view at the same time: same camera, same seeds, same number of threads, different
sampling.

A CompareView works beside the ViewportRenderer of its region and shares that one's scene. Like there, every
method belongs to the main thread and returns soon: native threads render, one Python thread measures
errors.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from .. import native
from ..environments import BuiltEnvironment, SamplerSettings, environments
from ..viewport import gpu_draw
from ..viewport.renderer import (
    FIRST_PICTURE_SECONDS,
    REFINEMENT_SECONDS,
    Picture,
    RenderSettings,
    ViewportRenderer,
)
from ..viewport.view import View
from .methods import REFERENCE_SEEDS, Clock, Method, method_of
from .metrics import Reference, sampler_figures
from .report import Step, make_step

UNLIMITED_SAMPLES = 1 << 20
COARSEST_DIVISOR = 8
SIDES = ("a", "b")


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

    def uploaded(self):
        """The picture as a texture, or None."""
        if self.picture is None:
            return None
        if self.texture is None or self.texture[0] is not self.picture:
            self.texture = self.picture, gpu_draw.upload(self.picture.pixels)
        return self.texture[1]


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
        self._sampler = environments.request(view.scene_sync.environment, SamplerSettings())
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
        options = {**request.settings.options(), "seed": seed, "sampler": self._sampler.result().sampler}
        width, height, border = request.view.scaled(1)
        self.session.start(self._view.scene_sync.scene, width, height, self.samples, region=border, **options)
        self._started = True


class CompareView:
    """`look` says what to show; `advance`, called by viewport.clock while `busy`, goes on with it."""

    def __init__(self, renderer: ViewportRenderer):
        self._renderer = renderer
        renderer.before_upload.append(self._stop)
        self.request: Request | None = None
        self.sides = {name: Side() for name in SIDES}
        self.captured: CapturedReference | None = None
        self.capture: Capture | None = None
        self.problem = ""
        self._next: Request | None = None
        self._made_for: tuple | None = None  # (subject, request) of the pictures
        self._stale = True
        self._divisor = 0
        self._started = 0.0
        self._progress_shown = 0.0
        self._measuring: list[tuple[str, tuple, Future]] = []
        self._awaited_figures: list[Future] = []
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="skytree-compare")

    # What to show

    def belongs_to(self, renderer: ViewportRenderer) -> bool:
        return self._renderer is renderer

    @property
    def scene_sync(self):
        return self._renderer.sync

    def look(self, request: Request):
        if request == self.request:
            self._next = None
        elif self._awaits_first_picture():
            # While the view moves all the time, cancelling every first picture would show none.
            self._next = request
        else:
            self._adopt(request)

    def subject(self) -> tuple:
        """What a perfect picture depends on: how light is sampled does not belong to it."""
        sync, settings = self.scene_sync, self.request.settings
        environment = sync.environment
        world = (
            environment.expression,
            environment.color,
            environment.world_to_env.tobytes(),
            environment.visible,
        )
        uploads = tuple(sorted((k, v) for k, v in sync.counts.items() if k != "environments"))
        return self.request.view, replace(settings, samples=0, seed=0, threads=0), world, uploads

    @property
    def reference(self) -> Reference | None:
        """The captured reference, unless it is stale."""
        if self.captured is None or self._scene() is None or self.captured.of != self.subject():
            return None
        return self.captured.reference

    @property
    def reference_is_stale(self) -> bool:
        return self.captured is not None and self.reference is None

    def close(self):
        self.cancel_capture()
        self._stop()
        if self._stop in self._renderer.before_upload:
            self._renderer.before_upload.remove(self._stop)
        self._worker.shutdown(wait=False, cancel_futures=True)
        for side in self.sides.values():
            built = _built_of(side)
            if built is not None and built.figures is not None and built.figures.cancelled():
                built.figures = None  # so that another view asks again
        self.sides = {name: Side() for name in SIDES}
        self.captured = None

    # The reference

    def start_capture(self, samples: int):
        """Renders a reference of the present view; the two sides wait meanwhile."""
        self.cancel_capture()
        self._stop()
        self.capture = Capture(self, samples)

    def cancel_capture(self):
        if self.capture is not None:
            self.capture.session.cancel()
            self.capture = None
            self._stale = True

    # Going on

    @property
    def busy(self) -> bool:
        if self.capture is not None or self._measuring or self._awaited_figures or self._renderer.busy:
            return True
        return not self.problem and (self._stale or self._divisor > 0)

    def advance(self) -> bool:
        """Takes new pixels, starts what is next; whether there is something new to draw."""
        try:
            return self._advance()
        except (ValueError, RuntimeError, MemoryError) as error:
            self.problem = f"Rendering stopped: {error}"
            self._divisor, self.capture = 0, None
            return True

    def wait_for_picture(self, seconds: float):
        """Waits for the first picture of the view if there is none yet."""
        end = time.perf_counter() + seconds
        self.advance()
        while self._awaits_first_picture() and time.perf_counter() < end:
            for side in self._rendering():
                side.session.wait(max(end - time.perf_counter(), 0.0))
            self.advance()

    def _advance(self) -> bool:
        is_new = self._collect_measurements()
        if self._scene() is None or self.request is None:
            return is_new
        if self.capture is not None:
            return self._advance_capture() or is_new
        if self._stale:
            self._begin()
            return is_new
        if self._divisor == 0:
            return is_new
        now = time.perf_counter()
        for name, side in self.sides.items():
            is_new |= self._advance_side(name, side, now)
        if self._next is not None and not self._awaits_first_picture():
            self._adopt(self._next)
        elif all(side.finished for side in self.sides.values()):
            if self._divisor > 1:
                self._start(1)
            else:
                self._divisor = 0
                self._request_figures()
        return is_new

    def _advance_capture(self) -> bool:
        done = self.capture.advance()
        if done is not None:
            self.captured, self.capture = done, None
            self._stale = True
        now = time.perf_counter()
        if done is None and now - self._progress_shown < REFINEMENT_SECONDS:
            return False
        self._progress_shown = now
        return True

    def _advance_side(self, name: str, side: Side, now: float) -> bool:
        if side.finished:
            return False
        running = side.session.running  # asked first: what ends afterwards is seen next time
        if side.session.error:
            raise RuntimeError(side.session.error)
        out_of_time = self.request.clock.kind == "TIME" and now - self._started >= self.request.clock.seconds
        if running and self._divisor == 1 and out_of_time and side.session.samples_done > 0:
            side.session.cancel()
            running = False
        done = side.session.samples_done
        side.finished = not running
        before = side.picture.samples if side.picture and side.picture.divisor == self._divisor else 0
        if done == before and not (side.finished and self._divisor == 1):
            return False
        is_due = done >= 2 * max(side.measured_at, 1) or side.measured_at == 0 or side.finished
        if running and before and not is_due and now - side.taken_at < REFINEMENT_SECONDS:
            return False
        seconds = side.session.render_seconds if side.finished else now - self._started
        side.picture = Picture(side.session.pixels(), self.request.view, self._divisor, done, seconds)
        side.seconds, side.taken_at = seconds, now
        if self._divisor == 1 and is_due and side.method is not None:
            self._measure(name, side)
        return True

    # Inside

    def _scene(self):
        sync = self.scene_sync
        return sync if sync is not None and sync.built is not None else None

    def _rendering(self) -> list[Side]:
        return [side for side in self.sides.values() if side.session is not None and side.session.running]

    def _awaits_first_picture(self) -> bool:
        return self._divisor > 1 and any(not side.finished for side in self.sides.values())

    def _adopt(self, request: Request):
        self.request, self._next = request, None
        self._stop()

    def _stop(self):
        """Stands still, so that the scene may be changed."""
        if self.capture is not None:
            self.capture.session.cancel()
            self.capture = None
        for side in self.sides.values():
            if side.session is not None:
                side.session.cancel()
        self._divisor = 0
        self._stale = True

    def _begin(self):
        """Starts both sides once their samplers are built."""
        sync = self._scene()
        for side, method in zip(self.sides.values(), self.request.methods, strict=True):
            side.method = method
            side.sampler = None
            if method is not None:
                side.sampler = environments.request(sync.environment, method.sampler)
        if not all(side.sampler is None or side.sampler.done() for side in self.sides.values()):
            return
        self.problem = ""
        self._stale = False
        self._made_for = self.subject(), self.request
        for side in self.sides.values():
            side.steps, side.measured_at, side.seconds = [], 0, 0.0
            self._show_reference(side)
        self._start(self._first_divisor())

    def _request_figures(self):
        """Once both pictures are complete: figures of a large map's sampler take seconds of a processor."""
        for side in self._drawn_by_session():
            built = _built_of(side)
            if built is not None and built.figures is None:
                built.figures = self._worker.submit(sampler_figures, built.sampler, built.image)
                self._awaited_figures.append(built.figures)

    def _show_reference(self, side: Side):
        if side.method is not None:
            return
        side.picture = None
        if self.captured is not None and self.captured.of[0] == self.request.view:
            rgb = self.captured.reference.image
            rgba = np.ones((*rgb.shape[:2], 4), np.float32)
            rgba[..., :3] = rgb
            side.picture = Picture(rgba, self.request.view, 1, self.captured.samples, 0.0)

    def _first_divisor(self) -> int:
        # Never 1: the first step also builds the scene's trees, whose time belongs to neither side.
        _, _, width, height = self.request.view.rectangle
        divisor = 2
        while divisor < COARSEST_DIVISOR:
            if 2 * width * height / divisor**2 * self._renderer.seconds_per_sample < FIRST_PICTURE_SECONDS:
                break
            divisor *= 2
        return divisor

    def _start(self, divisor: int):
        for side in self.sides.values():
            side.finished = True
            if side.session is not None:
                side.session.cancel()
        self._renderer.pause()
        sync, request = self._scene(), self.request
        sync.set_camera(*request.view.matrices())
        width, height, border = request.view.scaled(divisor)
        count = request.clock.samples if request.clock.kind == "SAMPLES" else UNLIMITED_SAMPLES
        self._divisor, self._started = divisor, time.perf_counter()
        for side in self._drawn_by_session():
            workers = self._threads(), request.settings.device
            if side.session is None or side.workers != workers:
                side.session, side.workers = native.core().RenderSession(*workers), workers
            side.finished = False
            side.session.start(
                sync.scene,
                width,
                height,
                count if divisor == 1 else 1,
                region=border,
                sampler=side.sampler.result().sampler,
                light_sampling=side.method.light_sampling,
                **request.settings.options(),
            )

    def _drawn_by_session(self) -> list[Side]:
        return [side for side in self.sides.values() if side.method is not None]

    def _threads(self) -> int:
        """Of each side. Half of all, whether or not the other one renders, so that figures can be
        compared."""
        return max((self.request.settings.threads or os.cpu_count() or 2) // 2, 1)

    # Errors

    def _measure(self, name: str, side: Side):
        side.measured_at = side.picture.samples
        reference = self.reference
        if reference is None or side.picture.samples == 0:
            return
        pixels = side.picture.pixels[..., :3]
        # A GPU is one device, whatever its number of threads.
        device_seconds = side.seconds * (self._threads() if side.workers[1] == "CPU" else 1)
        job = self._worker.submit(
            make_step, side.picture.samples, pixels, reference, side.seconds, device_seconds
        )
        self._measuring.append((name, self._made_for, job))

    def _collect_measurements(self) -> bool:
        done = [entry for entry in self._measuring if entry[2].done()]
        self._measuring = [entry for entry in self._measuring if not entry[2].done()]
        for name, made_for, job in done:
            if made_for is self._made_for and not job.cancelled():
                side = self.sides[name]
                side.steps = [step for step in side.steps if step.samples < job.result().samples]
                side.steps.append(job.result())
        known = [future for future in self._awaited_figures if future.done()]
        self._awaited_figures = [future for future in self._awaited_figures if not future.done()]
        return bool(done or known)


def _built_of(side: Side) -> BuiltEnvironment | None:
    """The sampler whose figures tell about a side, once it is built."""
    if side.method is None or not side.method.light_sampling or side.sampler is None:
        return None
    if not side.sampler.done() or side.sampler.exception() is not None:
        return None
    built = side.sampler.result()
    return built if built.image is not None else None


def sampler_figures_of(side: Side) -> dict | None:
    """Figures of a side's sampler, as far as they are known."""
    built = _built_of(side)
    if built is None or built.figures is None or not built.figures.done() or built.figures.cancelled():
        return None
    return built.figures.result()
