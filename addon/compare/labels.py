# SPDX-License-Identifier: GPL-3.0-or-later
"""What is drawn over the pictures of a comparison: the line, names, figures, notes and the convergence plot.

All sizes are in pixels of a display at 100 %, times Blender's resolution scale.
"""

from __future__ import annotations

import math

from ..viewport import gpu_draw
from .draw import split_position
from .plot import COLORS, draw_plot
from .sides import sampler_figures_of
from .view import CompareView

WHITE = (1.0, 1.0, 1.0, 0.9)
WARNING = (1.0, 0.72, 0.3, 1.0)
BOX = (0.05, 0.05, 0.05, 0.78)
TEXT_SIZE, TITLE_SIZE = 12.0, 13.0
LINE_HEIGHT = 18.0
MARGIN, PADDING = 10.0, 8.0
PLOT_WIDTH, PLOT_HEIGHT = 280.0, 190.0


def draw_over(view: CompareView, compared, free: tuple[int, int, int, int], scale: float = 1.0):
    """`compared` is scene.skytree_compare, `free` the uncovered part of the region."""
    mode = compared.mode
    if mode in {"SPLIT", "SIDE"}:
        _draw_line(view, compared, scale)
    shown = ["b" if compared.show_b else "a"] if mode == "FLIP" else ["a", "b"]
    x, y, width, height = free
    margin = MARGIN * scale
    texts = _fitting(view, shown, compared.show_figures, width - 2 * margin, scale)
    top, lowest = y + height - margin, y + height
    for name in shown:
        box_width, box_height = _box_size(texts[name], scale)
        left = x + width - margin - box_width if name == "b" and len(shown) > 1 else x + margin
        _draw_box(texts[name], left, top - box_height, COLORS[name], scale)
        lowest = min(lowest, top - box_height)
        if _stacked(texts, width - 2 * margin, scale):
            top = lowest - 0.5 * margin
    note_top = _draw_notes(view, compared, x + margin, y + margin, scale)
    if compared.show_plot and any(side.steps for side in view.sides.values()):
        plot_width = min(PLOT_WIDTH * scale, 0.55 * (width - 2 * margin))
        plot_height = min(PLOT_HEIGHT * scale, lowest - y - 2 * margin)
        beside_notes = x + width - margin - plot_width
        low = y + margin if note_top == 0.0 or beside_notes > x + 0.4 * width else note_top + 0.5 * margin
        if plot_width > 150 * scale and plot_height > 100 * scale:
            draw_plot(view, compared.plot_axis, beside_notes, low, plot_width, plot_height, scale)


def _draw_line(view: CompareView, compared, scale: float):
    rectangle = view.request.view.rectangle
    at = split_position(view, compared.split if compared.mode == "SPLIT" else 0.5)
    gpu_draw.rectangle(at - 1, rectangle[1], 2, rectangle[3], WHITE)
    if compared.mode == "SPLIT":
        middle, half = rectangle[1] + rectangle[3] / 2, 16 * scale
        gpu_draw.rectangle(at - 5 * scale, middle - half, 10 * scale, 2 * half, (0.1, 0.1, 0.1, 0.9))
        gpu_draw.rectangle(at - 4 * scale, middle - half + 1, 8 * scale, 2 * half - 2, WHITE)


# Names and figures


def _fitting(view, shown: list[str], with_figures: bool, width: float, scale: float) -> dict[str, list[str]]:
    """Lines of each side: with all figures where the boxes lie side by side, else without."""
    texts = {name: side_lines(view, name, with_figures) for name in shown}
    if with_figures and _stacked(texts, width, scale):
        texts = {name: side_lines(view, name, False) for name in shown}
    return texts


def _stacked(texts: dict[str, list[str]], width: float, scale: float) -> bool:
    """Whether the boxes are too wide to lie side by side."""
    return sum(_box_size(lines, scale)[0] for lines in texts.values()) + MARGIN * scale > width


def _box_size(lines: list[str], scale: float) -> tuple[float, float]:
    sizes = [TITLE_SIZE] + [TEXT_SIZE] * (len(lines) - 1)
    longest = max(gpu_draw.text_size(line, size * scale)[0] for line, size in zip(lines, sizes, strict=True))
    return longest + 2 * PADDING * scale, (len(lines) * LINE_HEIGHT + PADDING) * scale


def _draw_box(lines: list[str], left: float, low: float, color, scale: float):
    width, height = _box_size(lines, scale)
    gpu_draw.rectangle(left, low, width, height, BOX)
    gpu_draw.rectangle(left, low, 3 * scale, height, color)
    baseline = low + height - (LINE_HEIGHT - 1) * scale
    for index, line in enumerate(lines):
        size = TEXT_SIZE if index else TITLE_SIZE
        paint = WHITE if index else color
        gpu_draw.text(left + PADDING * scale, baseline, line, size * scale, paint, shadow=False)
        baseline -= LINE_HEIGHT * scale


def side_lines(view: CompareView, name: str, with_figures: bool) -> list[str]:
    """What a side is, what it cost and how far it is from the reference."""
    side = view.sides[name]
    if side.method is None:
        if side.picture is None:
            return [f"{name.upper()}  no reference of this view"]
        stale = ", stale" if view.reference_is_stale else ""
        return [f"{name.upper()}  reference, {side.picture.samples} spp{stale}"]
    samples = side.picture.samples if side.picture and side.picture.divisor == 1 else 0
    lines = [
        f"{name.upper()}  {side.method.label}",
        f"{samples} spp   {formatted_seconds(side.seconds)}",
    ]
    if not with_figures:
        return lines
    if side.steps:
        step, errors = side.steps[-1], side.steps[-1].errors
        lines += [
            f"RMSE {formatted(errors['rmse'])}   relMSE {formatted(errors['relmse'])}",
            f"nRMSE_tc {formatted(errors['nrmse_tc'])}   mean {100 * errors['mean_difference']:+.2f} %",
            f"efficiency {formatted(step.efficiency)}",
        ]
    figures = sampler_figures_of(side)
    if figures:
        lines.append(f"largest weight {formatted(figures['largest_weight'])}")
        lines.append(f"light variance {formatted(figures['sample_variance'])}")
    return lines


# Notes


def state_lines(view: CompareView, compared) -> list[tuple[str, bool]]:
    """(what is going on or what the user might want to do, whether it is a warning)"""
    lines = []
    if view.problem:
        lines.append((view.problem, True))
    if view.capture is not None:
        lines.append((f"Capturing the reference: {100 * view.capture.fraction:.0f} %", False))
    elif view.reference_is_stale:
        lines.append(("Stale: the reference is of another view or scene. Capture it again", True))
    elif view.captured is None and compared.show_figures:
        lines.append(("Capture a reference to see errors", False))
    if compared.mode == "DIFFERENCE":
        lines.append((f"|A - B| x {compared.gain:g}", False))
    return lines


def _draw_notes(view: CompareView, compared, left: float, low: float, scale: float) -> float:
    """The upper edge of what was drawn, 0 where there is nothing to say."""
    notes = state_lines(view, compared)
    for words, is_warning in reversed(notes):
        color = WARNING if is_warning else WHITE
        _width, height = gpu_draw.label(left, low, words, TEXT_SIZE * scale, color, BOX, 5 * scale)
        low += height + 2 * scale
    if view.capture is not None:
        length = 180 * scale
        gpu_draw.rectangle(left, low, length, 5 * scale, BOX)
        gpu_draw.rectangle(left, low, length * view.capture.fraction, 5 * scale, WHITE)
        low += 7 * scale
    return low if notes else 0.0


def formatted_seconds(seconds: float) -> str:
    return f"{1000 * seconds:.0f} ms" if seconds < 1 else f"{seconds:.2f} s"


def formatted(value: float | None) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:.3g}"
