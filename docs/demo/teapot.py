# SPDX-License-Identifier: GPL-3.0-or-later
"""The Utah teapot as a triangle mesh with exact normals.

Source: Martin Newell's bicubic Bezier teapot (University of Utah, 1975; see F. Crow, "The origins of the
teapot", IEEE CG&A 7(1), 1987), with the bottom that was added later. Its 306 control points are not listed
here: 24 of the 32 patches are quarter turns of one profile curve and the other 8 are half tubes, symmetric
about y = 0, whose rows are rectangles; so the profile and the rectangles say it all. Added by us: the ledge
under the lid, which closes the slit between rim and lid that the original leaves open.

World axes: +Z up, the spout points along +X, the bottom stands on z = 0, height 3.15, as in the original.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Control points of a quarter circle: (1, 0), (1, k), (k, 1), (0, 1). Newell rounded k = 0.5523 up to 0.56.
QUARTER_TURN = np.array([[1.0, 0.0], [1.0, 0.56], [0.56, 1.0], [0.0, 1.0]])

# (radius, z) of consecutive cubic segments that share their end points.
BODY_PROFILE = [
    (0.0, 0.0), (1.425, 0.0), (1.5, 0.075),  # bottom
    (1.5, 0.15), (1.5, 0.225), (2.0, 0.45),  # lower body
    (2.0, 0.9), (2.0, 1.35), (1.75, 1.875),  # upper body
    (1.5, 2.4), (1.4375, 2.53125), (1.3375, 2.53125),  # rim
    (1.4, 2.4),
]  # fmt: skip
LEDGE_PROFILE = [(1.4, 2.4), (1.4 - 0.1 / 3, 2.4), (1.3 + 0.1 / 3, 2.4), (1.3, 2.4)]
LID_PROFILE = [
    (1.3, 2.4), (1.3, 2.55), (0.4, 2.55),  # lid
    (0.2, 2.7), (0.0, 2.85), (0.8, 3.15),  # knob
    (0.0, 3.15),
]  # fmt: skip

# Tube rows (x0, z0, x1, z1, h): control points (x0, 0, z0), (x0, -h, z0), (x1, -h, z1), (x1, 0, z1), mirrored
# in y.
HANDLE_ROWS = [
    (-1.6, 2.025, -1.5, 2.25, 0.3), (-2.3, 2.025, -2.5, 2.25, 0.3), (-2.7, 2.025, -3.0, 2.25, 0.3),
    (-2.7, 1.8, -3.0, 1.8, 0.3), (-2.7, 1.575, -3.0, 1.35, 0.3), (-2.5, 1.125, -2.65, 0.9375, 0.3),
    (-2.0, 0.9, -1.9, 0.6, 0.3),
]  # fmt: skip
SPOUT_ROWS = [
    (1.7, 1.425, 1.7, 0.6, 0.66), (2.6, 1.425, 3.1, 0.825, 0.66), (2.3, 2.1, 2.4, 2.025, 0.25),
    (2.7, 2.4, 3.3, 2.4, 0.25), (2.8, 2.475, 3.525, 2.49375, 0.25), (2.9, 2.475, 3.45, 2.5125, 0.15),
    (2.8, 2.4, 3.2, 2.4, 0.15),
]  # fmt: skip


@dataclass(frozen=True)
class Mesh:
    """Triangles (T,3) int32 over vertices (V,3) float64 with unit outward normals (V,3) float64."""

    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray


def lathe_patches(profile: list[tuple[float, float]]) -> np.ndarray:
    """Control points (P,4,4,3) of the surface of revolution of a piecewise cubic profile, four patches a
    segment."""
    points = np.array(profile)
    patches = []
    for start in range(0, len(points) - 1, 3):
        segment = points[start : start + 4]
        for quarter in range(4):
            cos, sin = (1, 0, -1, 0)[quarter], (0, 1, 0, -1)[quarter]
            turn = QUARTER_TURN @ np.array([[cos, sin], [-sin, cos]])
            xy = segment[:, None, 0, None] * turn[None]
            z = np.broadcast_to(segment[:, None, 1, None], (4, 4, 1))
            patches.append(np.concatenate([xy, z], axis=2))
    return np.array(patches)


def tube_patches(rows: list[tuple[float, float, float, float, float]]) -> np.ndarray:
    """Control points (P,4,4,3) of a tube that is symmetric about y = 0, two patches a segment."""
    half = np.array(
        [[(x0, 0, z0), (x0, -h, z0), (x1, -h, z1), (x1, 0, z1)] for x0, z0, x1, z1, h in rows], float
    )
    mirrored = half[:, ::-1] * (1, -1, 1)
    return np.array([side[s : s + 4] for s in range(0, len(rows) - 1, 3) for side in (half, mirrored)])


def bernstein(t: np.ndarray) -> np.ndarray:
    """Cubic Bernstein polynomials (n,4) at t (n,)."""
    s = 1 - t
    return np.stack([s**3, 3 * s * s * t, 3 * s * t * t, t**3], axis=1)


def bernstein_derivative(t: np.ndarray) -> np.ndarray:
    """Derivatives (n,4) of the cubic Bernstein polynomials at t (n,)."""
    s = 1 - t
    return 3 * np.stack([-s * s, s * s - 2 * s * t, 2 * s * t - t * t, t * t], axis=1)


def evaluate(patch: np.ndarray, v: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals dP/du x dP/dv of one patch (4,4,3) on the grid v x u, each (len(v), len(u), 3).

    Where a row of control points collapses into a pole, dP/du vanishes; the direction of its limit is
    d2P/dudv, taken towards the inside of the patch.
    """
    bu, bv, du, dv = bernstein(u), bernstein(v), bernstein_derivative(u), bernstein_derivative(v)
    points = np.einsum("vi,uj,ijk->vuk", bv, bu, patch)
    along_u = np.einsum("vi,uj,ijk->vuk", bv, du, patch)
    along_v = np.einsum("vi,uj,ijk->vuk", dv, bu, patch)
    twist = np.einsum("vi,uj,ijk->vuk", dv, du, patch)
    inward = np.where(v < 0.5, 1.0, -1.0)[:, None, None]
    at_pole = np.linalg.norm(along_u, axis=2, keepdims=True) < 1e-9
    normals = np.cross(np.where(at_pole, twist * inward, along_u), along_v)
    return points, normals / np.linalg.norm(normals, axis=2, keepdims=True)


def tessellate(patches: np.ndarray, segments: int) -> Mesh:
    """A smooth mesh of patches (P,4,4,3), each cut into segments x segments quadrilaterals.

    Vertices that patches share are one vertex; where their normals differ slightly (across a boundary that is
    only G1 after Newell's rounding) the mean is taken.
    """
    t = np.linspace(0, 1, segments + 1)
    points, normals = (
        np.concatenate(a) for a in zip(*(map(_flat, evaluate(p, t, t)) for p in patches), strict=True)
    )
    corner = np.arange(segments)[:, None] * (segments + 1) + np.arange(segments)
    a, b, c, d = (corner + o for o in (0, 1, segments + 2, segments + 1))
    quads = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    triangles = np.concatenate([quads + i * (segments + 1) ** 2 for i in range(len(patches))])

    # + 0.0 turns -0.0 into 0.0, which would otherwise be a second vertex.
    _, first, shared = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    shared = shared.reshape(-1)
    summed = np.zeros((len(first), 3))
    np.add.at(summed, shared, normals)
    triangles = shared[triangles]
    collapsed = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    return Mesh(
        points[first],
        summed / np.linalg.norm(summed, axis=1, keepdims=True),
        triangles[~collapsed].astype(np.int32),
    )


def _flat(grid: np.ndarray) -> np.ndarray:
    return grid.reshape(-1, 3)


def join(meshes: list[Mesh]) -> Mesh:
    """One mesh of several; vertices are not merged, so that creases between the parts stay sharp."""
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.normals for m in meshes]),
        np.concatenate([m.triangles + o for m, o in zip(meshes, offsets, strict=True)]).astype(np.int32),
    )


def parts(segments: int = 12) -> dict[str, Mesh]:
    """The parts by name, outward oriented.

    Body (with rim and bottom), ledge and lid form one closed surface together; handle and spout are
    tubes whose ends lie inside the body, except for the spout's tip, which is open.
    """
    control = {
        "body": lathe_patches(BODY_PROFILE),
        "ledge": lathe_patches(LEDGE_PROFILE),
        "lid": lathe_patches(LID_PROFILE),
        "handle": tube_patches(HANDLE_ROWS),
        "spout": tube_patches(SPOUT_ROWS),
    }
    return {name: tessellate(patches, segments) for name, patches in control.items()}


def teapot(segments: int = 12) -> Mesh:
    """The whole teapot; 32 patches and the ledge give about 72 segments^2 triangles."""
    return join(list(parts(segments).values()))
