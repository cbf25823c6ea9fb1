// SPDX-License-Identifier: GPL-3.0-or-later
// M. Vose, "A Linear Algorithm for Generating Random Numbers with a Given Distribution", IEEE TSE
// 17(9), 1991, as a sweep that several threads take parts of, after L. Hubschle-Schneider and P.
// Sanders, "Parallel Weighted Random Sampling", ESA 2019: entries below 1 ("small") are filled up
// in turn by the entries from 1 on ("large"), and a large one that falls below 1 by what it gave is
// filled by the next. Who fills whom follows from two running sums alone, of what the small ones
// lack and of what the large ones have to spare, so that a sweep may start anywhere.
#include "src/alias_sampler.h"

#include <algorithm>
#include <numeric>

#include "src/stopwatch.h"
#include "src/texel_weights.h"

namespace skytree {
namespace {

// Of all samples this share is spread evenly over the texels: no texel with radiance is lost to
// rounding.
constexpr double kEvenShare = 1e-3;

/// Rows that are swept together, whatever the number of threads: sums must not depend on that.
constexpr int kSweptRows = 16;

/// What the entries of a table lack, or have to spare, before each part of rows and at the end of
/// all. A running sum is that before a part and the one inside it: so it never falls from one part
/// to the next.
using PartSums = std::vector<double>;

/// Some entries of a row, by column.
struct Picked {
  explicit Picked(int width) : columns(width + 1), weights(width + 1) {}

  /// Those from 1 on, or those below. Without a branch, as nobody can tell them apart in advance.
  void pick(const AliasEntry* row, float from_pdf, int width, bool large) {
    count = 0;
    for (int x = 0; x < width; ++x) {
      const float weight = row[x].pdf * from_pdf;
      columns[count] = x;
      weights[count] = weight;
      count += (weight >= 1.0f) == large;
    }
  }

  std::vector<int32_t> columns;
  std::vector<float> weights;
  int count = 0;
};

/// The large entries in turn, each with what it and those before it have to spare.
class LargeEntries {
 public:
  /// From the first that reaches `wanted`.
  LargeEntries(AliasEntry* entries, const std::vector<float>& from_pdf, int width,
               const PartSums& before, double wanted)
      : entries_(entries), from_pdf_(from_pdf), width_(width), before_(before), row_(width) {
    const auto part = std::lower_bound(before.begin() + 1, before.end(), wanted);
    y_ = (int)(part - before.begin() - 1) * kSweptRows - 1;
    next();
    while (!at_end() && spared_ < wanted) next();
  }

  bool at_end() const { return y_ >= (int)from_pdf_.size(); }
  int64_t index() const { return (int64_t)y_ * width_ + row_.columns[at_]; }
  double spared() const { return spared_; }

  void next() {
    ++at_;
    while (at_ >= row_.count) {
      if (++y_ >= (int)from_pdf_.size()) return;
      if (y_ % kSweptRows == 0) inside_ = 0;
      row_.pick(entries_ + (int64_t)y_ * width_, from_pdf_[y_], width_, true);
      at_ = 0;
    }
    inside_ += (double)row_.weights[at_] - 1.0;
    spared_ = before_[y_ / kSweptRows] + inside_;
  }

 private:
  AliasEntry* const entries_;
  const std::vector<float>& from_pdf_;
  const int width_;
  const PartSums& before_;
  Picked row_;
  int y_, at_ = 0;
  double inside_ = 0, spared_ = 0;
};

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

  // From weight to pdf; an entry's probability times count is its pdf times from_pdf, here and in
  // the sweep, to the bit.
  const double scale = total > 0 ? (1.0 - kEvenShare) * (double)count / total : 0.0;
  const int parts = (height_ + kSweptRows - 1) / kSweptRows;
  std::vector<float> from_pdf(height_);
  PartSums lack(parts + 1), spare(parts + 1);
  team.run(parts, [&](int, int part) {
    std::vector<float> weights(width_);
    double lacking = 0, spared = 0;
    for (int y = part * kSweptRows; y < std::min((part + 1) * kSweptRows, height_); ++y) {
      const double even =
          (total > 0 ? kEvenShare : 1.0) * solid_angles[y] * (double)count * kInvFourPi;
      const float to_pdf = (float)(1.0 / (solid_angles[y] * (double)count));
      const float back = from_pdf[y] = (float)(solid_angles[y] * (double)count);
      AliasEntry* row = entries_.data() + (int64_t)y * width_;
      const uint32_t first = (uint32_t)(row - entries_.data());
      for (int x = 0; x < width_; ++x) {
        row[x].pdf = (float)(row[x].threshold * scale + even) * to_pdf;
        weights[x] = row[x].pdf * back;
        row[x].threshold = std::min(weights[x], 1.0f);
        row[x].alias = first + (uint32_t)x;
      }
      for (const float weight : weights) {
        lacking += std::max(1.0 - (double)weight, 0.0);
        spared += std::max((double)weight - 1.0, 0.0);
      }
    }
    lack[part + 1] = lacking;
    spare[part + 1] = spared;
  });
  std::partial_sum(lack.begin(), lack.end(), lack.begin());
  std::partial_sum(spare.begin(), spare.end(), spare.begin());

  // A large entry is emptied by the first small one at which more lacks than it and those before
  // have to spare; whoever sweeps that one writes to it. What nobody fills, beyond rounding, stays
  // its own.
  team.run(parts, [&](int, int part) {
    const double start = lack[part];
    LargeEntries large(entries_.data(), from_pdf, width_, spare, start);
    Picked small(width_);
    double inside = 0;
    for (int y = part * kSweptRows; y < std::min((part + 1) * kSweptRows, height_); ++y) {
      AliasEntry* row = entries_.data() + (int64_t)y * width_;
      small.pick(row, from_pdf[y], width_, false);
      for (int i = 0; i < small.count && !large.at_end(); ++i) {
        row[small.columns[i]].alias = (uint32_t)large.index();
        inside += 1.0 - (double)small.weights[i];
        while (large.spared() < start + inside) {
          AliasEntry& emptied = entries_[large.index()];
          emptied.threshold = (float)std::max(1.0 + (large.spared() - (start + inside)), 0.0);
          large.next();
          if (large.at_end()) break;
          emptied.alias = (uint32_t)large.index();
        }
      }
    }
  });
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
