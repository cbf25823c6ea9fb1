// SPDX-License-Identifier: GPL-3.0-or-later
// The lat-long (equirectangular) map: texels, directions and the interpolated look-up.
// u = 0.5 - phi / 2 pi with phi = atan2(y, x), v = theta / pi from +Z: Blender's convention, so
// that a direction meets the texel that Cycles shows there.
#pragma once

#include <stdint.h>

#include "kernel/math.h"
#include "kernel/vec.h"

namespace skytree {

/// RGB radiance, interleaved float32, row 0 = top (+Z); width * height may exceed 2^31 / 3.
struct LatLongImage {
  const float* texels;
  int width, height;
};

/// Fraction u along a row, in [0, 1]; exactly 1 can come out on the seam.
SKY_HD float latlong_u(Vec3 direction) {
  return 0.5f - sky_atan2(direction.y, direction.x) * kInvTwoPi;
}

/// (u, v) of a unit direction. The polar angle comes from atan2, as acos(z) is coarse near the
/// poles.
SKY_HD Vec2 latlong_uv(Vec3 direction) {
  const float r = sqrtf(direction.x * direction.x + direction.y * direction.y);
  return {latlong_u(direction), sky_atan2(r, direction.z) * kInvPi};
}

/// Texel (x, y) that a unit direction lies in. The row is counted from the nearer pole: H - (tiny)
/// would be rounded to H, and a texel of a 16k map is only a few float steps wide.
SKY_HD void latlong_texel(Vec3 direction, int width, int height, int32_t* x, int32_t* y) {
  const float r = sqrtf(direction.x * direction.x + direction.y * direction.y);
  const float rows = sky_atan2(r, fabsf(direction.z)) * kInvPi * (float)height;
  const int32_t row = (int32_t)minf(rows, (float)(height - 1));
  *x = (int32_t)clampf(latlong_u(direction) * (float)width, 0.0f, (float)(width - 1));
  *y = direction.z < 0.0f ? height - 1 - row : row;
}

SKY_HD Vec3 latlong_direction(float u, float v) {
  float sin_phi, cos_phi, sin_theta, cos_theta;
  sky_sincos_turns(0.5f - u, &sin_phi, &cos_phi);
  sky_sincos_turns(0.5f * v, &sin_theta, &cos_theta);
  return {sin_theta * cos_phi, sin_theta * sin_phi, cos_theta};
}

SKY_HD Vec3 texel(const LatLongImage& image, int x, int y) {
  const float* t = image.texels + 3 * ((int64_t)y * image.width + x);
  return {t[0], t[1], t[2]};
}

/// The four nearest texel centres of a place in the map, and where it lies between them.
struct BilinearCell {
  int x0, x1, y0, y1;
  float fx, fy;
};

/// Wraps in u, clamps at the poles.
SKY_HD BilinearCell bilinear_cell(const LatLongImage& image, float u, float v) {
  const float x = u * (float)image.width - 0.5f;
  const float y = clampf(v * (float)image.height - 0.5f, 0.0f, (float)(image.height - 1));
  const float x_floor = floorf(x);
  const int x0 = (int)x_floor, x1 = x0 + 1, y0 = (int)y;
  return {x0 < 0 ? x0 + image.width : x0,
          x1 >= image.width ? x1 - image.width : x1,
          y0,
          y0 + 1 < image.height ? y0 + 1 : y0,
          x - x_floor,
          y - (float)y0};
}

SKY_HD Vec3 lookup_cell(const LatLongImage& image, const BilinearCell& cell) {
  const Vec3 top =
      texel(image, cell.x0, cell.y0) * (1.0f - cell.fx) + texel(image, cell.x1, cell.y0) * cell.fx;
  const Vec3 bottom =
      texel(image, cell.x0, cell.y1) * (1.0f - cell.fx) + texel(image, cell.x1, cell.y1) * cell.fx;
  return top * (1.0f - cell.fy) + bottom * cell.fy;
}

/// Radiance at (u, v), interpolated between the four nearest texel centres.
SKY_HD Vec3 lookup_bilinear_uv(const LatLongImage& image, float u, float v) {
  return lookup_cell(image, bilinear_cell(image, u, v));
}

/// Radiance seen in a unit direction, in the map's frame.
SKY_HD Vec3 lookup_bilinear(const LatLongImage& image, Vec3 direction) {
  const Vec2 uv = latlong_uv(direction);
  return lookup_bilinear_uv(image, uv.x, uv.y);
}

// --- The equal-area elevation
// ---------------------------------------------------------------------
//
// Between two polar angles the solid angle per radian of azimuth is the difference of cos(theta),
// but near the poles a float cos(theta) is too coarse: at 16k x 8k the first row is 7e-8 high. The
// samplers therefore use h = sin^2(theta'/2) = (1 - |cos theta|)/2 with theta' measured from the
// nearer pole: uniform in solid angle like cos(theta), and as precise near the poles as elsewhere.

/// h of a unit direction from the nearer pole, in [0, 1/2].
SKY_HD float polar_height(Vec3 direction) {
  const float r2 = direction.x * direction.x + direction.y * direction.y;
  return r2 / (2.0f * (1.0f + fabsf(direction.z)));
}

/// An integer that grows with the polar angle from +Z to -Z and keeps the precision of h at both
/// poles (the bits of a positive float are ordered like the float).
SKY_HD int32_t elevation_key(float h, bool southern) {
  const int32_t bits = (int32_t)float_bits(h);
  return southern ? 0x7e000000 - bits : bits;  // 0x3f000000 = 0.5f is the equator from both sides
}
SKY_HD int32_t elevation_key(Vec3 direction) {
  return elevation_key(polar_height(direction), direction.z < 0.0f);
}

/// The same for the position along a row.
SKY_HD int32_t azimuth_key(float u) { return (int32_t)float_bits(maxf(u, 0.0f)); }

/// Direction at u and at h in [0, 1] measured from +Z (southern: from -Z).
SKY_HD Vec3 direction_at_height(float u, float h, bool southern) {
  float sin_phi, cos_phi;
  sky_sincos_turns(0.5f - u, &sin_phi, &cos_phi);
  const float sin_theta = 2.0f * sqrtf(maxf(h * (1.0f - h), 0.0f));
  const float z = 1.0f - 2.0f * h;
  return {sin_theta * cos_phi, sin_theta * sin_phi, southern ? -z : z};
}

}  // namespace skytree
