// SPDX-License-Identifier: GPL-3.0-or-later
// Blocks of a kd-tree whose density is linear along the azimuth and linear along the equal-area
// elevation,
//   pdf = probability / solid angle * (1 + a (2p - 1)) (1 + b (2q - 1)),  p, q in [0, 1],
// over cells between texel centres, in which the interpolated map is one bilinear patch. After the
// paper's constant blocks (kernel/kdtree.h): a constant under an interpolated look-up costs
// variance that no number of blocks takes away.
//
// Sampling and density both compute the pdf from the direction, so that both give the same bits.
#pragma once

#include "kernel/latlong.h"

namespace skytree {

/// 32 bytes: two loads on a GPU. Heights are measured from the pole that is nearer to the block (-Z
/// if h_rise is negative), so that they keep their digits there.
struct alignas(16) LinearBlock {
  uint32_t columns;       // first cell | end << 16
  uint32_t tilts;         // along u | along h << 16, signed, in 1/32768
  float h_start, h_rise;  // h = h_start + |h_rise| * q
  Vec2 warp_origin;       // lower corner in (u.y, u.z)
  Vec2 warp_scale;        // 1 / extent there
};

/// What sampled points keep away from a block's border by, more than float rounding of a direction
/// can move them: in turns, and in parts of h.
constexpr float kLinearAzimuthInset = 6e-7f;
constexpr float kLinearHeightInset = 8e-7f;

SKY_HD float tilt_along_azimuth(const LinearBlock& block) {
  return (float)(int16_t)(block.tilts & 0xffffu) * (1.0f / 32768.0f);
}
SKY_HD float tilt_along_height(const LinearBlock& block) {
  return (float)(int16_t)(block.tilts >> 16) * (1.0f / 32768.0f);
}

/// Extent along the azimuth in turns of the cells' frame.
SKY_HD float block_u_start(const LinearBlock& block, float cell_width) {
  return (float)(block.columns & 0xffffu) * cell_width;
}
SKY_HD float block_u_extent(const LinearBlock& block, float cell_width) {
  return (float)((block.columns >> 16) - (block.columns & 0xffffu)) * cell_width;
}

/// u of the cells' frame: half a texel from the map's `map_u`, wrapped.
SKY_HD float cell_azimuth(float map_u, float cell_width) {
  const float u = map_u - 0.5f * cell_width;
  return u < 0.0f ? u + 1.0f : u;
}
SKY_HD float cell_azimuth(Vec3 direction, float cell_width) {
  return cell_azimuth(latlong_u(direction), cell_width);
}

/// x in [0, 1] with the density 1 + a (2x - 1), from a number in [0, 1]. Exact inverse, in the form
/// that cancels nowhere.
SKY_HD float sample_linear(float a, float r) {
  const float b = 1.0f - a;
  return minf(2.0f * r / (b + sqrtf(b * b + 4.0f * a * r)), 1.0f);
}

/// Density per steradian of a direction that lies in the block, u from cell_azimuth.
SKY_HD float linear_block_pdf(const LinearBlock& block, float cell_width, float u, Vec3 direction) {
  const float near = polar_height(direction);
  const float h = (direction.z < 0.0f) == (block.h_rise < 0.0f) ? near : 1.0f - near;
  const float width = block_u_extent(block, cell_width);
  const float rise = fabsf(block.h_rise);
  const float along = clampf(u - block_u_start(block, cell_width), 0.0f, width);
  const float up = clampf(h - block.h_start, 0.0f, rise);
  const float shape = (width + tilt_along_azimuth(block) * (2.0f * along - width)) *
                      (rise + tilt_along_height(block) * (2.0f * up - rise));
  return shape /
         (kFourPi * (width * width) * (rise * rise) * block.warp_scale.x * block.warp_scale.y);
}

/// Direction at offsets (p, q) in [0, 1] of a block, kept off its borders and off the pole itself,
/// which has no azimuth.
SKY_HD Vec3 direction_in_linear_block(const LinearBlock& block, float cell_width, float p,
                                      float q) {
  const float start = block_u_start(block, cell_width);
  const float width = block_u_extent(block, cell_width);
  const float u = 0.5f * cell_width + clampf(start + width * p, start + kLinearAzimuthInset,
                                             start + width - kLinearAzimuthInset);
  const float rise = fabsf(block.h_rise);
  const float low = block.h_start * (1.0f + kLinearHeightInset) + rise * kLinearHeightInset;
  const float high = (block.h_start + rise) * (1.0f - kLinearHeightInset);
  const float h = clampf(block.h_start + rise * q, low, high);
  return direction_at_height(u < 1.0f ? u : u - 1.0f, h, block.h_rise < 0.0f);
}

/// Direction that the warp of (r, s), which lies in the block's part of the unit square, gives. The
/// polar angle from +Z grows with s.
SKY_HD Vec3 sample_linear_block(const LinearBlock& block, float cell_width, float r, float s) {
  const float across = clampf((r - block.warp_origin.x) * block.warp_scale.x, 0.0f, 1.0f);
  const float down = clampf((s - block.warp_origin.y) * block.warp_scale.y, 0.0f, 1.0f);
  return direction_in_linear_block(
      block, cell_width, sample_linear(tilt_along_azimuth(block), across),
      sample_linear(tilt_along_height(block), block.h_rise < 0.0f ? 1.0f - down : down));
}

}  // namespace skytree
