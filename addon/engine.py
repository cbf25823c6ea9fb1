# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine SKYTREE: final renders, with a window or in background."""

from __future__ import annotations

import time
import traceback

import bpy
import numpy as np

from . import devices, native, status
from .camera import CameraError, Film, camera_matrices, film_of
from .devices import render_device, render_threads
from .environments import candidates_of
from .messages import Messages
from .sync.scene import SceneSync
from .thumbnails import render_thumbnail
from .viewport.hooks import ViewportHooks

POLL_SECONDS = 0.05
FIRST_UPDATE_SECONDS = 0.25
# A picture that grows need not be shown more often than every tenth of the time it took so far.
UPDATE_SHARE = 0.1


class SkytreeRenderEngine(ViewportHooks, bpy.types.RenderEngine):
    bl_idname = "SKYTREE"
    bl_label = "Skytree"
    bl_use_shading_nodes_custom = False
    bl_use_eevee_viewport = True
    bl_use_preview = True

    def render(self, depsgraph):
        """Called by Blender once for every view layer; whatever fails becomes a message."""
        self._has_result = False
        try:
            self._render(depsgraph)
        except CameraError as error:
            self._fail(str(error))
        except native.CoreUnavailableError as error:
            self._fail(str(error))
        except (ValueError, RuntimeError, MemoryError) as error:
            self._fail(f"Skytree could not render: {error or type(error).__name__}")
        except Exception as error:  # A bug of ours must not look like a crash of Blender.
            traceback.print_exc()
            self._fail(
                f"Skytree could not render because of a bug: {type(error).__name__}: {error}. "
                "The console has the details"
            )
        if not self._has_result:
            # Blender crashes when it is to save a picture that no engine has written.
            film = film_of(depsgraph.scene_eval.render)
            width, height = film.region_size
            self.write(np.zeros((height, width, 4), np.float32), film, depsgraph.view_layer.name)

    def _fail(self, text: str):
        if not self.is_preview:
            status.last.messages.error(text)
        self.error_set(text)

    def _render(self, depsgraph):
        if self.is_preview:
            render_thumbnail(self, depsgraph)
            return
        scene = depsgraph.scene_eval
        settings = scene.skytree
        status.last.messages.clear()
        film = film_of(scene.render)

        started = time.perf_counter()
        self.update_stats("", "Skytree: reading the scene")
        camera = camera_matrices(scene.camera, self, depsgraph, film)
        sync = SceneSync(flat=True)
        sync.sync(depsgraph)
        sync.set_camera(*camera)
        status.last.update(sync)
        self._report(sync.messages)
        if self._is_cancelled():
            return
        sync_seconds = time.perf_counter() - started

        session = native.core().RenderSession(render_threads(scene.render), render_device(settings))
        session.start(
            sync.scene,
            film.width,
            film.height,
            settings.samples,
            max_bounces=settings.max_bounces,
            seed=settings.seed,
            pixel_filter=settings.pixel_filter,
            filter_width=settings.filter_width,
            region=film.region,
            film_transparent=scene.render.film_transparent,
            blue_noise=settings.blue_noise,
            point_set=settings.point_set,
            candidates=candidates_of(settings),
            light_rays=settings.light_rays,
            control_variate=settings.control_variate,
            product_sampling=settings.product_sampling,
            learn_visibility=settings.learn_visibility,
            adaptive_sampling=settings.adaptive_sampling,
        )
        try:
            self._follow(session, film, settings.samples, depsgraph.view_layer.name)
        finally:
            session.cancel()
        if session.error:
            raise RuntimeError(session.error)
        if session.warning:
            status.last.messages.warn(session.warning)
            self.report({"WARNING"}, session.warning)
        bpy.app.driver_namespace["peer_stats"] = {"render_s": session.render_seconds, "sync_s": sync_seconds}

    def _follow(self, session, film: Film, samples: int, layer: str):
        """Shows progress until the session has finished or the user presses Esc."""
        started = last_update = time.perf_counter()
        interval = FIRST_UPDATE_SECONDS
        while not session.wait(POLL_SECONDS):
            if self._is_cancelled():
                session.cancel()
                break
            now = time.perf_counter()
            done = session.samples_done
            self._tell_progress(done, samples)
            if not bpy.app.background and done and now - last_update > interval:
                self.write(session.pixels(), film, layer)
                last_update = time.perf_counter()
                interval = max(FIRST_UPDATE_SECONDS, UPDATE_SHARE * (last_update - started))
        if session.error is None and session.samples_done:
            self.write(session.pixels(), film, layer)
            self._tell_progress(session.samples_done, samples)

    def _is_cancelled(self) -> bool:
        return self.test_break()

    def _tell_progress(self, done: int, samples: int):
        self.update_progress(done / samples)
        self.update_stats("", f"Skytree: sample {done}/{samples}")

    def write(self, pixels: np.ndarray, film: Film, layer: str):
        width, height = film.region_size
        result = self.begin_result(0, 0, width, height, layer=layer)
        set_pass(result.layers[0].passes["Combined"], pixels)
        self.end_result(result)
        self._has_result = True

    def _report(self, messages: Messages):
        for severity, text in messages:
            if severity != "INFO":
                self.report({severity}, text)


def set_pass(render_pass, pixels: np.ndarray):
    """`pixels`: float32 (height, width, 4), bottom row first."""
    flat = np.ascontiguousarray(pixels, np.float32)
    try:
        render_pass.rect.foreach_set(flat.reshape(-1))
    except TypeError:
        # Blender 3.4 wants pixels as the outer dimension.
        render_pass.rect.foreach_set(flat.reshape(-1, 4))


def register():
    devices.register()
    bpy.utils.register_class(SkytreeRenderEngine)


def unregister():
    bpy.utils.unregister_class(SkytreeRenderEngine)
    devices.unregister()
