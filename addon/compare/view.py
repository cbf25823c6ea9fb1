# SPDX-License-Identifier: GPL-3.0-or-later
"""Two renders of one view at the same time: same camera, same seeds, same number of threads, different
sampling.

A CompareView works beside the ViewportRenderer of its region and shares that one's scene. Like there, every
method belongs to the main thread and returns soon: native threads render, one Python thread measures
errors.
"""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import replace

import numpy as np

from .. import native
from ..environments import BuiltEnvironment, environments
from ..viewport.renderer import (
    BOTH_WAIT_SECONDS,
    FIRST_PICTURE_SECONDS,
    LONGEST_WAIT_SECONDS,
    REFINEMENT_SECONDS,
    SAMPLER_WAIT_SECONDS,
    Picture,
    ViewportRenderer,
)
from .capture import Capture, CapturedReference
from .metrics import Reference, sampler_figures
from .report import make_step
from .sides import Request, Side, built_of

UNLIMITED_SAMPLES = 1 << 20
COARSEST_DIVISOR = 8
SIDES = ("a", "b")


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
        self._kept: frozenset[str] = frozenset()  # sides whose complete pictures stay
        self._stale = True
        self._divisor = 0
        self._started = 0.0
        self._progress_shown = 0.0
        self._measuring: list[tuple[str, tuple, Future]] = []
        self._awaited_figures: list[BuiltEnvironment] = []
        self._stop_figures = threading.Event()
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
    def urgent(self) -> bool:
        """Whether what is shown is older than what was asked for."""
        return not self.problem and (self._stale or self._awaits_first_picture())

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

    def wait_for_picture(self):
        """Waits for the first picture of the view if there is none yet, and for samplers before it."""
        end = time.perf_counter() + LONGEST_WAIT_SECONDS
        self.advance()
        if self._stale and self.capture is None:
            end += BOTH_WAIT_SECONDS - LONGEST_WAIT_SECONDS
            samplers = [side.sampler for side in self.sides.values() if side.sampler is not None]
            wait(samplers, SAMPLER_WAIT_SECONDS)
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
        before, self.request, self._next = self.request, request, None
        kept = frozenset(name for name in SIDES if self._remains(name, before, request))
        self._stop()
        self._kept = kept

    def _remains(self, name: str, before: Request | None, request: Request) -> bool:
        """Whether a side's picture is complete and what `request` asks for as well. At equal time both sides
        have to run side by side again."""
        if before is None or request.clock.kind == "TIME" or (self._stale and name not in self._kept):
            return False
        if replace(before, methods=request.methods) != request:
            return False
        side, i = self.sides[name], SIDES.index(name)
        is_complete = side.finished and side.picture is not None and side.picture.divisor == 1
        return is_complete and request.methods[i] is not None and request.methods[i] == before.methods[i]

    def _stop(self):
        """Stands still, so that the scene may be changed."""
        self._kept = frozenset()
        if self.capture is not None:
            self.capture.session.cancel()
            self.capture = None
        for side in self.sides.values():
            if side.session is not None:
                side.session.cancel()
        self._drop_figures()
        self._divisor = 0
        self._stale = True

    def _begin(self):
        """Starts the sides that have to be made once their samplers are built."""
        sync = self._scene()
        for name, method in zip(SIDES, self.request.methods, strict=True):
            if name in self._kept:
                continue
            side = self.sides[name]
            side.method = method
            side.sampler = None
            if method is not None:
                side.sampler = environments.request(
                    sync.environment, method.sampler, threads=self.request.settings.threads, more_to_come=True
                )
        if not all(side.sampler is None or side.sampler.done() for side in self.sides.values()):
            return
        self.problem = ""
        self._stale = False
        made_for = self.subject(), self.request
        for name, side in self.sides.items():
            if name not in self._kept:
                side.made_for = made_for
                side.steps, side.measured_at, side.seconds = [], 0, 0.0
                self._show_reference(side)
        self._start(self._first_divisor())

    def _request_figures(self):
        """Once both pictures are complete: figures of a large map's sampler take seconds of a processor."""
        self._stop_figures = threading.Event()
        for side in self._drawn_by_session():
            built = built_of(side)
            if built is not None and built.figures is None:
                arguments = built.sampler, built.image, 2, self._stop_figures
                built.figures = self._worker.submit(sampler_figures, *arguments)
                self._awaited_figures.append(built)

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
        for name, side in self.sides.items():
            if side.method is None or name in self._kept:
                continue
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
                **{**request.settings.options(), "candidates": side.method.candidates},
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
        self._measuring.append((name, side.made_for, job))

    def _collect_measurements(self) -> bool:
        done = [entry for entry in self._measuring if entry[2].done()]
        self._measuring = [entry for entry in self._measuring if not entry[2].done()]
        for name, made_for, job in done:
            side = self.sides[name]
            if made_for is side.made_for and not job.cancelled():
                side.steps = [step for step in side.steps if step.samples < job.result().samples]
                side.steps.append(job.result())
        before = len(self._awaited_figures)
        self._awaited_figures = [built for built in self._awaited_figures if not built.figures.done()]
        return bool(done) or len(self._awaited_figures) < before

    def _drop_figures(self):
        """The next pictures need the processor; what was not finished is asked for again after them."""
        self._stop_figures.set()
        for built in self._awaited_figures:
            built.figures.cancel()
            if not built.figures.done() or built.figures.cancelled() or built.figures.exception() is not None:
                built.figures = None
        self._awaited_figures = []
