// SPDX-License-Identifier: GPL-3.0-or-later
// Hierarchical sample warping, for comparison and teaching: a pyramid of sums over 2 x 2 texels is
// descended, and at each level the random pair chooses a quadrant and is stretched to be used
// again. McCool and Harwood, "Probability Trees", GI 1997; as "hierarchical warping" in Clarberg et
// al., "Wavelet Importance Sampling", SIGGRAPH 2005, and in Mitsuba. It keeps stratification like
// the kd-tree's warp, but the pyramid has 4/3 floats for every texel, and a sample visits all of
// its levels.
#pragma once

#include "kernel/inversion.h"

namespace skytree {

/// Levels lie one behind the other from the root (1x1) to the texels. A level has half the columns
/// and rows of the next, rounded up: what an odd level lacks counts as 0.
struct HierarchyView {
  const float* weights;
  const RowWarp* rows;  // height
  int32_t width, height;
  int32_t level_count;
};

SKY_HD int32_t halved(int32_t size, int32_t times) { return ((size - 1) >> times) + 1; }

/// Where the texels' own level begins.
SKY_HD int64_t hierarchy_base(const HierarchyView& view) {
  int64_t base = 0;
  for (int32_t level = view.level_count - 1; level > 0; --level) {
    base += (int64_t)halved(view.width, level) * halved(view.height, level);
  }
  return base;
}

/// Probability of a texel, per steradian.
SKY_HD float hierarchy_pdf(const HierarchyView& view, int64_t base, int32_t x, int32_t y) {
  return view.weights[base + (int64_t)y * view.width + x] / view.weights[0] *
         view.rows[y].inv_solid_angle;
}

/// Chooses the second of two parts with probability second / (first + second); *u is stretched to
/// be used again.
SKY_HD bool choose_part(float first, float second, float* u) {
  if (!(second > 0.0f)) return false;
  const float at = *u * (first + second);
  const bool is_second = at >= first;
  *u = minf(is_second ? (at - first) / second : at / first, kOneMinusEpsilon);
  return is_second;
}

/// Texel that (r, s) lands in, and where in it.
SKY_HD void descend_hierarchy(const HierarchyView& view, float* r, float* s, int32_t* column,
                              int32_t* row, int64_t* base) {
  int32_t x = 0, y = 0;
  int64_t first = 0;
  for (int32_t level = view.level_count - 2; level >= 0; --level) {
    first += (int64_t)halved(view.width, level + 1) * halved(view.height, level + 1);
    const int32_t width = halved(view.width, level), height = halved(view.height, level);
    x *= 2;
    y *= 2;
    const float* top = view.weights + first + (int64_t)y * width + x;
    const float* bottom = top + width;
    const bool two_columns = x + 1 < width, two_rows = y + 1 < height;
    const float upper = top[0] + (two_columns ? top[1] : 0.0f);
    const float lower = two_rows ? bottom[0] + (two_columns ? bottom[1] : 0.0f) : 0.0f;
    const bool down = choose_part(upper, lower, s);
    const float* chosen = down ? bottom : top;
    y += down;
    x += choose_part(chosen[0], two_columns ? chosen[1] : 0.0f, r);
  }
  *column = x;
  *row = y;
  *base = first;
}

}  // namespace skytree
