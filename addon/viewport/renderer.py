# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture of the scene that follows one view: a native session, a SceneSync and rising resolutions.

Serves the engine's viewport, the floating preview and comparisons alike. All methods belong to the main
thread and return soon: rendering, building trees and building samplers happen on native threads, and
`advance`, which viewport.clock calls while anything is going on, collects what they have done.
"""

from __future__ import annotations

import time
import traceback
import weakref
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import native, status
from ..devices import render_device, render_threads
from ..environments import candidates_of
from ..sync.scene import SceneSync
from . import gpu_draw
from .view import View, visibility_of

# Renderers that have not been closed.
alive: weakref.WeakSet[ViewportRenderer] = weakref.WeakSet()

# The first picture after a change has as many pixels as can be rendered in this time...
FIRST_PICTURE_SECONDS = 0.015
# ...and a redraw waits for it no longer than this, so that it shows the view it was asked for.
LONGEST_WAIT_SECONDS = 0.02
# A sampler gets so much; if it is ready then, both together get no more than the second. Drawing an old
# picture takes the processor from the threads that build where OpenGL is software.
SAMPLER_WAIT_SECONDS = 0.025
# Before Blender redraws anything, a sampler that was just asked for gets so much.
UPDATE_WAIT_SECONDS = 0.02
BOTH_WAIT_SECONDS = 0.033
COARSEST_DIVISOR = 8
# Of one pixel sample, before anything has been measured.
ASSUMED_SECONDS = 1e-6
# Between two uploads of a picture that only gets less noisy.
REFINEMENT_SECONDS = 0.1


@dataclass(frozen=True)
class RenderSettings:
    """What the pixels depend on besides scene and view."""

    samples: int = 256
    max_bounces: int = 4
    seed: int = 0
    pixel_filter: str = "BLACKMAN_HARRIS"
    filter_width: float = 1.5
    film_transparent: bool = False
    threads: int = 0
    device: str = "CPU"
    candidates: int = 0  # of a light sample, see RenderSession.start
    light_rays: int = 0
    control_variate: bool = True
    product_sampling: bool = True

    @classmethod
    def of(cls, scene) -> RenderSettings:
        settings, render = scene.skytree, scene.render
        return cls(
            settings.preview_samples,
            settings.max_bounces,
            settings.seed,
            settings.pixel_filter,
            settings.filter_width,
            render.film_transparent,
            render_threads(render),
            render_device(settings),
            candidates_of(settings),
            settings.light_rays,
            settings.control_variate,
            settings.product_sampling,
        )

    def estimators(self) -> dict:
        """Arguments of RenderSession.start that are left out where samplers are compared."""
        return {
            "light_rays": self.light_rays,
            "control_variate": self.control_variate,
            "product_sampling": self.product_sampling,
        }

    def options(self) -> dict:
        """Arguments of RenderSession.start, but for size, samples, region and estimators."""
        return {
            "max_bounces": self.max_bounces,
            "seed": self.seed,
            "pixel_filter": self.pixel_filter,
            "filter_width": self.filter_width,
            "film_transparent": self.film_transparent,
            "blue_noise": True,
            "candidates": self.candidates,
        }


@dataclass
class Picture:
    """The newest pixels of a view at 1/divisor of its resolution."""

    pixels: np.ndarray  # (height, width, 4) float32, bottom row first
    view: View
    divisor: int
    samples: int
    seconds: float  # since the change that asked for it


class ViewportRenderer:
    """`update` brings changes of the scene, `look` of the view; then `advance` until it is not `busy`.

    `problem` is a text to show instead of a picture that cannot be made; nothing raises."""

    def __init__(self):
        self.sync: SceneSync | None = None
        self.picture: Picture | None = None
        self.problem = ""
        self.before_upload: list[Callable[[], None]] = []  # for others that render the same scene
        self.seconds_per_sample = ASSUMED_SECONDS  # and pixel, wall clock
        self.first_picture_seconds = 0.0  # from the last change to its first picture
        self._session = None
        self._workers = (0, "CPU")  # threads and device of the session
        self._view: View | None = None
        self._settings = RenderSettings()
        self._next: tuple[View, RenderSettings] | None = None
        self._visibility: tuple = ()
        self._stale = False  # the session does not render what it should
        self._divisor = 0  # of the step that is being rendered; 0: none
        self._taken = 0  # samples of the step that `picture` holds
        self._awaits_first = False
        self._asked = self._uploaded = 0.0
        self._texture: tuple[Picture, object] | None = None
        alive.add(self)

    # What the scene is

    def update(self, depsgraph, space=None):
        """The first call reads all of the depsgraph, later ones what depsgraph.updates name. `space` is that
        of the 3D view, whose local view counts; it is not kept."""
        with self._reporting():
            if self.sync is None:
                sync = SceneSync(self._before_upload, wait_for_samplers=False)
                sync.sync(depsgraph, space)
                self.sync = sync
                self._visibility = visibility_of(space)
                self._stale = True
            else:
                self.sync.update(depsgraph, space)
            self._tell_status()
            if self._waiting_for_sampler() and self._session is not None:
                # Nobody looks at further samples of the old picture, and the new sampler needs the cores.
                self._session.cancel()
                self._stale = True
                self.sync.wait_since_asked(UPDATE_WAIT_SECONDS)
                if not self.sync.follow_environment():
                    self._tell_status()
        if not self._waiting_for_sampler():
            self._restart_if_stale()

    def show_and_hide(self, depsgraph, space):
        """Follows a local view that is entered or left, of which depsgraph.updates say nothing."""
        visibility = visibility_of(space)
        if self.sync is None or visibility == self._visibility:
            return
        self._visibility = visibility
        with self._reporting():
            self.sync.show_and_hide(depsgraph, space)
        self._restart_if_stale()

    def look(self, view: View | None, settings: RenderSettings):
        """The view to show, None for none. What is unchanged goes on refining."""
        if (view, settings) == (self._view, self._settings):
            self._next = None
            return
        waits_for_first = self._session is not None and self._session.running and self._taken == 0
        if waits_for_first and not self._stale and view is not None and self._view is not None:
            # While the view moves all the time, cancelling every first picture would show none.
            self._next = view, settings
            return
        self._begin(view, settings)

    def pause(self):
        """Renders nothing until the next `look`."""
        self._begin(None, self._settings)

    def close(self):
        """Gives back scene, threads and pictures."""
        alive.discard(self)
        if self._session is not None:
            self._session.cancel()
        self._session = self.sync = self.picture = self._texture = self._view = self._next = None
        self._stale = False
        self._divisor = 0

    # What is going on

    @property
    def busy(self) -> bool:
        if self.problem:
            return self._waiting_for_sampler()
        return self._stale or self._divisor > 0 or self._waiting_for_sampler()

    @property
    def urgent(self) -> bool:
        """Whether what is shown is older than what was asked for."""
        return not self.problem and (self._waiting_for_sampler() or (self._divisor > 0 and self._taken == 0))

    @property
    def running(self) -> bool:
        return self._session is not None and self._session.running

    @property
    def samples(self) -> int:
        return self._settings.samples

    @property
    def samples_done(self) -> int:
        """Of the picture at full resolution."""
        return self.picture.samples if self.picture and self.picture.divisor == 1 else 0

    @property
    def view(self) -> View | None:
        return self._view

    @property
    def size(self) -> tuple[int, int]:
        return (self._view.width, self._view.height) if self._view else (0, 0)

    def pixels(self) -> np.ndarray | None:
        return self.picture.pixels if self.picture else None

    @property
    def session(self):
        return self._session

    def advance(self) -> bool:
        """Takes new pixels and starts the next step; whether there is something new to draw."""
        with self._reporting():
            if self._waiting_for_sampler():
                if self.sync.follow_environment():
                    return False
                self._tell_status()
                self._restart_if_stale()
                return True  # the redraw waits for the first picture
            self._restart_if_stale()
            return self._advance()
        return True

    def wait_for_picture(self):
        """Waits for the first picture of the view if there is none yet, and for the sampler before it."""
        end = time.perf_counter() + LONGEST_WAIT_SECONDS
        if self._waiting_for_sampler():
            end += BOTH_WAIT_SECONDS - LONGEST_WAIT_SECONDS
            self.sync.wait_for_sampler(SAMPLER_WAIT_SECONDS)
            self.advance()
        if self.running and self._taken == 0:
            self._session.wait(max(end - time.perf_counter(), 0.0))
        self.advance()

    def status_line(self) -> str:
        if self.problem:
            return self.problem
        if self.sync is None or self.sync.built is None:
            return "Building the sampler"
        if self._waiting_for_sampler():
            return "Building the sampler"
        if self._view is None:
            return "Nothing to show in the render border"
        line = f"Sample {self.samples_done}/{self.samples}"
        if self._session is not None and self._session.warning:
            line += f". {self._session.warning}"
        return line

    # Drawing

    def draw(self, *, colors=gpu_draw.SCENE_LINEAR, view_transform=None, at=None):
        """Draws the newest picture into the region, or into the rectangle `at` (x, y, width, height)."""
        if self.picture is None:
            return
        if self._texture is None or self._texture[0] is not self.picture:
            self._texture = self.picture, gpu_draw.upload(self.picture.pixels)
        view = self._view or self.picture.view
        # An old picture stands in for a view of another size until the new one has its first pixels.
        rectangle = at or (view if self.picture.view.border is None else self.picture.view).rectangle
        gpu_draw.draw_image(
            self._texture[1],
            *rectangle,
            colors=colors,
            view_transform=view_transform,
            smooth=self.picture.divisor > 1 or at is not None,
        )

    # Inside

    def _reporting(self):
        return _Reporting(self)

    def _before_upload(self):
        for stop in self.before_upload:
            stop()
        if self._session is not None:
            self._session.cancel()
        self._stale = True

    def _waiting_for_sampler(self) -> bool:
        return self.sync is not None and self.sync.awaits_sampler

    def _begin(self, view: View | None, settings: RenderSettings):
        self._view, self._settings, self._next = view, settings, None
        self._stale = True
        self._restart_if_stale()

    def _restart_if_stale(self):
        if not self._stale:
            return
        if self._session is not None:
            self._session.cancel()
        self._divisor = self._taken = 0
        if self.sync is None or self.sync.built is None or self._view is None:
            self._stale = self._view is not None and self.sync is not None
            return
        self._stale = False
        self.problem = ""
        self._asked, self._awaits_first = time.perf_counter(), True
        with self._reporting():
            self._start(self._first_divisor())

    def _first_divisor(self) -> int:
        _, _, width, height = self._view.rectangle
        divisor = 1
        while divisor < COARSEST_DIVISOR:
            if width * height / divisor**2 * self.seconds_per_sample < FIRST_PICTURE_SECONDS:
                break
            divisor *= 2
        return divisor

    def _start(self, divisor: int):
        workers = self._settings.threads, self._settings.device
        if self._session is None or self._workers != workers:
            self._session = native.core().RenderSession(*workers)
            self._workers = workers
        width, height, border = self._view.scaled(divisor)
        self.sync.set_camera(*self._view.matrices())
        samples = self._settings.samples if divisor == 1 else 1
        self._session.start(
            self.sync.scene,
            width,
            height,
            samples,
            region=border,
            **self._settings.options(),
            **self._settings.estimators(),
        )
        self._divisor, self._taken = divisor, 0

    def _advance(self) -> bool:
        if self._divisor == 0:
            return False
        running = self._session.running  # asked first: what ends afterwards is seen next time
        if self._session.error:
            self.problem = f"Rendering stopped: {self._session.error}"
            self._divisor = 0
            return True
        is_new = self._take(running)
        if self._taken and self._next:
            self._begin(*self._next)
        elif not running:
            self._measure()
            if self._divisor > 1:
                self._start(self._divisor // 2)
            else:
                self._divisor = 0
        return is_new

    def _take(self, running: bool) -> bool:
        done = self._session.samples_done
        if done == self._taken:
            return False
        now = time.perf_counter()
        if running and self._taken and now - self._uploaded < REFINEMENT_SECONDS:
            return False
        self.picture = Picture(self._session.pixels(), self._view, self._divisor, done, now - self._asked)
        if self._awaits_first:
            self._awaits_first, self.first_picture_seconds = False, self.picture.seconds
        self._taken, self._uploaded = done, now
        return True

    def _measure(self):
        stats = self._session.stats
        _, _, width, height = self._view.rectangle
        count = width * height / self._divisor**2 * max(self._taken, 1)
        self.seconds_per_sample = max(stats["seconds"] - stats["commit_seconds"], 1e-6) / count

    def _tell_status(self):
        if self.sync is not None and self.sync.built is not None:
            status.last.update(self.sync)


class _Reporting:
    """Turns what is raised inside into the renderer's `problem`."""

    def __init__(self, renderer: ViewportRenderer):
        self._renderer = renderer

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace) -> bool:
        if error is None or not isinstance(error, Exception):
            return False
        if not isinstance(error, (ValueError, RuntimeError, MemoryError)):
            traceback.print_exception(kind, error, trace)  # a bug of ours
        self._renderer.problem = str(error) or kind.__name__
        self._renderer._divisor = 0
        return True
