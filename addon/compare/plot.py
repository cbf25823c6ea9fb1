# SPDX-License-Identifier: GPL-3.0-or-later
"""The convergence of both sides in a 3D view: squared error against samples or time, both logarithmic."""

from __future__ import annotations

import math

from ..viewport import gpu_draw
from .sides import Side
from .view import CompareView

COLORS = {"a": (0.95, 0.52, 0.28, 1.0), "b": (0.35, 0.65, 1.0, 1.0)}
WHITE, SOFT, GUIDE = (1.0, 1.0, 1.0, 0.9), (1.0, 1.0, 1.0, 0.18), (1.0, 1.0, 1.0, 0.55)
BOX = (0.05, 0.05, 0.05, 0.78)
TEXT_SIZE = 11.0
AXES = {"SAMPLES": "samples per pixel", "TIME": "seconds"}


def draw_plot(
    view: CompareView, axis: str, left: float, low: float, width: float, height: float, scale: float = 1.0
):
    """The dashed guide has slope -1, as variance falls with independent samples."""
    curves = {name: curve_of(side, axis) for name, side in view.sides.items()}
    points = [point for curve in curves.values() for point in curve]
    if not points:
        return
    x0, x1 = _decades([p[0] for p in points])
    y0, y1 = _decades([p[1] for p in points])
    size = TEXT_SIZE * scale
    inner = (left + 46 * scale, low + 36 * scale, width - 60 * scale, height - 64 * scale)

    def at(x, y):
        return (inner[0] + (x - x0) / (x1 - x0) * inner[2], inner[1] + (y - y0) / (y1 - y0) * inner[3])

    def words(x, y, line, color=WHITE, align=0.0):
        gpu_draw.text(x - align * gpu_draw.text_size(line, size)[0], y, line, size, color, shadow=False)

    gpu_draw.rectangle(left, low, width, height, BOX)
    for decade in _few(x0, x1, inner[2] / (44 * scale)):
        x, y = at(decade, y0)
        gpu_draw.rectangle(x, y, 1, inner[3], SOFT)
        words(x, y - 14 * scale, _power(decade), align=0.5)
    for decade in _few(y0, y1, inner[3] / (18 * scale)):
        x, y = at(x0, decade)
        gpu_draw.rectangle(x, y, inner[2], 1, SOFT)
        words(x - 6 * scale, y - 4 * scale, _power(decade), align=1.0)
    words(inner[0] + inner[2] / 2, low + 7 * scale, AXES[axis], align=0.5)
    top = low + height - 17 * scale
    words(left + 8 * scale, top, "error\u00b2 (nRMSE_tc\u00b2)")
    legend = left + width - 8 * scale
    for line, color in (("slope -1", GUIDE), ("B", COLORS["b"]), ("A", COLORS["a"])):
        if line == "slope -1" or curves[line.lower()]:
            words(legend, top, line, color, align=1.0)
            legend -= gpu_draw.text_size(line, size)[0] + 10 * scale
    start = min(points)
    length = min(x1 - start[0], start[1] - y0)
    gpu_draw.lines(_dashes(at(*start), at(start[0] + length, start[1] - length), 6 * scale), GUIDE, scale)
    for name, curve in curves.items():
        gpu_draw.polyline([at(*point) for point in curve], COLORS[name], 2.0 * scale)
        for x, y in (at(*point) for point in curve):
            gpu_draw.rectangle(x - 2.5 * scale, y - 2.5 * scale, 5 * scale, 5 * scale, COLORS[name])


def curve_of(side: Side, axis: str) -> list[tuple[float, float]]:
    """(log10 of samples or seconds, log10 of the squared error) of a side's measurements."""
    steps = [step for step in side.steps if step.errors["nrmse_tc"] > 0]
    return [
        (
            math.log10(step.samples if axis == "SAMPLES" else max(step.render_seconds, 1e-4)),
            2.0 * math.log10(step.errors["nrmse_tc"]),
        )
        for step in steps
    ]


def _decades(values: list[float]) -> tuple[int, int]:
    low = math.floor(min(values))
    return low, max(math.ceil(max(values)), low + 1)


def _few(first: int, last: int, most: float) -> range:
    """Every decade, or every second, third, ... where they would be too close."""
    return range(first, last + 1, max(math.ceil((last - first) / max(most, 1.0)), 1))


def _power(decade: int) -> str:
    return f"{10.0**decade:g}" if -3 <= decade <= 4 else f"1e{decade}"


def _dashes(start, end, length: float) -> list[tuple[float, float]]:
    count = max(int(math.dist(start, end) / length) | 1, 1)
    parts = [i / count for i in range(count + 1)]
    along = [tuple(a + (b - a) * part for a, b in zip(start, end, strict=True)) for part in parts]
    return [point for i in range(0, count, 2) for point in along[i : i + 2]]
