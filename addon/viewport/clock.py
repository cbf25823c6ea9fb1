# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls renderers of the viewports while they have something to do, and redraws the regions that show them.

One timer for all of them; it stops when nothing is going on.
"""

from __future__ import annotations

import traceback
import weakref

import bpy

TICK_SECONDS = 0.015
# While what is shown is older than what was asked for.
EAGER_SECONDS = 0.004

# Anything with `advance() -> bool`, `busy` and `urgent`, by the address of the region that shows it. The
# address is only compared: a region may be gone at any time, and with it what lies there.
_watched: dict[int, weakref.WeakSet] = {}


def watch(renderer, region):
    """Calls `renderer.advance()` until it is not `busy`; whenever that returns True the region is redrawn."""
    _watched.setdefault(region.as_pointer(), weakref.WeakSet()).add(renderer)
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=EAGER_SECONDS, persistent=True)


def forget(renderer):
    for renderers in _watched.values():
        renderers.discard(renderer)


def stop():
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    _watched.clear()


def regions():
    """All (region, area) of 3D views in all windows."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "WINDOW":
                        yield region, area


def redraw_all(self=None, context=None):
    """Also the update function of properties that all 3D views show."""
    for region, _area in regions():
        region.tag_redraw()


def redraw_sidebars():
    """The sidebars of 3D views and the properties, whose panels show how far something is."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            for region in area.regions:
                if (area.type, region.type) in {("VIEW_3D", "UI"), ("PROPERTIES", "WINDOW")}:
                    region.tag_redraw()


def _tick():
    redraw = set()
    for pointer, renderers in list(_watched.items()):
        for renderer in list(renderers):
            try:
                if renderer.advance():
                    redraw.add(pointer)
                if not renderer.busy:
                    renderers.discard(renderer)
            except Exception:
                traceback.print_exc()
                renderers.discard(renderer)
        if not renderers:
            del _watched[pointer]
    if redraw:
        for region, _ in regions():
            if region.as_pointer() in redraw:
                region.tag_redraw()
    if not _watched:
        return None
    urgent = any(renderer.urgent for renderers in _watched.values() for renderer in renderers)
    return EAGER_SECONDS if urgent else TICK_SECONDS
