# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives a real Blender window: scenarios are generators that yield the seconds to let Blender go on.

Run by test_window.py:  blender --factory-startup --enable-event-simulate --python driver.py -- SCENARIOS OUT
A scenario is a function `scenario_*(w)` of the file SCENARIOS; `w` is the Window below. What they come to is
written to OUT as JSON; screenshots go to the folder of OUT.
"""

import contextlib
import importlib.util
import json
import os
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

# Far beyond what anything takes on an idle machine: these end what hangs, they judge no speed.
GIVE_UP_SECONDS = 180.0


class Window:
    """The one window, its 3D view, and what a user does with them."""

    def __init__(self, folder: Path, addon):
        self.folder, self.addon = folder, addon
        self.figures: dict[str, float] = {}

    def part(self, name: str):
        return importlib.import_module(f"{self.addon.__name__}.{name}")

    # Where

    @property
    def window(self):
        return bpy.context.window_manager.windows[0]

    @property
    def area(self):
        return next(a for a in self.window.screen.areas if a.type == "VIEW_3D")

    @property
    def space(self):
        return self.area.spaces.active

    @property
    def region(self):
        return next(r for r in self.area.regions if r.type == "WINDOW")

    @property
    def scene(self):
        return self.window.scene

    def override(self, area=None):
        area = area or self.area
        region = next(r for r in area.regions if r.type == "WINDOW")
        return bpy.context.temp_override(
            window=self.window, screen=self.window.screen, area=area, region=region
        )

    # What a user does

    def event(self, kind: str, value: str = "PRESS", at=(0.5, 0.5), **modifiers):
        """`at` is a place in the 3D view, in shares of its size."""
        x = int(self.region.x + at[0] * self.region.width)
        y = int(self.region.y + at[1] * self.region.height)
        self.window.event_simulate(type=kind, value=value, x=x, y=y, **modifiers)

    def key(self, kind: str, at=(0.5, 0.5), **modifiers):
        self.event("MOUSEMOVE", "NOTHING", at)
        self.event(kind, "PRESS", at, **modifiers)
        self.event(kind, "RELEASE", at, **modifiers)

    def drag(self, button: str, start, end, steps: int = 6, **modifiers):
        """Presses, moves and releases a mouse button, a step per redraw."""
        self.event("MOUSEMOVE", "NOTHING", start)
        self.event(button, "PRESS", start, **modifiers)
        for i in range(1, steps + 1):
            yield 0.05
            t = i / steps
            at = tuple(a + (b - a) * t for a, b in zip(start, end, strict=True))
            self.event("MOUSEMOVE", "NOTHING", at, **modifiers)
        yield 0.05
        self.event(button, "RELEASE", end, **modifiers)
        yield 0.05

    def shade(self, kind: str):
        self.space.shading.type = kind

    # What there is to see

    def shot(self, name: str) -> np.ndarray:
        """The window as (height, width, 3) in 0..1, row 0 at the bottom; kept as NAME.png."""
        path = str(self.folder / f"{name}.png")
        with self.override():
            bpy.ops.screen.screenshot(filepath=path)
        image = bpy.data.images.load(path)
        try:
            width, height = image.size
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
            return pixels.reshape(height, width, -1)[..., :3].copy()
        finally:
            bpy.data.images.remove(image)

    def view_of(self, shot: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """The part of a screenshot that the 3D view takes, less a share at each edge."""
        r = self.region
        dx, dy = int(r.width * margin), int(r.height * margin)
        return shot[r.y + dy : r.y + r.height - dy, r.x + dx : r.x + r.width - dx]

    def renderers(self) -> list:
        """The engine's renderers that are alive, in all 3D views."""
        module = self.part("viewport.renderer")
        return list(module.alive)

    def until(self, condition, seconds: float = 60.0, what: str = ""):
        """Yields until condition() holds; fails after `seconds`."""
        end = time.perf_counter() + seconds
        while not condition():
            assert time.perf_counter() < end, f"gave up waiting for {what or condition}"
            yield 0.02

    def until_still(self, seconds: float = 90.0):
        """Yields until no renderer has anything to do."""
        yield 0.1
        yield from self.until(lambda: not any(r.busy for r in self.renderers()), seconds, "the renderers")
        yield 0.3

    def skip(self, reason: str):
        """Ends the scenario, as one that this machine cannot play."""
        raise SkippedError(reason)

    def figure(self, name: str, value: float):
        """A number that the test run prints."""
        self.figures[name] = float(value)


class Run:
    """Runs the scenarios one after the other from a timer."""

    def __init__(self, scenarios, window: Window, out: Path):
        self.waiting = list(scenarios)
        self.window, self.out = window, out
        self.results: dict[str, dict] = {}
        self.name, self.current, self.started = "", None, 0.0

    def tick(self):
        if self.current is None:
            if not self.waiting:
                self.finish()
            self.name, function = self.waiting.pop(0)
            self.started = time.perf_counter()
            self.window.figures = {}
            print(f"scenario {self.name}", flush=True)
            self.current = function(self.window)
        try:
            if time.perf_counter() - self.started > GIVE_UP_SECONDS:
                raise AssertionError(f"took longer than {GIVE_UP_SECONDS} s")
            return max(float(next(self.current)), 0.001)
        except StopIteration:
            self.end("passed", "")
        except SkippedError as skipped:
            self.end("skipped", str(skipped))
        except Exception:
            detail = traceback.format_exc()
            with contextlib.suppress(Exception):
                self.window.shot(f"{self.name}_failed")
            self.end("failed", detail)
        return 0.05

    def end(self, outcome: str, detail: str):
        self.results[self.name] = {
            "outcome": outcome,
            "detail": detail,
            "seconds": time.perf_counter() - self.started,
            "figures": self.window.figures,
        }
        if outcome == "failed":
            print(detail, flush=True)
        self.current = None
        self.out.write_text(json.dumps(self.results, indent=1))

    def finish(self):
        print("all scenarios done", flush=True)
        sys.stdout.flush()
        os._exit(0)


class SkippedError(Exception):
    """Raised by a scenario that cannot run here; the text says why."""


def load(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def main():
    scenarios_path, out = (Path(a) for a in sys.argv[sys.argv.index("--") + 1 :][:2])
    wanted = os.environ.get("SKYTREE_SCENARIO", "").split(",")  # parts of names, for development
    from installing import install

    addon = install()
    preferences = bpy.context.preferences
    preferences.view.show_splash = False
    preferences.view.render_display_type = "NONE"
    preferences.edit.use_global_undo = True
    module = load(scenarios_path)
    functions = [
        (name, f)
        for name, f in vars(module).items()
        if name.startswith("scenario_") and any(part in name for part in wanted)
    ]
    run = Run(functions, Window(out.parent, addon), out)
    bpy.app.timers.register(run.tick, first_interval=1.0, persistent=True)


# Scenarios import this file as `driver`.
sys.modules.setdefault("driver", sys.modules[__name__])

if __name__ == "__main__":
    main()
