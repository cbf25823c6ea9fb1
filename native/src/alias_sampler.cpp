// SPDX-License-Identifier: GPL-3.0-or-later
// Vose, "A Linear Algorithm for Generating Random Numbers with a Given Distribution", IEEE TSE
// 17(9), 1991; with two cursors over the table in place of his two lists, so that nothing else is
// allocated.
#include "src/alias_sampler.h"

#include <numeric>

#include "src/stopwatch.h"
#include "src/texel_weights.h"

namespace skytree {
namespace {

// Of all samples this share is spread evenly over the texels: no texel with radiance is lost to
// rounding.
constexpr double kEvenShare = 1e-3;

}  // namespace

AliasSampler::AliasSampler(const LatLongImage& image, int threads)
    : width_(image.width), height_(image.height) {
  const Stopwatch stopwatch;
  check_image(image);
  const int64_t count = (int64_t)width_ * height_;
  rows_ = make_row_warps(width_, height_);
  entries_ = LargeArray<AliasEntry>(count);
  const std::vector<double> solid_angles = row_solid_angles(width_, height_);

  ThreadTeam team(threads);
  std::vector<double> sums(height_);
  bad_texels_ = for_texel_weights(image, team, [&](int, int y, const float* weights) {
    const float solid_angle = (float)solid_angles[y];
    AliasEntry* row = entries_.data() + (int64_t)y * width_;
    double sum = 0;
    for (int x = 0; x < width_; ++x) {
      row[x].threshold = weights[x] * solid_angle;
      sum += row[x].threshold;
    }
    sums[y] = sum;
  });
  const double total = std::accumulate(sums.begin(), sums.end(), 0.0);

  // threshold: from weight to probability times count.
  const double scale = total > 0 ? (1.0 - kEvenShare) * (double)count / total : 0.0;
  team.run_chunks(height_, 16, [&](int, int first, int last) {
    for (int y = first; y < last; ++y) {
      const double even =
          (total > 0 ? kEvenShare : 1.0) * solid_angles[y] * (double)count * kInvFourPi;
      const float to_pdf = (float)(1.0 / (solid_angles[y] * (double)count));
      AliasEntry* row = entries_.data() + (int64_t)y * width_;
      for (int x = 0; x < width_; ++x) {
        row[x].threshold = (float)(row[x].threshold * scale + even);
        row[x].alias = (uint32_t)(row + x - entries_.data());
        row[x].pdf = row[x].threshold * to_pdf;
      }
    }
  });

  // `small` walks over entries below 1, `large` over those from 1 on. A large one that has given so
  // much that it fell below 1 is filled at once if `small` has passed it, else when `small`
  // arrives. What a large one has left is kept in double: a sun gives a million times, and float
  // would lose each gift's last digits.
  int64_t large = -1;
  double left = 0;
  const auto next_large = [&] {
    do ++large;
    while (large < count && entries_[large].threshold < 1.0f);
    left = large < count ? entries_[large].threshold : 0.0;
  };
  next_large();
  for (int64_t small = 0; small < count && large < count; ++small) {
    if (small == large || entries_[small].threshold >= 1.0f) continue;
    int64_t fill = small;
    while (large < count) {
      entries_[fill].alias = (uint32_t)large;
      left -= 1.0 - entries_[fill].threshold;
      if (left >= 1.0) break;
      const int64_t emptied = large;
      entries_[emptied].threshold = (float)left;
      next_large();
      if (emptied > small) break;
      fill = emptied;
    }
  }
  // Beyond rounding nothing is left to give; entries without an alias are their own.
  for (int64_t i = large; i < count; ++i) {
    if (entries_[i].threshold > 1.0f) entries_[i].threshold = 1.0f;
  }
  build_seconds_ = stopwatch.seconds();
}

EnvSamplerView AliasSampler::view() const {
  EnvSamplerView view;
  view.type = EnvSamplerType::ALIAS;
  view.alias = {entries_.data(), rows_.data(), width_, height_};
  return view;
}

size_t AliasSampler::nbytes() const {
  return (size_t)width_ * height_ * sizeof(AliasEntry) + rows_.size() * sizeof(RowWarp);
}

}  // namespace skytree
