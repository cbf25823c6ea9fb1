# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws a comparison into a 3D view: pictures while the engine draws, the rest over them in Blender's own
colours."""

from __future__ import annotations

import math
from functools import lru_cache

import gpu
from gpu_extras.batch import batch_for_shader

from ..viewport import gpu_draw
from .view import CompareView, Side, sampler_figures_of

COLORS = {"a": (0.95, 0.52, 0.28, 1.0), "b": (0.35, 0.65, 1.0, 1.0)}
WHITE, SOFT = (1.0, 1.0, 1.0, 0.9), (1.0, 1.0, 1.0, 0.25)
BOX = (0.0, 0.0, 0.0, 0.65)
TEXT_SIZE = 12.0
LINE_HEIGHT = 20
MARGIN = 12
PLOT_WIDTH, PLOT_HEIGHT = 230, 170

_VERTEX = """
void main()
{
  image_uv = uv;
  gl_Position = ModelViewProjectionMatrix * vec4(pos, 0.0, 1.0);
}
"""

_FRAGMENT = """
vec3 color_at(sampler2D image)
{
  ivec2 size = textureSize(image, 0);
  vec3 color = texelFetch(image, clamp(ivec2(floor(image_uv * vec2(size))), ivec2(0), size - 1), 0).rgb;
  return min(color, vec3(65504.0));  // of infinite ones the difference would be NaN
}

void main()
{
  out_color = vec4(abs(color_at(image_a) - color_at(image_b)) * gain, 1.0);
}
"""


@lru_cache(maxsize=1)
def _difference_shader():
    interface = gpu.types.GPUStageInterfaceInfo("skytree_difference")
    interface.smooth("VEC2", "image_uv")
    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    info.push_constant("FLOAT", "gain")
    info.sampler(0, "FLOAT_2D", "image_a")
    info.sampler(1, "FLOAT_2D", "image_b")
    info.vertex_in(0, "VEC2", "pos")
    info.vertex_in(1, "VEC2", "uv")
    info.vertex_out(interface)
    info.fragment_out(0, "VEC4", "out_color")
    info.vertex_source(_VERTEX)
    info.fragment_source(_FRAGMENT)
    return gpu.shader.create_from_info(info)


def draw_difference(a, b, x, y, width, height, gain: float):
    """gain * |a - b| of two textures into a rectangle, as scene-linear values."""
    shader = _difference_shader()
    corners = ((x, y), (x + width, y), (x, y + height), (x + width, y + height))
    uvs = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": corners, "uv": uvs})
    shader.bind()
    shader.uniform_sampler("image_a", a)
    shader.uniform_sampler("image_b", b)
    shader.uniform_float("gain", gain)
    batch.draw(shader)


def draw_pictures(view: CompareView, mode: str, split: float, show_b: bool, gain: float):
    """Both pictures as scene-linear values, arranged as `mode` says (compare.props.MODES)."""
    a, b = view.sides["a"], view.sides["b"]
    x, y, width, height = view.request.view.rectangle
    if mode == "DIFFERENCE":
        if a.uploaded() is not None and b.uploaded() is not None:
            draw_difference(a.uploaded(), b.uploaded(), x, y, width, height, gain)
    elif mode == "FLIP":
        _draw_part(b if show_b else a, x, y, width, height, 0.0, 1.0)
    elif mode == "SIDE":
        half = width // 2
        _draw_part(a, x, y, half, height, 0.25, 0.25 + half / width)
        _draw_part(b, x + half, y, width - half, height, 0.25, 0.25 + (width - half) / width)
    else:
        left = round(width * split)
        _draw_part(a, x, y, left, height, 0.0, left / width)
        _draw_part(b, x + left, y, width - left, height, left / width, 1.0)


def _draw_part(side: Side, x, y, width, height, left: float, right: float):
    """The part of a picture between two fractions of its width."""
    texture = side.uploaded()
    if texture is not None and width > 0:
        smooth = side.picture.divisor > 1
        gpu_draw.draw_image(texture, x, y, width, height, smooth=smooth, uv=(left, 0.0, right, 1.0))


def split_position(view: CompareView, split: float) -> float:
    """Where the line stands, in pixels of the region from the left."""
    x, _, width, _ = view.request.view.rectangle
    return x + round(width * split)


def draw_over(view: CompareView, compared, free: tuple[int, int, int, int]):
    """Line, names, figures and plot; `compared` is scene.skytree_compare, `free` the region's uncovered
    part."""
    mode = compared.mode
    rectangle = view.request.view.rectangle
    if mode in {"SPLIT", "SIDE"}:
        split = compared.split if mode == "SPLIT" else 0.5
        at = split_position(view, split)
        gpu_draw.rectangle(at - 1, rectangle[1], 2, rectangle[3], WHITE)
        if mode == "SPLIT":
            gpu_draw.rectangle(at - 4, rectangle[1] + rectangle[3] / 2 - 16, 8, 32, WHITE)
    x, y, width, height = free
    top = y + height - MARGIN
    if mode == "FLIP":
        name = "b" if compared.show_b else "a"
        _draw_lines(side_lines(view, name, compared.show_figures), x + MARGIN, top, COLORS[name])
    else:
        _draw_lines(side_lines(view, "a", compared.show_figures), x + MARGIN, top, COLORS["a"])
        _draw_lines(
            side_lines(view, "b", compared.show_figures), x + width - MARGIN, top, COLORS["b"], right=True
        )
    notes = state_lines(view, compared)
    for index, line in enumerate(reversed(notes)):
        gpu_draw.label(x + MARGIN, y + MARGIN + index * LINE_HEIGHT, line, TEXT_SIZE, background=BOX)
    if compared.show_plot and any(side.steps for side in view.sides.values()):
        draw_plot(view, compared.plot_axis, x + width - MARGIN - PLOT_WIDTH, y + MARGIN)


def _draw_lines(lines: list[str], x: float, top: float, color, right: bool = False):
    for index, line in enumerate(lines):
        left = x - gpu_draw.text_size(line, TEXT_SIZE)[0] - 8 if right else x
        gpu_draw.label(
            left, top - (index + 1) * LINE_HEIGHT, line, TEXT_SIZE, color if index == 0 else WHITE, BOX
        )


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


def state_lines(view: CompareView, compared) -> list[str]:
    """What is going on, and what the user might want to do."""
    lines = []
    if view.problem:
        lines.append(view.problem)
    if view.capture is not None:
        lines.append(f"Capturing the reference: {100 * view.capture.fraction:.0f} %")
    elif view.reference_is_stale:
        lines.append("The reference is of another view or scene: capture it again")
    elif view.captured is None and compared.show_figures:
        lines.append("Capture a reference to see errors")
    if compared.mode == "DIFFERENCE":
        lines.append(f"|A - B| x {compared.gain:g}")
    return lines


def draw_plot(view: CompareView, axis: str, left: float, low: float):
    """Squared error against samples or time on logarithmic axes with a guide of slope -1."""
    curves = {name: curve_of(side, axis) for name, side in view.sides.items()}
    points = [point for curve in curves.values() for point in curve]
    if not points:
        return
    x0, x1 = _decades([p[0] for p in points])
    y0, y1 = _decades([p[1] for p in points])
    inner = (left + 34, low + 22, PLOT_WIDTH - 44, PLOT_HEIGHT - 44)

    def at(x, y):
        return (inner[0] + (x - x0) / (x1 - x0) * inner[2], inner[1] + (y - y0) / (y1 - y0) * inner[3])

    gpu_draw.rectangle(left, low, PLOT_WIDTH, PLOT_HEIGHT, BOX)
    for decade in range(x0, x1 + 1):
        x, y = at(decade, y0)
        gpu_draw.rectangle(x, y, 1, inner[3], SOFT)
        gpu_draw.text(x - 6, low + 8, f"{10.0**decade:g}", 10.0, WHITE, shadow=False)
    for decade in range(y0, y1 + 1):
        x, y = at(x0, decade)
        gpu_draw.rectangle(x, y, inner[2], 1, SOFT)
        gpu_draw.text(left + 4, y - 4, f"1e{decade}", 10.0, WHITE, shadow=False)
    title = "nRMSE_tc^2 / " + ("samples" if axis == "SAMPLES" else "seconds")
    gpu_draw.text(left + 34, low + PLOT_HEIGHT - 15, title, 11.0, WHITE, shadow=False)
    start = min(points)
    length = min(x1 - start[0], start[1] - y0)
    gpu_draw.lines([at(*start), at(start[0] + length, start[1] - length)], (*WHITE[:3], 0.5), 1.0)
    for name, curve in curves.items():
        gpu_draw.polyline([at(*point) for point in curve], COLORS[name], 2.0)
        for x, y in (at(*point) for point in curve):
            gpu_draw.rectangle(x - 2, y - 2, 4, 4, COLORS[name])


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


def formatted_seconds(seconds: float) -> str:
    return f"{1000 * seconds:.0f} ms" if seconds < 1 else f"{seconds:.2f} s"


def formatted(value: float | None) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:.3g}"
