# SPDX-License-Identifier: GPL-3.0-or-later
"""What a region of a 3D view shows, as plain values: camera, projection, size and render border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d


@dataclass(frozen=True)
class View:
    """Equal views give equal pictures of equal scenes."""

    camera_to_world: tuple[float, ...]  # 4 x 4, row by row
    projection: tuple[float, ...]  # 4 x 4, OpenGL's
    width: int
    height: int
    border: tuple[int, int, int, int] | None = None  # x0, y0, x1, y1 in pixels from the lower left; None: all

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        to_matrix = [np.array(m, np.float32).reshape(4, 4) for m in (self.camera_to_world, self.projection)]
        return to_matrix[0], to_matrix[1]

    @property
    def rectangle(self) -> tuple[int, int, int, int]:
        """x, y, width, height of the pixels that are rendered, in the region."""
        x0, y0, x1, y1 = self.border or (0, 0, self.width, self.height)
        return x0, y0, x1 - x0, y1 - y0

    def scaled(self, divisor: int) -> tuple[int, int, tuple[int, int, int, int] | None]:
        """(width, height, border) of the film at 1/divisor of the resolution."""
        width, height = max(self.width // divisor, 1), max(self.height // divisor, 1)
        if self.border is None:
            return width, height, None
        sx, sy = width / self.width, height / self.height
        x0, y0, x1, y1 = self.border
        left, low = min(round(x0 * sx), width - 1), min(round(y0 * sy), height - 1)
        right, up = min(round(x1 * sx), width), min(round(y1 * sy), height)
        return width, height, (left, low, max(right, left + 1), max(up, low + 1))


def view_of(region, region_data, space, scene) -> View | None:
    """The View of a region of a 3D view; None if nothing of it can be rendered."""
    # Orbit, pan, zoom, lens, camera zoom and offset: Blender has put all of them into these two matrices.
    to_world = region_data.view_matrix.inverted_safe()
    projection = region_data.window_matrix
    border = _border(region, region_data, space, scene)
    if border is not None:
        border = _whole_pixels(border, region.width, region.height)
        if border is None:
            return None
    return View(_flat(to_world), _flat(projection), region.width, region.height, border)


def visibility_of(space) -> tuple:
    """What a 3D view itself hides, to be compared: local view, local collections, types of objects."""
    if space is None:
        return ()
    types = (space.show_object_viewport_mesh, space.show_object_viewport_curve,
             space.show_object_viewport_surf, space.show_object_viewport_meta,
             space.show_object_viewport_font)  # fmt: skip
    return space.local_view is not None, space.use_local_collections, types


def _flat(matrix) -> tuple[float, ...]:
    return tuple(value for row in matrix for value in row)


def _border(region, region_data, space, scene):
    """Left, bottom, right, top of the render border in pixels, not cut to the region; None without one."""
    render = scene.render
    if region_data.view_perspective != "CAMERA":
        if not space.use_render_border:
            return None
        return (
            space.render_border_min_x * region.width,
            space.render_border_min_y * region.height,
            space.render_border_max_x * region.width,
            space.render_border_max_y * region.height,
        )
    if not render.use_border:
        return None
    frame = camera_frame(region, region_data, space, scene)
    if frame is None:
        return None
    left, low, right, up = frame
    return (
        left + render.border_min_x * (right - left),
        low + render.border_min_y * (up - low),
        left + render.border_max_x * (right - left),
        low + render.border_max_y * (up - low),
    )


def camera_frame(region, region_data, space, scene):
    """Left, bottom, right, top of the camera's frame in pixels of the region, in camera view."""
    camera = space.camera if space.use_local_camera else scene.camera
    if camera is None or camera.type != "CAMERA":
        return None
    to_world = camera.matrix_world.normalized()
    corners = [
        location_3d_to_region_2d(region, region_data, to_world @ corner)
        for corner in camera.data.view_frame(scene=scene)
    ]
    if any(corner is None for corner in corners):
        return None
    xs, ys = [c.x for c in corners], [c.y for c in corners]
    return min(xs), min(ys), max(xs), max(ys)


def _whole_pixels(border, width: int, height: int):
    left, low, right, up = border
    x0, y0 = max(round(left), 0), max(round(low), 0)
    x1, y1 = min(round(right), width), min(round(up), height)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def free_rectangle(area, region) -> tuple[int, int, int, int]:
    """x, y, width, height of the part of a region that no header, toolbar or sidebar covers."""
    left, low, right, up = 0, 0, region.width, region.height
    for other in area.regions:
        if (
            other.type not in {"HEADER", "TOOL_HEADER", "ASSET_SHELF", "TOOLS", "UI"}
            or min(other.width, other.height) <= 1
        ):
            continue
        x, y = other.x - region.x, other.y - region.y
        overlaps = x < region.width and y < region.height and x + other.width > 0 and y + other.height > 0
        if not overlaps:
            continue
        if other.type in {"TOOLS", "UI"}:
            if x + other.width / 2 < region.width / 2:
                left = max(left, x + other.width)
            else:
                right = min(right, x)
        elif y + other.height / 2 < region.height / 2:
            low = max(low, y + other.height)
        else:
            up = min(up, y)
    return left, low, max(right - left, 1), max(up - low, 1)
