# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing into numpy images: points, lines, rectangles and numerals, for pictures that Blender shows as
icons, where it offers no vector drawing. Images are (H,W,3) float in display space, row 0 at the top,
changed in place."""

from __future__ import annotations

import numpy as np

GLYPH_WIDTH, GLYPH_HEIGHT = 3, 5
GLYPHS = {  # five rows of three bits
    "0": (7, 5, 5, 5, 7), "1": (2, 6, 2, 2, 7), "2": (7, 1, 7, 4, 7), "3": (7, 1, 7, 1, 7),
    "4": (5, 5, 7, 1, 1), "5": (7, 4, 7, 1, 7), "6": (7, 4, 7, 5, 7), "7": (7, 1, 1, 2, 2),
    "8": (7, 5, 7, 5, 7), "9": (7, 5, 7, 1, 7), "-": (0, 0, 7, 0, 0), "+": (0, 2, 7, 2, 0),
    ".": (0, 0, 0, 0, 2), "e": (0, 7, 7, 4, 7),
}  # fmt: skip


def points(image: np.ndarray, x: np.ndarray, y: np.ndarray, color, size: int = 1) -> None:
    """Squares of `size` pixels at pixel coordinates; what lies outside is left out."""
    height, width = image.shape[:2]
    columns, rows = (np.floor(np.asarray(c, np.float64)).astype(np.int64) for c in (x, y))
    for dy in range(size):
        for dx in range(size):
            column, row = columns + dx - size // 2, rows + dy - size // 2
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            image[row[inside], column[inside]] = color


def curve(image: np.ndarray, x: np.ndarray, y: np.ndarray, color, size: int = 1) -> None:
    """A polyline through pixel coordinates."""
    x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
    steps = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(y)))
    # One dot a pixel; the cumulative length parametrises all segments at once.
    at = np.concatenate(([0.0], np.cumsum(np.maximum(steps, 1e-9))))
    t = np.linspace(0.0, at[-1], int(np.ceil(at[-1])) + 1)
    points(image, np.interp(t, at, x), np.interp(t, at, y), color, size)


def rectangle_borders(mask: np.ndarray, boxes: np.ndarray) -> None:
    """Sets to 1 the borders of boxes (n,4) = x0, y0, x1, y1 in pixels of a mask (H,W)."""
    height, width = mask.shape
    x0, y0, x1, y1 = np.round(boxes).astype(np.int64).T
    # Blocks of cells reach half a texel over the right edge, where the map wraps.
    x0, x1 = np.minimum(x0, width - 1), np.minimum(x1, width - 1)
    y0, y1 = np.minimum(y0, height - 1), np.minimum(y1, height - 1)
    for left, top, right, bottom in zip(x0, y0, x1, y1, strict=True):
        mask[top : bottom + 1, [left, right]] = 1.0
        mask[[top, bottom], left : right + 1] = 1.0


def text(image: np.ndarray, x: int, y: int, string: str, color, scale: int = 2) -> None:
    """Numerals with their upper left corner at (x, y); a character that has no glyph leaves a gap."""
    for index, character in enumerate(string):
        rows = GLYPHS.get(character, (0,) * GLYPH_HEIGHT)
        bits = np.array([[(row >> shift) & 1 for shift in (2, 1, 0)] for row in rows])
        bits = np.kron(bits, np.ones((scale, scale), int)).astype(bool)
        down, right = np.nonzero(bits)
        points(image, right + x + index * (GLYPH_WIDTH + 1) * scale, down + y, color)


def text_width(string: str, scale: int = 2) -> int:
    return len(string) * (GLYPH_WIDTH + 1) * scale


def resize(image: np.ndarray, height: int, width: int) -> np.ndarray:
    """Area average when it shrinks, nearest texel when it grows; (H,W,C) -> (height,width,C) float32."""
    image = _average(image.astype(np.float32), height, axis=0)
    return _average(image, width, axis=1)


def _average(image: np.ndarray, count: int, axis: int) -> np.ndarray:
    length = image.shape[axis]
    if count >= length:
        return np.take(image, np.arange(count) * length // count, axis=axis)
    starts = np.arange(count) * length // count
    sums = np.add.reduceat(image, starts, axis=axis)
    sizes = np.diff(np.append(starts, length)).astype(np.float32)
    return sums / sizes.reshape([-1 if i == axis else 1 for i in range(image.ndim)])
