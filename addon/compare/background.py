# SPDX-License-Identifier: GPL-3.0-or-later
"""A report that is made while the user goes on working: one thread renders and writes, a timer follows it.

What needs Blender's data stays on the main thread: reading the scene at the start, the view transform at the
end, a band of a picture at a time. In between nothing of Blender is touched.
"""

from __future__ import annotations

import threading
import time
import traceback
from pathlib import Path

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..viewport import clock as viewport_clock
from .job import PICTURES, ReportJob
from .render import CompareCancelled, Progress

TICK_SECONDS = 0.1
# Between two bands of pictures, for what else Blender has to do.
BAND_SECONDS = 0.005


class BackgroundReport:
    """`progress` says how far it is; afterwards `page` is the report or `problem` why there is none."""

    def __init__(self, job: ReportJob, folder: Path):
        self.progress = Progress("reading the scene", 0.0)
        self.page: Path | None = None
        self.problem = ""
        self.done = False
        self._job, self._folder = job, folder
        self._scene_name = job.scene.name
        self._cancelled = False
        self._error: Exception | None = None
        self._waiting: list[tuple[str, slice]] | None = None  # parts of pictures to show
        self._shown: dict[str, list[np.ndarray]] = {}
        self._display = ""  # through which they are shown
        job.read(self._tell)
        job.scene = None  # undo or another file may free it
        self._work(job.render)

    def cancel(self):
        """Stops soon; what was already written stays."""
        self._cancelled = True

    def join(self):
        """Waits until the thread has ended."""
        self._thread.join()

    def advance(self):
        """For the main thread, now and then."""
        if self.done or self._thread.is_alive():
            return
        if self._cancelled or isinstance(self._error, CompareCancelled):
            self.problem, self.done = "The comparison was cancelled", True
        elif self._error is not None:
            self.problem, self.done = f"The comparison failed: {self._error}", True
        elif self._waiting is None or self._waiting:
            self._show_a_part()
        else:
            self.done = True

    @property
    def is_showing(self) -> bool:
        """Whether `advance` has short work to do, one piece a call."""
        return bool(self._waiting)

    def _show_a_part(self):
        scene = bpy.data.scenes.get(self._scene_name) or bpy.context.scene
        if self._waiting is None:
            self.progress = Progress("writing the report", 1.0)
            self._waiting = self._job.parts_to_show()
        key, rows = self._waiting[0]
        part, name = self._job.show(key, scene, rows)
        if name != self._display and self._shown:
            self._shown, self._waiting = {}, None  # somebody has changed it: from the start
            return
        self._display = name
        self._shown.setdefault(key, []).append(part)
        del self._waiting[0]
        if not self._waiting:
            self._work(self._write)

    def summary(self) -> list[str]:
        return self._job.summary() if self.page is not None else []

    def _write(self):
        shown = {key: (np.concatenate(self._shown[key]), self._display) for key in PICTURES}
        self.page = self._job.write(self._folder, shown)["html"]

    def _work(self, function):
        self._thread = threading.Thread(
            target=self._run, args=(function,), name="Skytree report", daemon=True
        )
        self._thread.start()

    def _run(self, function):
        try:
            function()
        except Exception as error:
            self._error = error
            if not isinstance(error, (ValueError, RuntimeError, OSError, MemoryError, CompareCancelled)):
                traceback.print_exc()  # a bug of ours

    def _tell(self, progress: Progress):
        if self._cancelled:
            raise CompareCancelled
        self.progress = progress


_report: BackgroundReport | None = None
_redrawn_at = 0.0


def current() -> BackgroundReport | None:
    """The report that is being made, or else the last one."""
    return _report


def start(job: ReportJob, folder: Path) -> BackgroundReport:
    """Raises what reading the scene raises."""
    global _report
    stop()
    _report = None
    _report = BackgroundReport(job, folder)
    bpy.app.timers.register(_tick, first_interval=TICK_SECONDS, persistent=True)
    return _report


def stop():
    """Ends the report that is being made, if there is one."""
    if _report is not None and not _report.done:
        _report.cancel()
        _report.join()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _tick():
    global _redrawn_at
    try:
        _report.advance()
    except Exception as error:
        traceback.print_exc()
        _report.problem, _report.done = f"The comparison failed: {error}", True
    if _report.done or time.perf_counter() - _redrawn_at >= TICK_SECONDS:
        _redrawn_at = time.perf_counter()
        _redraw()
    if _report.done:
        return None
    return BAND_SECONDS if _report.is_showing else TICK_SECONDS


def _redraw():
    viewport_clock.redraw_sidebars()


@persistent
def _on_load(*_):
    stop()
    forget()


def forget():
    global _report
    _report = None


def register():
    bpy.app.handlers.load_pre.append(_on_load)


def unregister():
    bpy.app.handlers.load_pre.remove(_on_load)
    stop()
    forget()
