# SPDX-License-Identifier: GPL-3.0-or-later
"""Lat-long maps in numpy: directions of texel centres and bilinear look-up, for maps that have to be
resampled.

Conventions: docs/architecture.md (u = 0.5 - atan2(y, x) / 2 pi, row 0 at +Z), as Cycles has them.
"""

from __future__ import annotations

import numpy as np

ROWS_PER_CHUNK = 64


def texel_directions(height: int, width: int, rows: slice = slice(None)) -> np.ndarray:
    """(rows, width, 3) unit directions of texel centres."""
    theta = (np.arange(height)[rows] + 0.5) * (np.pi / height)
    phi = (0.5 - (np.arange(width) + 0.5) / width) * (2.0 * np.pi)
    sin_theta = np.sin(theta)[:, None]
    z = np.broadcast_to(np.cos(theta)[:, None], (theta.size, width))
    return np.stack((sin_theta * np.cos(phi), sin_theta * np.sin(phi), z), axis=-1)


def equirectangular_uv(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    u = 0.5 - np.arctan2(directions[..., 1], directions[..., 0]) / (2.0 * np.pi)
    return u, np.arccos(np.clip(directions[..., 2], -1.0, 1.0)) / np.pi


def mirror_ball_uv(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Cycles' direction_to_mirrorball: the ball is seen along +Y; v is measured from the image's top here.
    x, y, z = (directions[..., i] for i in range(3))
    divisor = 2.0 * np.sqrt(np.maximum(0.5 * (1.0 - y), 0.0))
    safe = np.where(divisor > 0.0, divisor, 1.0)
    return 0.5 * (x / safe + 1.0), 0.5 * (1.0 - z / safe)


def lookup(image: np.ndarray, u: np.ndarray, v: np.ndarray, wrap_u: bool = True) -> np.ndarray:
    """Bilinear look-up of (H, W, C) at u, v in [0, 1]; v is clamped, u wraps around or is clamped."""
    height, width = image.shape[:2]
    x, y = u * width - 0.5, np.clip(v * height - 0.5, 0.0, height - 1.0)
    x0 = np.floor(x).astype(np.int64)
    y0 = np.floor(y).astype(np.int64)
    fx, fy = (x - x0)[..., None].astype(np.float32), (y - y0)[..., None].astype(np.float32)
    x1, y1 = x0 + 1, np.minimum(y0 + 1, height - 1)
    if wrap_u:
        x0, x1 = x0 % width, x1 % width
    else:
        x0, x1 = np.clip(x0, 0, width - 1), np.clip(x1, 0, width - 1)
    top = image[y0, x0] * (1 - fx) + image[y0, x1] * fx
    bottom = image[y1, x0] * (1 - fx) + image[y1, x1] * fx
    return top * (1 - fy) + bottom * fy


def resample(
    image: np.ndarray,
    height: int,
    width: int,
    matrix: np.ndarray,
    offset: np.ndarray,
    mirror_ball: bool = False,
) -> np.ndarray:
    """Lat-long map whose texel in direction d is the image's value in direction normalize(matrix d +
    offset)."""
    result = np.empty((height, width, image.shape[2]), np.float32)
    to_uv = mirror_ball_uv if mirror_ball else equirectangular_uv
    for start in range(0, height, ROWS_PER_CHUNK):
        rows = slice(start, min(start + ROWS_PER_CHUNK, height))
        mapped = texel_directions(height, width, rows) @ matrix.T + offset
        norm = np.linalg.norm(mapped, axis=-1, keepdims=True)
        mapped = mapped / np.where(norm > 0.0, norm, 1.0)
        result[rows] = lookup(image, *to_uv(mapped), wrap_u=not mirror_ball)
    return result
