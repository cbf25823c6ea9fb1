// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/block_radiance.h"

namespace skytree {

std::vector<double> mean_row_weights(int width, int height, Statistics statistics) {
  return statistics == Statistics::PIXELS ? std::vector<double>(height, 1.0)
                                          : row_solid_angles(width, height);
}

std::array<double, 3> block_mean(const LatLongImage& image, const TexelRect& rect,
                                 const std::vector<double>& row_weights) {
  std::array<double, 3> sum = {0, 0, 0};
  double weight = 0;
  for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
    const float* row = image.texels + 3 * (int64_t)y * image.width;
    for (int x = rect.lo[0]; x < rect.hi[0]; ++x) {
      const float* t = row + 3 * (int64_t)x;
      for (int c = 0; c < 3; ++c) sum[c] += row_weights[y] * usable_radiance(t[c]);
      weight += row_weights[y];
    }
  }
  for (double& component : sum) component = weight > 0 ? component / weight : 0.0;
  return sum;
}

void fill_block(const TexelRect& rect, const std::array<float, 3>& color, int width, float* out) {
  for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
    float* row = out + 3 * (int64_t)y * width;
    for (int x = rect.lo[0]; x < rect.hi[0]; ++x) {
      for (int c = 0; c < 3; ++c) row[3 * (int64_t)x + c] = color[c];
    }
  }
}

}  // namespace skytree
