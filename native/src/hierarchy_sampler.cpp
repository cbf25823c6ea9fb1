// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/hierarchy_sampler.h"

#include <algorithm>
#include <numeric>

#include "src/stopwatch.h"
#include "src/texel_weights.h"

namespace skytree {
namespace {

// Of all samples this share is spread evenly over the sphere: no texel with radiance is lost to
// rounding.
constexpr double kEvenShare = 1e-3;

}  // namespace

HierarchySampler::HierarchySampler(const LatLongImage& image, int threads)
    : width_(image.width), height_(image.height) {
  const Stopwatch stopwatch;
  check_image(image);
  while (halved(width_, level_count_ - 1) > 1 || halved(height_, level_count_ - 1) > 1) {
    ++level_count_;
  }
  rows_ = make_row_warps(width_, height_);
  int64_t base = hierarchy_base({nullptr, nullptr, width_, height_, level_count_});
  weights_ = LargeArray<float>(base + (int64_t)width_ * height_);
  float* texels = weights_.data() + base;
  const std::vector<double> solid_angles = row_solid_angles(width_, height_);

  ThreadTeam team(threads);
  std::vector<double> sums(height_);
  bad_texels_ = for_texel_weights(image, team, [&](int, int y, const float* weights) {
    float* row = texels + (int64_t)y * width_;
    double sum = 0;
    for (int x = 0; x < width_; ++x) sum += row[x] = weights[x];
    sums[y] = sum * solid_angles[y];
  });
  const double total = std::accumulate(sums.begin(), sums.end(), 0.0);
  const double share = total > 0 ? kEvenShare : 1.0;
  team.run_chunks(height_, 16, [&](int, int first, int last) {
    for (int y = first; y < last; ++y) {
      const double scale = total > 0 ? (1.0 - kEvenShare) * solid_angles[y] / total : 0.0;
      const double even = share * solid_angles[y] * kInvFourPi;
      float* row = texels + (int64_t)y * width_;
      for (int x = 0; x < width_; ++x) row[x] = (float)(row[x] * scale + even);
    }
  });

  for (int level = 1; level < level_count_; ++level) {
    const int fine_width = halved(width_, level - 1), fine_height = halved(height_, level - 1);
    const int width = halved(width_, level), height = halved(height_, level);
    const float* fine = weights_.data() + base;
    base -= (int64_t)width * height;
    float* coarse = weights_.data() + base;
    team.run_chunks(height, 16, [&](int, int first, int last) {
      for (int y = first; y < last; ++y) {
        for (int x = 0; x < width; ++x) {
          double sum = 0;
          for (int j = 2 * y; j < std::min(2 * y + 2, fine_height); ++j) {
            for (int i = 2 * x; i < std::min(2 * x + 2, fine_width); ++i) {
              sum += fine[(int64_t)j * fine_width + i];
            }
          }
          coarse[(int64_t)y * width + x] = (float)sum;
        }
      }
    });
  }
  build_seconds_ = stopwatch.seconds();
}

EnvSamplerView HierarchySampler::view() const {
  EnvSamplerView view;
  view.type = EnvSamplerType::HIERARCHY;
  view.hierarchy = {weights_.data(), rows_.data(), width_, height_, level_count_};
  return view;
}

size_t HierarchySampler::nbytes() const {
  return weights_.nbytes() + rows_.size() * sizeof(RowWarp);
}

}  // namespace skytree
