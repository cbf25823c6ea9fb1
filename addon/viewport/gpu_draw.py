# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing in pixels of a region through Blender's gpu module: float images, rectangles, lines, text.

Works in Blender 3.4 (OpenGL) up to 5.2, in `view_draw`, in draw handlers and offscreen. Coordinates are
pixels from the lower left corner; colours are RGBA in 0..1 as the user interface has them (sRGB-encoded).
"""

from __future__ import annotations

from contextlib import contextmanager
from functools import lru_cache

import blf
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

FONT = 0

_VERTEX = """
void main()
{
  image_uv = uv;
  gl_Position = ModelViewProjectionMatrix * vec4(pos, 0.0, 1.0);
}
"""

# Texels are fetched one by one: whether a sampler interpolates is not the same in all versions.
_FRAGMENT = """
vec4 texel(ivec2 p)
{
  // Beyond the largest half a texel is infinite, and infinity times an alpha of zero would be NaN.
  return min(texelFetch(image, clamp(p, ivec2(0), textureSize(image, 0) - 1), 0), vec4(65504.0));
}

vec4 bilinear(vec2 p)
{
  vec2 corner = floor(p - 0.5);
  vec2 f = p - 0.5 - corner;
  ivec2 i = ivec2(corner);
  return mix(mix(texel(i), texel(i + ivec2(1, 0)), f.x),
             mix(texel(i + ivec2(0, 1)), texel(i + ivec2(1, 1)), f.x), f.y);
}

vec3 table_texel(ivec3 p)
{
  return texelFetch(table, ivec2(p.x + p.z * table_size, p.y), 0).rgb;
}

vec3 view_transform(vec3 color)
{
  float stops = shaper.y - shaper.x;
  vec3 p = (log2(max(color, vec3(0.0)) + exp2(shaper.x)) - shaper.x) / stops * float(table_size - 1);
  p = clamp(p, vec3(0.0), vec3(float(table_size - 1)));
  ivec3 i = min(ivec3(p), ivec3(table_size - 2));
  vec3 f = p - vec3(i);
  vec3 result = vec3(0.0);
  for (int k = 0; k < 8; k++) {
    ivec3 o = ivec3(k & 1, (k >> 1) & 1, k >> 2);
    vec3 w = mix(1.0 - f, f, vec3(o));
    result += table_texel(i + o) * (w.x * w.y * w.z);
  }
  return result;
}

vec3 srgb_encode(vec3 c)
{
  vec3 power = 1.055 * pow(max(c, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
  return mix(power, c * 12.92, lessThan(c, vec3(0.0031308)));
}

vec3 srgb_decode(vec3 c)
{
  vec3 power = pow((max(c, vec3(0.04045)) + 0.055) / 1.055, vec3(2.4));
  return mix(power, c / 12.92, lessThan(c, vec3(0.04045)));
}

void main()
{
  vec2 p = image_uv * vec2(textureSize(image, 0));
  vec4 color = smooth_image ? bilinear(p) : texel(ivec2(floor(p)));
  if (to_display != 0) {
    vec3 straight = color.a > 0.0 ? color.rgb / color.a : color.rgb;
    if (to_display == 1) {
      straight = view_transform(straight);
    }
    else if (to_display == 2) {
      straight = srgb_encode(straight);
    }
    color.a = clamp(color.a, 0.0, 1.0);
    // Blender sets srgbTarget where the framebuffer encodes what is written into it.
    color.rgb = (srgbTarget ? srgb_decode(straight) : straight) * color.a;
  }
  out_color = color;
}
"""

SCENE_LINEAR, VIEW_TRANSFORM, SRGB, ENCODED = 0, 1, 2, 3


@lru_cache(maxsize=1)
def _image_shader():
    interface = gpu.types.GPUStageInterfaceInfo("skytree_image")
    interface.smooth("VEC2", "image_uv")
    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    info.push_constant("VEC2", "shaper")
    info.push_constant("INT", "table_size")
    info.push_constant("INT", "to_display")
    info.push_constant("BOOL", "smooth_image")
    info.push_constant("BOOL", "srgbTarget")
    info.sampler(0, "FLOAT_2D", "image")
    info.sampler(1, "FLOAT_2D", "table")
    info.vertex_in(0, "VEC2", "pos")
    info.vertex_in(1, "VEC2", "uv")
    info.vertex_out(interface)
    info.fragment_out(0, "VEC4", "out_color")
    info.vertex_source(_VERTEX)
    info.fragment_source(_FRAGMENT)
    return gpu.shader.create_from_info(info)


def upload(pixels: np.ndarray) -> gpu.types.GPUTexture:
    """A texture of pixels (height, width, 4) float32, alpha premultiplied, bottom row first."""
    height, width, channels = pixels.shape
    if channels != 4 or pixels.dtype != np.float32:
        raise ValueError(f"An image to draw is (height, width, 4) float32, not {pixels.shape} {pixels.dtype}")
    flat = pixels.reshape(-1)
    # A Buffer made from an array is a copy of it in some versions and a view in others.
    return gpu.types.GPUTexture(
        (width, height), format="RGBA16F", data=gpu.types.Buffer("FLOAT", (flat.size,), flat)
    )


def draw_image(
    texture,
    x,
    y,
    width,
    height,
    *,
    colors=SCENE_LINEAR,
    view_transform=None,
    smooth=True,
    uv=(0.0, 0.0, 1.0, 1.0),
):
    """Draws a texture (see `upload`) into a rectangle, blended over what is there.

    `colors` says what is written: SCENE_LINEAR values as they are (in `view_draw`, where Blender applies the
    scene's view transform afterwards); in draw handlers, where it does not: VIEW_TRANSFORM (by a
    display_transform.ViewTransform), SRGB (linear values, encoded here), or ENCODED (already encoded).
    `uv` is the part of the image shown: left, bottom, right, top in 0..1.
    """
    if colors == VIEW_TRANSFORM and view_transform is None:
        colors = SRGB
    shader = _image_shader()
    corners = ((x, y), (x + width, y), (x, y + height), (x + width, y + height))
    left, bottom, right, top = uv
    uvs = ((left, bottom), (right, bottom), (left, top), (right, top))
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": corners, "uv": uvs})
    with blended("ALPHA_PREMULT"):
        shader.bind()
        shader.uniform_sampler("image", texture)
        shader.uniform_sampler("table", view_transform.texture if view_transform else texture)
        shader.uniform_float("shaper", view_transform.shaper if view_transform else (0.0, 1.0))
        shader.uniform_int("table_size", view_transform.size if view_transform else 2)
        shader.uniform_int("to_display", colors)
        shader.uniform_bool("smooth_image", [bool(smooth)])
        batch.draw(shader)


def rectangle(x, y, width, height, color):
    _fill(((x, y), (x + width, y), (x, y + height), (x + width, y + height)), "TRI_STRIP", color)


def frame(x, y, width, height, color, thickness=1.0):
    """The outline of a rectangle, inside it."""
    rectangle(x, y, width, thickness, color)
    rectangle(x, y + height - thickness, width, thickness, color)
    rectangle(x, y + thickness, thickness, height - 2 * thickness, color)
    rectangle(x + width - thickness, y + thickness, thickness, height - 2 * thickness, color)


def lines(points, color, thickness=1.0):
    """Separate segments between points 0-1, 2-3, ...; (2 n, 2) array or list.

    Segments are quads: drivers need not draw lines wider than one pixel."""
    ends = np.asarray(points, np.float32).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-6)[:, None]
    across = np.stack((-along[:, 1], along[:, 0]), axis=1) / length * (0.5 * thickness)
    a, b = ends[:, 0], ends[:, 1]
    quads = np.stack((a - across, b - across, b + across, a - across, b + across, a + across), axis=1)
    _fill(quads.reshape(-1, 2), "TRIS", color)


def polyline(points, color, thickness=1.0):
    points = np.asarray(points, np.float32).reshape(-1, 2)
    if len(points) > 1:
        lines(np.repeat(points, 2, axis=0)[1:-1], color, thickness)


def text(x, y, words: str, size=12.0, color=(1.0, 1.0, 1.0, 1.0), shadow=True):
    """One line of text with its baseline's left end at (x, y); `size` in pixels."""
    blf.size(FONT, size)
    if shadow:
        blf.enable(FONT, blf.SHADOW)
        blf.shadow(FONT, 3, 0.0, 0.0, 0.0, 0.8)
        blf.shadow_offset(FONT, 1, -1)
    blf.color(FONT, *color)
    blf.position(FONT, x, y, 0)
    blf.draw(FONT, words)
    if shadow:
        blf.disable(FONT, blf.SHADOW)


def text_size(words: str, size=12.0) -> tuple[float, float]:
    blf.size(FONT, size)
    return blf.dimensions(FONT, words)


def label(
    x, y, words: str, size=12.0, color=(1.0, 1.0, 1.0, 1.0), background=(0.0, 0.0, 0.0, 0.6), padding=4.0
):
    """Text on a dark box whose lower left corner is (x, y); returns the box's (width, height)."""
    width, height = text_size(words, size)[0] + 2 * padding, size + 2 * padding
    rectangle(x, y, width, height, background)
    text(x + padding, y + padding + 0.15 * size, words, size, color, shadow=False)
    return width, height


def _fill(points, kind, color):
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    # The built-in shader takes three coordinates; two are accepted by OpenGL only.
    pos = np.zeros((len(points), 3), np.float32)
    pos[:, :2] = points
    with blended("ALPHA"):
        shader.bind()
        shader.uniform_float("color", color)
        batch_for_shader(shader, kind, {"pos": pos}).draw(shader)


@contextmanager
def blended(mode):
    gpu.state.blend_set(mode)
    try:
        yield
    finally:
        gpu.state.blend_set("NONE")


@contextmanager
def clipped(x, y, width, height):
    """Confines drawing to a rectangle of the region that is being drawn."""
    left, bottom, _, _ = gpu.state.viewport_get()
    if not hasattr(gpu.state, "scissor_set"):
        yield
        return
    before = gpu.state.scissor_get()
    gpu.state.scissor_test_set(True)
    gpu.state.scissor_set(int(left + x), int(bottom + y), int(width), int(height))
    try:
        yield
    finally:
        gpu.state.scissor_set(*before)
        gpu.state.scissor_test_set(False)


@contextmanager
def pixel_space(width, height):
    """Region coordinates while drawing into an offscreen buffer of this size."""
    projection = Matrix.Diagonal((2.0 / width, 2.0 / height, 1.0, 1.0))
    projection.translation = (-1.0, -1.0, 0.0)
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        gpu.matrix.load_matrix(Matrix.Identity(4))
        gpu.matrix.load_projection_matrix(projection)
        yield


def render_offscreen(width, height, draw, background=(0.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    """What `draw()` draws in region coordinates: (height, width, 4) float32, bottom row first."""
    target = gpu.types.GPUOffScreen(width, height, format="RGBA32F")
    try:
        with target.bind():
            framebuffer = gpu.state.active_framebuffer_get()
            framebuffer.clear(color=background)
            with pixel_space(width, height):
                draw()
            buffer = framebuffer.read_color(0, 0, width, height, 4, 0, "FLOAT")
        buffer.dimensions = width * height * 4
        return np.array(buffer, np.float32).reshape(height, width, 4)
    finally:
        target.free()
