# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine's part in Blender's 3D views: one ViewportRenderer for every region in Rendered shading."""

from __future__ import annotations

import traceback

from ..compare import region as compare_region
from . import clock as viewport_clock
from . import gpu_draw
from .renderer import RenderSettings, ViewportRenderer
from .view import view_of

MESSAGE_SIZE = 13.0
MESSAGE_COLOR = (1.0, 0.8, 0.7, 1.0)
# Nearly opaque: in scene-linear values a bright picture shines through half a shadow.
MESSAGE_BACKGROUND = (0.02, 0.0, 0.0, 0.96)


class ViewportHooks:
    """Blender calls these on the engine object that it keeps for each region in Rendered shading."""

    _renderer: ViewportRenderer | None = None

    def view_update(self, context, depsgraph):
        try:
            if self._renderer is None:
                self._renderer = ViewportRenderer()
            self._renderer.update(depsgraph, context.space_data)
            compare_region.follow(self._renderer, context)
            viewport_clock.watch(self._renderer, context.region)
        except Exception:  # Blender disables an engine that raises while it draws
            traceback.print_exc()

    def view_draw(self, context, depsgraph):
        try:
            if self._renderer is not None:
                self._renderer.show_and_hide(depsgraph, context.space_data)
            self._draw(context, depsgraph.scene_eval)
        except Exception:
            traceback.print_exc()

    def _draw(self, context, scene):
        renderer, region = self._renderer, context.region
        if renderer is None or compare_region.draw(renderer, context):
            return
        renderer.look(
            view_of(region, context.region_data, context.space_data, scene), RenderSettings.of(scene)
        )
        renderer.wait_for_picture()
        renderer.draw()
        self.update_stats("", renderer.status_line())
        draw_problem(renderer.problem, region.width)
        if renderer.busy:
            viewport_clock.watch(renderer, region)

    def __del__(self):
        # Called when the view closes, leaves Rendered shading or another file is loaded.
        # Blender's own attribute access refuses once the engine is gone on its side.
        renderer = object.__getattribute__(self, "__dict__").pop("_renderer", None)
        if renderer is not None:
            viewport_clock.forget(renderer)
            compare_region.forget(renderer)
            renderer.close()


def draw_problem(problem: str, width: float, left: float = 0.0, low: float = 0.0):
    """A text over the lower edge of a picture, in as many lines as it needs."""
    for i, line in enumerate(reversed(wrapped(problem, width - 40.0))):
        gpu_draw.label(
            left + 16.0, low + 16.0 + 22.0 * i, line, MESSAGE_SIZE, MESSAGE_COLOR, MESSAGE_BACKGROUND
        )


def wrapped(words: str, width: float) -> list[str]:
    lines: list[str] = []
    for word in words.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and gpu_draw.text_size(longer, MESSAGE_SIZE)[0] <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
