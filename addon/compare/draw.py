# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the pictures of a comparison into a 3D view while the engine draws; labels.py draws over them."""

from __future__ import annotations

from functools import lru_cache

import gpu
from gpu_extras.batch import batch_for_shader

from ..viewport import gpu_draw
from .sides import Side
from .view import CompareView

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
