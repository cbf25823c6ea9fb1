# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera and the film of a final render, from Blender's own projection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


class CameraError(ValueError):
    """There is no picture without a usable camera; the text says why and what to do."""


@dataclass
class Film:
    """The film and the part of it that is rendered, in pixels from the lower left corner."""

    width: int
    height: int
    region: tuple[int, int, int, int]  # x0, y0, x1, y1

    @property
    def region_size(self) -> tuple[int, int]:
        x0, y0, x1, y1 = self.region
        return x1 - x0, y1 - y0


def film_of(render) -> Film:
    """`render` are the scene's RenderSettings; the border is cut to whole pixels as Blender does."""
    scale = render.resolution_percentage / 100.0
    width = max(int(render.resolution_x * scale), 1)
    height = max(int(render.resolution_y * scale), 1)
    if not render.use_border:
        return Film(width, height, (0, 0, width, height))
    x0, x1 = (int(min(max(f, 0.0), 1.0) * width) for f in (render.border_min_x, render.border_max_x))
    y0, y1 = (int(min(max(f, 0.0), 1.0) * height) for f in (render.border_min_y, render.border_max_y))
    return Film(width, height, (x0, y0, max(x1, x0 + 1), max(y1, y0 + 1)))


def camera_matrices(camera, engine, depsgraph, film: Film) -> tuple[np.ndarray, np.ndarray]:
    """(camera_to_world, projection) of an evaluated camera object; raises CameraError."""
    if camera is None:
        raise CameraError("The scene has no camera: add one (Add > Camera) or make one active")
    if camera.type != "CAMERA":
        raise CameraError(f'The scene\'s camera "{camera.name}" is no camera but a {camera.type.lower()}')
    if camera.data.type not in {"PERSP", "ORTHO"}:
        raise CameraError(
            f'Camera "{camera.name}": the type {camera.data.type.title()} is not supported; '
            "set it to Perspective or Orthographic"
        )
    render = depsgraph.scene_eval.render
    projection = camera.calc_matrix_camera(
        depsgraph, x=film.width, y=film.height, scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y
    )
    # A camera's scale has no meaning: Blender takes its position and orientation alone.
    to_world = np.array(engine.camera_model_matrix(camera) if engine else camera.matrix_world, np.float64)
    columns = np.linalg.norm(to_world[:3, :3], axis=0)
    if not (np.isfinite(to_world).all() and (columns > 0.0).all()):
        raise CameraError(
            f'Camera "{camera.name}": its transform is not invertible; apply or reset its scale'
        )
    to_world[:3, :3] /= columns
    return to_world, np.array(projection)
