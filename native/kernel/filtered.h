// SPDX-License-Identifier: GPL-3.0-or-later
// Filtered importance sampling: Krivanek and Colbert, "Real-time Shading with Filtered Importance
// Sampling", Computer Graphics Forum 27(4), 2008; Colbert and Krivanek, "GPU-Based Importance
// Sampling", GPU Gems 3, chapter 20. BIASED: every one of N BSDF samples brings the mean radiance
// of the solid angle that it stands for, K / (N pdf), from a prefiltered chain of the map. So there
// is little noise and no light sample; what is lost is all detail finer than that solid angle, and
// the filter is round where the BSDF's lobe is not.
//
// Deviations: the paper keeps the chain as two paraboloids and corrects for their distortion. Here
// a level is a lat-long map whose rows have as many texels as their length on the sphere asks for,
// so that texels are nearly square and alike everywhere, and a level says nothing but their size.
// Samples are the renderer's own (each pixel has others), and their rays are traced: what a ray
// meets hides the whole solid angle. GPU Gems knows no visibility; the paper adds an approximate
// one.
#pragma once

#include "kernel/latlong.h"

namespace skytree {

struct FilteredRow {
  int32_t first, count;  // texels
};

struct FilteredLevel {
  int32_t first_row, height;
  Vec3 poles[2];  // radiance at +Z and -Z
};

struct FilteredView {
  const float* texels;          // RGB
  const FilteredRow* rows;      // of all levels
  const FilteredLevel* levels;  // level 1 first; level 0 is the map itself
  int32_t texel_count, row_count, level_count;
  float level_offset;  // level of a sample with pdf 1
};

/// Interpolated along a row, around the seam.
SKY_HD Vec3 lookup_filtered_row(const FilteredView& view, int32_t row, float u) {
  const FilteredRow texels = view.rows[row];
  const float x = u * (float)texels.count - 0.5f;
  const float x_floor = floorf(x);
  int32_t x0 = (int32_t)x_floor;
  int32_t x1 = x0 + 1;
  x0 = x0 < 0 ? x0 + texels.count : x0;
  x1 = x1 >= texels.count ? x1 - texels.count : x1;
  const float f = x - x_floor;
  const float* a = view.texels + 3 * (int64_t)(texels.first + x0);
  const float* b = view.texels + 3 * (int64_t)(texels.first + x1);
  return Vec3{a[0], a[1], a[2]} * (1.0f - f) + Vec3{b[0], b[1], b[2]} * f;
}

/// Radiance of one level at (u, v). Beyond the last row's centre it goes over to the pole's own
/// value, which does not depend on u.
SKY_HD Vec3 lookup_filtered_level(const FilteredView& view, int32_t index, float u, float v) {
  const FilteredLevel& level = view.levels[index];
  const float y = v * (float)level.height - 0.5f;
  const float last = (float)(level.height - 1);
  if (y <= 0.0f || y >= last) {
    const bool south = y > 0.0f;
    const float t = minf(2.0f * (south ? y - last : -y), 1.0f);
    const Vec3 row = lookup_filtered_row(view, level.first_row + (south ? level.height - 1 : 0), u);
    return row * (1.0f - t) + level.poles[south] * t;
  }
  const int32_t y0 = (int32_t)y;
  const float f = y - (float)y0;
  return lookup_filtered_row(view, level.first_row + y0, u) * (1.0f - f) +
         lookup_filtered_row(view, level.first_row + y0 + 1, u) * f;
}

/// Mean radiance around (u, v) over the solid angle of a BSDF sample with this pdf, interpolated
/// between levels.
SKY_HD_RARE Vec3 filtered_radiance(const FilteredView& view, const LatLongImage& image, Vec2 uv,
                                   float pdf) {
  const float level = view.level_offset - 0.5f * sky_log2(pdf);
  if (!(level > 0.0f)) return lookup_bilinear_uv(image, uv.x, uv.y);
  const float coarsest = (float)view.level_count;
  if (level >= coarsest) return lookup_filtered_level(view, view.level_count - 1, uv.x, uv.y);
  const int32_t finer = (int32_t)level;
  const float f = level - (float)finer;
  const Vec3 a = finer == 0 ? lookup_bilinear_uv(image, uv.x, uv.y)
                            : lookup_filtered_level(view, finer - 1, uv.x, uv.y);
  return a * (1.0f - f) + lookup_filtered_level(view, finer, uv.x, uv.y) * f;
}

}  // namespace skytree
