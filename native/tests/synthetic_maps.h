// SPDX-License-Identifier: GPL-3.0-or-later
// Maps made by code, for tests and benchmarks.
#pragma once

#include <cstdint>
#include <vector>

#include "kernel/latlong.h"

namespace skytree::testing {

/// An RGB map that owns its texels.
struct Map {
  Map(int width, int height, float value = 0.0f)
      : width(width), height(height), texels(3 * (size_t)width * height, value) {}

  void set(int x, int y, float value) {
    for (int c = 0; c < 3; ++c) texels[3 * ((size_t)y * width + x) + c] = value;
  }
  LatLongImage view() const { return {texels.data(), width, height}; }

  int width, height;
  std::vector<float> texels;
};

/// In [0, 1), from the bits of (x, y).
inline float hash_noise(uint32_t x, uint32_t y) {
  uint32_t h = x * 0x9e3779b1u ^ y * 0x85ebca77u;
  h = (h ^ h >> 15) * 0x2c1b3c6du;
  h = (h ^ h >> 12) * 0x297a2d39u;
  return (float)((h ^ h >> 15) >> 8) * 0x1p-24f;
}

/// Value noise of `period` texels, smooth in between and wrapping in x.
inline float value_noise(int x, int y, int period, int width) {
  const int columns = width / period > 0 ? width / period : 1;
  const int i = x / period, j = y / period;
  const float fx = (float)(x % period) / (float)period, fy = (float)(y % period) / (float)period;
  const auto at = [&](int a, int b) {
    return hash_noise((uint32_t)(a % columns), (uint32_t)b + 7919u * (uint32_t)period);
  };
  const float sx = fx * fx * (3 - 2 * fx), sy = fy * fy * (3 - 2 * fy);
  const float top = at(i, j) * (1 - sx) + at(i + 1, j) * sx;
  const float bottom = at(i, j + 1) * (1 - sx) + at(i + 1, j + 1) * sx;
  return top * (1 - sy) + bottom * sy;
}

/// An outdoor scene: a sky brighter at the horizon with clouds, a sun of half a degree, dark ground
/// with detail down to the texel. The same scene at every size.
inline Map make_outdoor_map(int width, int height) {
  Map map(width, height);
  const float sun_radius = (float)width / 1440.0f;
  const float sun_x = 0.31f * (float)width, sun_y = 0.22f * (float)height;
  for (int y = 0; y < height; ++y) {
    const float v = ((float)y + 0.5f) / (float)height;
    for (int x = 0; x < width; ++x) {
      float clouds = 0, weight = 1;
      for (int period = width / 8; period >= 2; period /= 2) {
        clouds += weight * (value_noise(x, y, period, width) - 0.5f);
        weight *= 0.6f;
      }
      const float dx = ((float)x - sun_x) * 0.64f, dy = (float)y - sun_y;
      const float distance = sqrtf(dx * dx + dy * dy) / sun_radius;
      float l = v < 0.5f ? 0.3f + 1.2f * v + 0.6f * clouds : 0.15f + 0.25f * clouds;
      l = fmaxf(l, 0.01f) + 3.0f / (1.0f + 0.02f * distance * distance) * (v < 0.5f);
      if (distance < 1.0f) l += 30000.0f;
      float* t = &map.texels[3 * ((size_t)y * width + x)];
      t[0] = l * 0.95f;
      t[1] = l;
      t[2] = l * (v < 0.5f ? 1.2f : 0.8f);
    }
  }
  return map;
}

}  // namespace skytree::testing
