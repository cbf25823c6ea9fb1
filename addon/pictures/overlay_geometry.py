# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks and sample directions as triangles and lines on the unit sphere, in world space; numpy alone.

Conventions: docs/architecture.md (u = 0.5 - atan2(y, x) / 2 pi, v = 0 at +Z). Colours are (n, 4) float32.
"""

from __future__ import annotations

import numpy as np

from .plots import colormap

# Longest edge of a patch; edges of blocks are circles of latitude and longitude, not straight lines.
PATCH_RADIANS = np.pi / 48
MAX_SUBDIVISION = 64


def directions(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(..., 3) unit directions of map coordinates in [0,1]."""
    phi, theta = np.broadcast_arrays((0.5 - u) * (2.0 * np.pi), v * np.pi)
    sin_theta = np.sin(theta)
    return np.stack((sin_theta * np.cos(phi), sin_theta * np.sin(phi), np.cos(theta)), axis=-1)


def block_solid_angles(bounds: np.ndarray, width: int, height: int) -> np.ndarray:
    """(n,) steradians of blocks, bounds (n,4) = x0, y0, x1, y1 in texels."""
    x0, y0, x1, y1 = bounds.astype(np.float64).T
    return (x1 - x0) * (2.0 * np.pi / width) * (np.cos(np.pi * y0 / height) - np.cos(np.pi * y1 / height))


def density_colors(probabilities: np.ndarray, solid_angles: np.ndarray, alpha: float) -> np.ndarray:
    """(n,4): probability per steradian on a logarithmic scale from the rarest block to the likeliest."""
    density = np.log2(np.maximum(probabilities / solid_angles, 1e-20))
    low, high = np.percentile(density, [1, 99])
    colors = np.full((len(density), 4), alpha, np.float32)
    colors[:, :3] = colormap((density - low) / max(high - low, 1e-6))
    return colors


def blocks(bounds: np.ndarray, width: int, height: int, colors: np.ndarray):
    """(triangle corners (3t,3), their colours (3t,4), line ends (2l,3)) of all blocks."""
    x0, y0, x1, y1 = bounds.astype(np.float64).T
    u0, u1, v0, v1 = x0 / width, x1 / width, y0 / height, y1 / height
    across = _subdivision((u1 - u0) * 2.0 * np.pi)
    down = _subdivision((v1 - v0) * np.pi)
    triangles, shades, lines = [], [], []
    for nu, nv in sorted(set(zip(across.tolist(), down.tolist(), strict=True))):
        chosen = (across == nu) & (down == nv)
        u = u0[chosen, None] + (u1 - u0)[chosen, None] * np.linspace(0.0, 1.0, nu + 1)
        v = v0[chosen, None] + (v1 - v0)[chosen, None] * np.linspace(0.0, 1.0, nv + 1)
        grid = directions(u[:, None, :], v[:, :, None]).astype(np.float32)
        a, b = grid[:, :-1, :-1], grid[:, :-1, 1:]
        c, d = grid[:, 1:, :-1], grid[:, 1:, 1:]
        triangles.append(np.stack((a, c, b, b, c, d), axis=3).reshape(-1, 3))
        shades.append(np.repeat(colors[chosen], 6 * nu * nv, axis=0))
        for edge in (grid[:, 0], grid[:, -1], grid[:, :, 0], grid[:, :, -1]):
            lines.append(np.stack((edge[:, :-1], edge[:, 1:]), axis=2).reshape(-1, 3))
    return np.concatenate(triangles), np.concatenate(shades), np.concatenate(lines)


def _subdivision(angles: np.ndarray) -> np.ndarray:
    """Powers of two, so that blocks of like size are computed together."""
    wanted = np.clip(np.ceil(angles / PATCH_RADIANS), 1, MAX_SUBDIVISION)
    return (2 ** np.ceil(np.log2(wanted))).astype(np.int64)


def dots(samples: np.ndarray, radius: float) -> np.ndarray:
    """(6n,3) corners of squares of this angular radius about unit directions (n,3)."""
    helper = np.where(np.abs(samples[:, 2:3]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    side = np.cross(samples, helper)
    side *= radius / np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(samples, side)
    a, b, c, d = samples - side - up, samples + side - up, samples - side + up, samples + side + up
    return np.stack((a, b, c, c, b, d), axis=1).reshape(-1, 3).astype(np.float32)


def low_discrepancy(count: int) -> np.ndarray:
    """(count,3) in [0,1): the R3 sequence (M. Roberts, "The Unreasonable Effectiveness of Quasirandom
    Sequences", 2018)."""
    root = 1.2207440846057596  # of x^4 = x + 1
    steps = np.array([1.0 / root, 1.0 / root**2, 1.0 / root**3])
    return ((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0).astype(np.float32)
