// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/median_cut.h"

#include <cmath>

namespace skytree {

Split find_median_cut(const ImageStatistics& statistics, const TexelRect& rect, CornerSums* known) {
  // Sides in radians; meridians draw together towards the poles.
  const int width = statistics.extent(0), height = statistics.extent(1);
  const double middle = 0.5 * (rect.lo[1] + rect.hi[1]);
  const double across = 2.0 * M_PI * rect.size(0) / width * std::sin(M_PI * middle / height);
  const double down = M_PI * rect.size(1) / height;
  Split split;
  if (rect.area() < 2) return split;
  split.axis = (across >= down && rect.size(0) > 1) || rect.size(1) < 2 ? 0 : 1;

  const double half = 0.5 * statistics.sum(rect, known).power;
  const auto before = [&](int32_t position) {
    TexelRect part = rect;
    part.hi[split.axis] = position;
    return statistics.sum(part, known).power;
  };
  int32_t lo = rect.lo[split.axis] + 1, hi = rect.hi[split.axis] - 1;
  while (lo < hi) {
    const int32_t at = lo + (hi - lo) / 2;
    if (before(at) < half) {
      lo = at + 1;
    } else {
      hi = at;
    }
  }
  // The first plane with at least half before it, or its neighbour.
  if (lo > rect.lo[split.axis] + 1 &&
      std::abs(before(lo - 1) - half) < std::abs(before(lo) - half)) {
    --lo;
  }
  split.position = lo;
  TexelRect first = rect, second = rect;
  first.hi[split.axis] = second.lo[split.axis] = lo;
  split.first = statistics.sum(first, known);
  split.second = statistics.sum(second, known);
  return split;
}

std::vector<PointLight> make_point_lights(const LatLongImage& image,
                                          const std::vector<TexelRect>& regions) {
  const std::vector<double> solid_angles = row_solid_angles(image.width, image.height);
  std::vector<PointLight> lights;
  for (const TexelRect& rect : regions) {
    double power[3] = {}, place[3] = {}, middle[3] = {};
    for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
      for (int x = rect.lo[0]; x < rect.hi[0]; ++x) {
        const float* t = image.texels + 3 * ((int64_t)y * image.width + x);
        const Vec3 direction = latlong_direction(((float)x + 0.5f) / (float)image.width,
                                                 ((float)y + 0.5f) / (float)image.height);
        const double weight = solid_angles[y] * texel_luminance(t);
        const float axes[3] = {direction.x, direction.y, direction.z};
        for (int c = 0; c < 3; ++c) {
          power[c] += solid_angles[y] * usable_radiance(t[c]);
          place[c] += weight * axes[c];
          middle[c] += solid_angles[y] * axes[c];
        }
      }
    }
    const auto as_vec = [](const double* v) { return Vec3{(float)v[0], (float)v[1], (float)v[2]}; };
    const double lit = place[0] * place[0] + place[1] * place[1] + place[2] * place[2];
    const Vec3 centre =
        latlong_direction(0.5f * (float)(rect.lo[0] + rect.hi[0]) / (float)image.width,
                          0.5f * (float)(rect.lo[1] + rect.hi[1]) / (float)image.height);
    const Vec3 direction = as_vec(lit > 0 ? place : middle);
    // The whole sphere's centroid is no direction.
    lights.push_back({length(direction) > 1e-12f ? normalize(direction) : centre, as_vec(power)});
  }
  return lights;
}

}  // namespace skytree
