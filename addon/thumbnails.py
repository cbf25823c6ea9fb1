# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews of materials and worlds: Blender's small scenes, lit as a studio would be.

Blender lights its material previews by lamps, which Skytree does not have: soft boxes in a made-up map take
their place. A world's preview shows the world itself.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from . import native
from .camera import camera_matrices, film_of
from .sync.mesh import GEOMETRY_TYPES
from .sync.scene import SceneSync

SAMPLES = 32
POLL_SECONDS = 0.02
MAP_HEIGHT, MAP_WIDTH = 64, 128
# Azimuth, elevation, half width and half height in degrees, radiance; the camera looks along +Y.
SOFT_BOXES = (
    (-130.0, 45.0, 24.0, 20.0, 9.0),
    (-25.0, 30.0, 16.0, 26.0, 4.0),
    (90.0, 60.0, 40.0, 10.0, 2.0),
)


@lru_cache(maxsize=1)
def studio_map() -> np.ndarray:
    """(MAP_HEIGHT, MAP_WIDTH, 3) radiance of the studio."""
    elevation = 90.0 - (np.arange(MAP_HEIGHT)[:, None] + 0.5) * (180.0 / MAP_HEIGHT)
    azimuth = 180.0 - (np.arange(MAP_WIDTH)[None, :] + 0.5) * (360.0 / MAP_WIDTH)
    radiance = 0.25 + 0.15 * np.sin(np.radians(elevation)) + 0.0 * azimuth
    for center, height, half_width, half_height, strength in SOFT_BOXES:
        across = np.abs((azimuth - center + 180.0) % 360.0 - 180.0) / half_width
        up = np.abs(elevation - height) / half_height
        # Soft edges: no staircase in the reflections.
        radiance += strength / (1.0 + np.maximum(across, up) ** 12)
    return np.repeat(radiance[..., None], 3, axis=2).astype(np.float32)


@lru_cache(maxsize=1)
def _studio_sampler():
    return native.core().KdTreeSampler(studio_map(), 256, "MIN_VARIANCE", "MIN_VARIANCE")


def shows_object(depsgraph) -> bool:
    """Whether this is the preview of a material, not of a world."""
    return any(item.object.type in GEOMETRY_TYPES for item in depsgraph.object_instances)


def render_thumbnail(engine, depsgraph):
    """Renders for an engine whose is_preview is set; raises what a render raises."""
    scene = depsgraph.scene_eval
    film = film_of(scene.render)
    sync = SceneSync()
    sync.sync(depsgraph)
    sync.set_camera(*camera_matrices(scene.camera, engine, depsgraph, film))
    if shows_object(depsgraph):
        sync.scene.set_environment(studio_map(), _studio_sampler())
    session = native.core().RenderSession(1)  # it competes with the viewport
    transparent = scene.render.film_transparent
    session.start(
        sync.scene, film.width, film.height, SAMPLES, region=film.region, film_transparent=transparent
    )
    try:
        while not session.wait(POLL_SECONDS):
            if engine.test_break():
                return
    finally:
        session.cancel()
    if session.error:
        raise RuntimeError(session.error)
    engine.write(session.pixels(), film, depsgraph.view_layer.name)
