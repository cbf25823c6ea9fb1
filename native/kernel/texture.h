// SPDX-License-Identifier: GPL-3.0-or-later
// Image textures, addressed as Blender's Image Texture node does: v = 0 is the bottom edge of the
// picture.
#pragma once

#include "kernel/vec.h"

namespace skytree {

enum class TextureExtension : int { kRepeat, kExtend, kClip, kMirror };
enum class TextureInterpolation : int { kLinear, kClosest };

/// Linear RGB or RGBA, row 0 at the top.
struct TextureView {
  const float* texels;
  int width, height, channels;
  TextureExtension extension;
  TextureInterpolation interpolation;
  Vec3 u_row, v_row;  // the texture is looked up at (u_row . (u,v,1), v_row . (u,v,1))
};

/// Texel column or row for an index outside the picture; -1 where the extension shows nothing.
SKY_HD int extend_index(int i, int size, TextureExtension extension) {
  switch (extension) {
    case TextureExtension::kRepeat: {
      const int m = i % size;
      return m < 0 ? m + size : m;
    }
    case TextureExtension::kExtend:
      return i < 0 ? 0 : (i >= size ? size - 1 : i);
    case TextureExtension::kMirror: {
      int m = i % (2 * size);
      m = m < 0 ? m + 2 * size : m;
      return m < size ? m : 2 * size - 1 - m;
    }
    default:
      return i < 0 || i >= size ? -1 : i;
  }
}

SKY_HD Vec3 texel(const TextureView& texture, int x, int y_up) {
  const int column = extend_index(x, texture.width, texture.extension);
  const int row = extend_index(y_up, texture.height, texture.extension);
  if (column < 0 || row < 0) return {0, 0, 0};
  const float* p =
      texture.texels + (static_cast<long long>(texture.height - 1 - row) * texture.width + column) *
                           texture.channels;
  return {p[0], p[1], p[2]};
}

SKY_HD_CALL Vec3 sample_texture(const TextureView& texture, Vec2 surface_uv) {
  const Vec3 homogeneous = {surface_uv.x, surface_uv.y, 1.0f};
  const Vec2 uv = {dot(texture.u_row, homogeneous), dot(texture.v_row, homogeneous)};
  // Beyond 2^22 periods a float has no fraction left, and the index would overflow.
  const float limit = 4194304.0f;
  float x = clampf(uv.x, -limit, limit) * static_cast<float>(texture.width);
  float y = clampf(uv.y, -limit, limit) * static_cast<float>(texture.height);
  x = clampf(x, -1e9f, 1e9f);
  y = clampf(y, -1e9f, 1e9f);
  if (texture.interpolation == TextureInterpolation::kClosest) {
    return texel(texture, static_cast<int>(floorf(x)), static_cast<int>(floorf(y)));
  }
  const float fx = floorf(x - 0.5f), fy = floorf(y - 0.5f);
  const float s = x - 0.5f - fx, t = y - 0.5f - fy;
  const int ix = static_cast<int>(fx), iy = static_cast<int>(fy);
  const Vec3 lower = texel(texture, ix, iy) * (1.0f - s) + texel(texture, ix + 1, iy) * s;
  const Vec3 upper = texel(texture, ix, iy + 1) * (1.0f - s) + texel(texture, ix + 1, iy + 1) * s;
  return lower * (1.0f - t) + upper * t;
}

}  // namespace skytree
