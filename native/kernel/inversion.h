// SPDX-License-Identifier: GPL-3.0-or-later
// Inversion of the marginal and conditional distribution functions of a map's texels, the method
// the kd-tree is compared with: Pharr, Jakob and Humphreys, "Physically Based Rendering", 3rd
// ed., 14.2.4. The guided search is the cutpoint method of Chen and Asau (1974): a table says where
// in the function a search for u has to start, so that a step or two are left.
//
// Distribution functions hold multiples of 2^-24, exact in a float, and rise by at least one at
// every texel: no texel is lost to rounding, and density and sampling agree to the last bit.
#pragma once

#include "kernel/latlong.h"

namespace skytree {

/// Where a row's points lie: h = h_start + h_slope * s, as in BlockWarp.
struct RowWarp {
  float h_start, h_slope;
  float inv_solid_angle;  // of one texel
};

struct InversionView {
  const float* marginal;     // height + 1
  const float* conditional;  // height x (width + 1)
  const RowWarp* rows;       // height
  // Row where a search for u = i/height starts; likewise columns, height x width. Null: binary
  // search.
  const uint16_t* marginal_guide;
  const uint16_t* conditional_guide;
  int32_t width, height;
};

/// The i with cdf[i] <= u < cdf[i+1], for cdf[0] = 0 and cdf[count] = 1.
SKY_HD int32_t search_binary(const float* cdf, int32_t count, float u) {
  int32_t first = 0;
  while (count > 1) {
    const int32_t half = count >> 1;
    first = cdf[first + half] <= u ? first + half : first;
    count -= half;
  }
  return first;
}

SKY_HD int32_t search_guided(const float* cdf, const uint16_t* guide, int32_t count, float u) {
  int32_t i = guide[(int32_t)minf(u * (float)count, (float)(count - 1))];
  while (cdf[i + 1] <= u) ++i;
  return i;
}

/// Distance that sampled points keep from a texel's left and right border, in turns (see kdtree.h).
constexpr float kAzimuthInset = 4e-7f;

SKY_HD float texel_azimuth(int32_t x, float offset, int32_t width) {
  const float inset = kAzimuthInset * (float)width;
  return ((float)x + (inset + (1.0f - 2.0f * inset) * offset)) / (float)width;
}

}  // namespace skytree
