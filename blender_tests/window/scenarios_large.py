# SPDX-License-Identifier: GPL-3.0-or-later
"""How long Blender's own thread is held up, and how soon new pictures come, with a million triangles under
a map of 4096 x 2048 texels; see driver.py. Prints times and judges none: other programs share the machine."""

import itertools
import time

import scenes
from calls import Calls
from mathutils import Quaternion


def set_up(w):
    scene = scenes.new_scene()
    scene.skytree.preview_samples, scene.skytree.max_bounces = 2, 2
    ob, mapping = scenes.large_scene(scene)
    view = w.space.region_3d
    view.view_perspective = "PERSP"
    view.view_location = (0.0, 0.0, 0.0)
    view.view_rotation = Quaternion((0.88, 0.47, 0.0, 0.0)).normalized()
    view.view_distance = 6.0
    w.space.overlay.show_overlays = False
    hooks = w.part("viewport.hooks").ViewportHooks
    clock = w.part("viewport.clock")
    calls = Calls()
    # Not view_update and view_draw themselves: Blender counts the arguments of what it calls.
    calls.time(w.part("viewport.renderer").ViewportRenderer, "update", "view_update")
    calls.time(hooks, "_draw", "view_draw")
    calls.time(clock, "_tick", "timer")
    renderer, sync = w.part("viewport.renderer").ViewportRenderer, w.part("sync.scene")
    for name in ("_restart_if_stale", "_take", "_tell_status", "wait_for_picture", "draw"):
        calls.part(renderer, name)
    for name in ("sync_environment", "follow_environment", "wait_for_sampler", "_apply"):
        calls.part(sync.SceneSync, name)
    calls.part(w.part("sync.objects").ObjectSync, "sync")
    calls.part(sync, "read_world")
    w.shade("RENDERED")
    return scene, ob, mapping, calls


_numbers = itertools.count(1)


def number_of(picture) -> int:
    """Tells pictures apart. Whoever kept them instead would keep their memory from being used again."""
    return vars(picture).setdefault("number", next(_numbers)) if picture is not None else 0


def drawn_pictures(renderer):
    """[((seconds on the clock, of processor time), sampler's settings, number of the picture)] of what was
    drawn from now on."""
    drawn = []
    original = renderer.draw

    def draw(**options):
        original(**options)
        if renderer.picture is not None:
            now = time.perf_counter(), time.process_time()
            drawn.append((now, renderer.sync.built.settings, number_of(renderer.picture)))

    renderer.draw = draw
    return drawn


def scenario_large_scene(w):
    """Orbit, move, rotate the world, change sampler and block count: how long calls and pictures take."""
    scene, ob, mapping, calls = set_up(w)
    try:
        yield from w.until(lambda: w.renderers() and w.renderers()[0].picture, what="a picture")
        yield from w.until_still()
        renderer = w.renderers()[0]
        drawn = drawn_pictures(renderer)
        calls.tell(w, "first sync: ")
        calls.forget()
        builds = w.part("environments").environments
        meshes = renderer.sync.counts["meshes"]
        yield from w.drag("MIDDLEMOUSE", (0.5, 0.5), (0.62, 0.56), steps=6)
        for step in range(4):
            ob.location.x = 0.1 * step
            yield 0.15
            mapping.inputs["Rotation"].default_value[2] = 0.1 * step
            yield 0.15
        yield from w.until_still()
        calls.tell(w, "")
        calls.forget()
        assert renderer.sync.counts["meshes"] == meshes, "a mesh was sent again"

        settings = scene.skytree
        changes = [("block_count", n) for n in (300, 500, 2000, 4000, 1024)]
        changes += [("auto_blocks", True), ("auto_blocks", False)]
        changes += [
            ("sampler", s)
            for s in ("INVERSION", "ALIAS", "HIERARCHY", "UNIFORM", "KDTREE", "INVERSION", "KDTREE")
        ]
        # Blocks of one density, the last of them as in the paper.
        changes += [
            ("block_probability", "EXACT"),
            ("split_criterion", "SSE"),
            ("block_probability", "FITTED"),
        ]
        changes += [("block_count", n) for n in (300, 2000, 1024)]
        changes += [("split_criterion", c) for c in ("VARIANCE", "RANGE", "MIN_VARIANCE")]
        for step, (name, value) in enumerate(changes):
            before, built = number_of(renderer.picture), builds.builds
            drawn.clear()
            setattr(settings, name, value)
            asked, used = time.perf_counter(), time.process_time()
            wanted = w.part("environments").SamplerSettings.of(settings)
            yield from w.until(
                lambda wanted=wanted, before=before: any(s == wanted and p != before for _, s, p in drawn),
                what=f"a picture with {name} {value}",
            )
            shown = next(t for t, s, p in drawn if s == wanted and p != before)
            kind = "built" if builds.builds > built else "kept"
            w.figure(
                f"{step}. {name} {value} ({kind}): new picture drawn after ms", 1000 * (shown[0] - asked)
            )
            # Of all of Blender's threads, its own drawing included: what an idle machine would need at most.
            w.figure(
                f"{step}. {name} {value} ({kind}): processor time until then, ms", 1000 * (shown[1] - used)
            )
            if kind == "built":
                seconds = renderer.sync.built.build_seconds
                w.figure(f"{step}. {name} {value} (built): the build alone, ms on the clock", 1000 * seconds)
            yield from w.until_still()
        calls.tell(w, "changing samplers: ")
        w.shot("large_scene")
        assert renderer.problem == ""
    finally:
        calls.restore()


def is_complete(view) -> bool:
    """Both sides have their samples; figures of the samplers of so large a map take their time."""
    return view._divisor == 0 and not view._stale and all(side.finished for side in view.sides.values())


def scenario_large_comparison(w):
    """The same with two samplers side by side."""
    scene, ob, mapping, calls = set_up(w)
    compared = scene.skytree_compare
    compared.a.method, compared.b.method, compared.samples = "KDTREE", "INVERSION", 2
    compared.mode = "SPLIT"
    region, drawing = w.part("compare.region"), w.part("compare.draw")
    draw_pictures, drawn = drawing.draw_pictures, []

    def draw(view, *arguments):
        draw_pictures(view, *arguments)
        drawn.append((time.perf_counter(), time.process_time(), number_of(view.sides["a"].picture)))

    drawing.draw_pictures = draw
    try:
        yield from w.until(lambda: region.view_in(w.region) is not None, what="a comparison")
        view = region.view_in(w.region)
        yield from w.until(lambda: is_complete(view), 150.0, what="both sides")
        yield 0.3
        calls.forget()
        yield from w.drag("MIDDLEMOUSE", (0.4, 0.5), (0.52, 0.56), steps=6)
        yield from w.drag("LEFTMOUSE", (0.5, 0.4), (0.3, 0.4), steps=6)
        for name, value in (
            ("block_count", 300),
            ("block_count", 1024),
            ("method", "ALIAS"),
            ("method", "KDTREE"),
        ):
            asked, used = time.perf_counter(), time.process_time()
            before = number_of(view.sides["a"].picture)
            drawn.clear()
            setattr(compared.a, name, value)
            yield from w.until(
                lambda before=before: any(p != before for *_, p in drawn),
                what=f"a picture with {name} {value}",
            )
            shown = next(entry for entry in drawn if entry[2] != before)
            w.figure(f"A's {name} {value}: new picture drawn after ms", 1000 * (shown[0] - asked))
            w.figure(f"A's {name} {value}: processor time until then, ms", 1000 * (shown[1] - used))
            yield from w.until(lambda: is_complete(view), 150.0, what="both sides")
            yield 0.1
        calls.tell(w, "comparison: ")
        w.shot("large_comparison")
    finally:
        drawing.draw_pictures = draw_pictures
        calls.restore()
