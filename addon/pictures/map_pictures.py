# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's map and its kd-tree for panels and overlays: built and drawn on threads, followed by a timer.

`follow(scene)` is cheap and may be called while drawing; what has changed since is on show a moment later.
"""

from __future__ import annotations

import traceback
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import bpy
import bpy.utils.previews
import numpy as np
from bpy.app.handlers import persistent

from ..environments import BuiltEnvironment, SamplerSettings, environments
from ..images import ImageStore
from ..messages import Messages
from ..viewport import clock as viewport_clock
from ..world import Environment, read_world
from . import plots as pictures

SIZE = 512  # of the pictures, which panels show as square icons
TICK_SECONDS = 0.03

KINDS = (
    ("BLOCKS", "Blocks", "The map with the blocks of the kd-tree, and below rebuilt from its blocks"),
    ("PDF", "Probabilities", "The blocks' probabilities in descending order and the fitted model"),
    (
        "EXPOSURE",
        "Exposure",
        "The map in stops about its median, and how much sphere and light each stop has",
    ),
)


@dataclass(frozen=True)
class Current:
    """The environment that is on show and its sampler."""

    key: tuple
    environment: Environment
    built: BuiltEnvironment


_store = ImageStore()
_worker: ThreadPoolExecutor | None = None
_previews = None
_current: Current | None = None
_building: tuple[tuple, Environment, Future] | None = None
_drawing: dict[str, tuple[tuple, Future]] = {}  # by kind
_shown: dict[str, tuple] = {}  # kind -> key of what its icon shows
_wanted: set[str] = set()
_problem = ""


def follow(scene, kind: str | None = None):
    """Keeps `current()` and, where named, the picture `kind` up to date."""
    if kind is not None:
        _wanted.add(kind)
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=0.0)


def current() -> Current | None:
    return _current


def problem() -> str:
    return _problem


def icon(kind: str) -> int:
    """The icon of a picture; 0 as long as there is none."""
    return _previews[kind].icon_id if _previews is not None and kind in _shown else 0


def picture(built: BuiltEnvironment, kind: str, width: int = SIZE, height: int = SIZE) -> np.ndarray | None:
    """(height,width,3) in display space, row 0 at the top; None where this map or sampler has no such
    picture."""
    image, sampler = built.image, built.sampler
    if image is None:
        return None
    if kind == "EXPOSURE":
        return pictures.exposure_picture(image, height, width)
    if not hasattr(sampler, "bounds"):
        return None
    if kind == "PDF":
        return pictures.pdf_picture(sampler.empirical, sampler.alpha, height, width)
    above = pictures.blocks_picture(image, sampler.bounds, height // 2, width)
    below = pictures.rebuilt_picture(image, sampler.reconstruct(), height - height // 2, width)
    return np.concatenate((above, below))


def _tick():
    global _problem
    try:
        is_busy = _advance()
        _problem = ""
    except Exception as error:
        # The panel says so; a timer that raises would only fill the console.
        if not isinstance(error, (ValueError, RuntimeError, MemoryError)):
            traceback.print_exc()
        _problem, is_busy = str(error), False
        _redraw()
    return TICK_SECONDS if is_busy else None


def _advance() -> bool:
    """Whether something is still going on."""
    global _current, _building
    if _building is not None:
        key, environment, future = _building
        if not future.done():
            return True
        _building = None
        _current = Current(key, environment, future.result())
        _redraw()
    key, environment, settings = _read()
    if _current is None or key != _current.key:
        _building = key, environment, environments.request(environment, settings, more_to_come=True)
        return True
    if not np.array_equal(environment.world_to_env, _current.environment.world_to_env):
        _current = replace(_current, environment=environment)
        _redraw()
    _wanted.intersection_update({kind for kind, *_ in KINDS})
    for kind in _wanted:
        if _shown.get(kind) != key and (kind not in _drawing or _drawing[kind][0] != key):
            _drawing[kind] = key, _pool().submit(picture, _current.built, kind)
    for kind in [kind for kind, (_, future) in _drawing.items() if future.done()]:
        drawn_key, future = _drawing.pop(kind)
        _show(kind, drawn_key, future.result())
    return bool(_drawing)


def _read() -> tuple[tuple, Environment, SamplerSettings]:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    scene = depsgraph.scene_eval
    environment = read_world(scene.world, _store, Messages())
    settings = SamplerSettings.of(scene.skytree)
    key = (environment.expression, settings)
    return key, environment, settings


def _show(kind: str, key: tuple, pixels: np.ndarray | None):
    if _previews is None:
        return
    if pixels is None:
        _shown.pop(kind, None)
    else:
        height, width = pixels.shape[:2]
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :3] = pixels[::-1]
        preview = _previews[kind] if kind in _previews else _previews.new(kind)
        preview.image_size = width, height
        preview.image_pixels_float.foreach_set(rgba.ravel())
        _shown[kind] = key
    _redraw()


def _redraw():
    viewport_clock.redraw_all()
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "PROPERTIES":
                area.tag_redraw()


def _pool() -> ThreadPoolExecutor:
    global _worker
    if _worker is None:
        _worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="skytree-pictures")
    return _worker


@persistent
def clear(*_):
    """Forgets everything; what a thread still draws is dropped."""
    global _current, _building
    _current = _building = None
    _drawing.clear()
    _shown.clear()
    _wanted.clear()


def register():
    global _previews
    _previews = bpy.utils.previews.new()
    bpy.app.handlers.load_pre.append(clear)


def unregister():
    global _previews, _worker
    bpy.app.handlers.load_pre.remove(clear)
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    clear()
    bpy.utils.previews.remove(_previews)
    _previews = None
    if _worker is not None:
        _worker.shutdown(wait=False, cancel_futures=True)
        _worker = None
