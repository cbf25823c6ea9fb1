# SPDX-License-Identifier: GPL-3.0-or-later
"""The shapes around the teapot, without Blender: a sphere and the profile of the round table."""

from __future__ import annotations

import numpy as np
import teapot

TABLE_PROFILE = [
    (0.0, -0.35), (1.5, -0.35), (3.0, -0.35), (4.55, -0.35), (4.68, -0.35), (4.75, -0.28),
    (4.75, -0.175), (4.75, -0.07), (4.68, 0.0), (4.55, 0.0), (3.0, 0.0), (1.5, 0.0), (0.0, 0.0),
]  # fmt: skip


def table() -> teapot.Mesh:
    """The round table; its top is z = 0."""
    return teapot.tessellate(teapot.lathe_patches(TABLE_PROFILE), 16)


def sphere(segments: int) -> teapot.Mesh:
    """Unit sphere of 2 segments x segments quadrilaterals (triangles at the poles), about the origin."""
    theta, phi = np.linspace(0, np.pi, segments + 1), np.arange(2 * segments) * np.pi / segments
    ring = np.sin(theta[1:-1, None, None]) * np.stack([np.cos(phi), np.sin(phi), 0 * phi], -1)
    ring[..., 2] = np.cos(theta[1:-1, None])
    vertices = np.concatenate([[(0, 0, 1)], ring.reshape(-1, 3), [(0, 0, -1)]])
    column = np.arange(2 * segments)
    beside, rows = (column + 1) % (2 * segments), np.arange(segments - 2)[:, None] * 2 * segments + 1
    upper, upper_beside = rows + column, rows + beside
    lower, lower_beside = upper + 2 * segments, upper_beside + 2 * segments
    last = len(vertices) - 1
    triangles = [
        np.stack([0 * column, 1 + column, 1 + beside], -1),
        np.stack([upper, lower, lower_beside], -1).reshape(-1, 3),
        np.stack([upper, lower_beside, upper_beside], -1).reshape(-1, 3),
        np.stack([0 * column + last, last - 2 * segments + beside, last - 2 * segments + column], -1),
    ]
    return teapot.Mesh(vertices, vertices, np.concatenate(triangles).astype(np.int32))
