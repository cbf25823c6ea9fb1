// SPDX-License-Identifier: GPL-3.0-or-later
// M. Vose, "A Linear Algorithm for Generating Random Numbers with a Given Distribution", IEEE TSE
// 17(9), 1991, as a sweep that several threads take parts of, after L. Hubschle-Schneider and P.
// Sanders, "Parallel Weighted Random Sampling", ESA 2019: entries below 1 ("small") are filled up
// in turn by the entries from 1 on ("large"), and a large one that falls below 1 by what it gave is
// filled by the next. Who fills whom follows from two running sums alone, of what the small ones
// lack and of what the large ones have to spare, so that a sweep may start anywhere.
//
// The table is the largest thing in sight: weights are computed from the luminance each time they
// are needed, as that is cheaper than keeping them, and every entry is written once.
#include "src/alias_sampler.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "src/clones.h"
#include "src/moment_rows.h"
#include "src/stopwatch.h"
#include "src/thread_team.h"

namespace skytree {
namespace {

// Of all samples this share is spread evenly over the texels: no texel with radiance is lost to
// rounding.
constexpr double kEvenShare = 1e-3;

/// Rows that are swept together.
constexpr int kSweptRows = 16;

/// What an entry lacks or has to spare, in whole units: sums are exact, whoever adds up what.
constexpr float kUnits = 0x1p30f;

inline int32_t lack_of(float weight) { return (int32_t)((1.0f - weight) * kUnits); }
inline int64_t spare_of(float weight) { return (int64_t)((weight - 1.0f) * kUnits); }

/// In an order that does not depend on the processor.
SKY_CLONES double sum_of(const float* __restrict values, int count) {
  double lanes[8] = {};
  int x = 0;
  for (; x + 8 <= count; x += 8) {
    for (int lane = 0; lane < 8; ++lane) lanes[lane] += values[x + lane];
  }
  for (; x < count; ++x) lanes[0] += values[x];
  return ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) +
         ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]));
}

SKY_CLONES void scale(float* __restrict values, int count, float factor, float offset) {
  for (int x = 0; x < count; ++x) values[x] = values[x] * factor + offset;
}

SKY_CLONES int64_t sum_lacks(const float* __restrict weights, int count) {
  int64_t sum = 0;
  for (int x = 0; x < count; ++x) sum += lack_of(std::min(weights[x], 1.0f));
  return sum;
}

/// spare_of in parts that 32 bits hold, as few processors convert more of several floats at once.
SKY_CLONES int64_t sum_spares(const float* __restrict weights, int count) {
  int64_t high = 0, middle = 0, low = 0;
  for (int x = 0; x < count; ++x) {
    const float spare = std::max(weights[x], 1.0f) - 1.0f;
    const int32_t h = (int32_t)(spare * 0x1p-8f);
    const float rest = spare - (float)h * 0x1p8f;
    const int32_t m = (int32_t)rest;
    high += h;
    middle += m;
    low += (int32_t)((rest - (float)m) * kUnits);
  }
  return ((high << 8) + middle) * (int64_t)kUnits + low;
}

/// A texel's weight is its probability times their number.
class WeightRows {
 public:
  WeightRows(const LuminancePlane& plane, ThreadTeam& team) : plane_(plane) {
    const int width = plane.width(), height = plane.height();
    const double count = (double)width * height;
    const std::vector<double> solid_angles = row_solid_angles(width, height);
    std::vector<double> sums(height);
    team.run_chunks(height, kSweptRows, [&](int, int first, int last) {
      std::vector<float> values(width);
      for (int y = first; y < last; ++y) {
        interpolate(y, values.data());
        sums[y] = solid_angles[y] * sum_of(values.data(), width);
      }
    });
    const double total = std::accumulate(sums.begin(), sums.end(), 0.0);
    // Of a map that is hardly lit or blinding, factors of weights would not fit a float.
    const int exponent = total > 0 ? std::clamp(-std::ilogb(total), -100, 100) : 0;
    unit_ = std::ldexp(1.0f, exponent);
    for (double solid_angle : solid_angles) {
      const double texels = solid_angle * count;
      rows_.push_back(
          {(float)(total > 0 ? (1.0 - kEvenShare) * std::ldexp(texels, -exponent) / total : 0.0),
           (float)((total > 0 ? kEvenShare : 1.0) * texels * kInvFourPi), (float)(1.0 / texels)});
    }
  }

  int width() const { return plane_.width(); }
  int height() const { return plane_.height(); }
  void read(int y, float* out) const {
    interpolate(y, out);
    scale(out, width(), rows_[y].factor, rows_[y].even);
  }
  /// Per steradian, of a weight of 1.
  float pdf(int y) const { return rows_[y].pdf; }

 private:
  struct Row {
    float factor, even, pdf;
  };

  /// The mean over each texel of what the renderer looks up, in units.
  void interpolate(int y, float* out) const {
    interpolated_power(plane_.row(y - 1), plane_.row(y), plane_.row(y + 1), width(), unit_, out);
  }

  const LuminancePlane& plane_;
  float unit_ = 1.0f;
  std::vector<Row> rows_;
};

/// The entries of a row that are large, or those that are small.
struct Picked {
  explicit Picked(int width) : columns(width + 1), weights(width + 1) {}

  /// Without a branch, as nobody can tell them apart in advance.
  void pick(const std::vector<float>& row, bool large) {
    const float* __restrict from = row.data();
    int32_t* __restrict column = columns.data();
    float* __restrict weight = weights.data();
    int picked = 0;
    for (int x = 0; x < (int)row.size(); ++x) {
      column[picked] = x;
      weight[picked] = from[x];
      picked += (from[x] >= 1.0f) == large;
    }
    count = picked;
  }

  std::vector<int32_t> columns;
  std::vector<float> weights;
  int count = 0;
};

/// The large entries, a row at a time.
class LargeRows {
 public:
  /// From the row with the first entry that reaches `wanted`. `before`: what the entries above each
  /// row have to spare.
  LargeRows(const WeightRows& weights, const std::vector<int64_t>& before, int64_t wanted)
      : weights_(weights), row_(weights.width()), picked_(weights.width()) {
    const auto row = std::lower_bound(before.begin() + 1, before.end(), wanted) - 1;
    y_ = (int)(row - before.begin()) - 1;
    spared_ = *row;
    next();
  }

  /// Goes to the next row that has any; whether there is one.
  bool next() {
    picked_.count = 0;
    while (picked_.count == 0 && ++y_ < weights_.height()) {
      weights_.read(y_, row_.data());
      picked_.pick(row_, true);
    }
    return picked_.count > 0;
  }

  const Picked& picked() const { return picked_; }
  int y() const { return y_; }
  /// What those above the first row have to spare.
  int64_t spared() const { return spared_; }

 private:
  const WeightRows& weights_;
  std::vector<float> row_;
  Picked picked_;
  int y_;
  int64_t spared_;
};

AliasEntry small_entry(float weight, uint32_t alias) {
  AliasEntry entry;
  entry.weight = weight;
  entry.alias = alias;
  return entry;
}

AliasEntry large_entry(float weight, float threshold) {
  AliasEntry entry;
  entry.weight = weight;
  entry.threshold = threshold;
  return entry;
}

/// Fills up small entries by large ones, row after row. A large entry is emptied by the first small
/// one at which more lacks than it and those before have to spare; whoever sweeps that one writes
/// both.
class Sweep {
 public:
  /// `lacking`: what the small entries above the first row lack.
  Sweep(const WeightRows& weights, const std::vector<int64_t>& spares, int64_t lacking,
        AliasEntry* entries)
      : weights_(weights),
        entries_(entries),
        large_(weights, spares, lacking),
        lacking_(lacking),
        spared_(large_.spared()) {
    int at = 0;
    for (; large_.picked().count > 0; large_.next(), at = 0) {
      const Picked& picked = large_.picked();
      while (at < picked.count && (spared_ += spare_of(picked.weights[at])) < lacking) ++at;
      if (at < picked.count) break;
    }
    at_ = at;
  }

  void fill(int y, const Picked& small) {
    const uint32_t start = first_of(y);
    const int32_t* __restrict columns = small.columns.data();
    const float* __restrict values = small.weights.data();
    AliasEntry* const row = entries_ + start;
    int i = 0;
    while (large_.picked().count > 0 && (i < small.count || spared_ < lacking_)) {
      i = fill_by_row(small, i, row);
    }
    // Nobody is left to fill them: the sums of all that lacks and of all that there is to spare
    // differ by rounding.
    for (; i < small.count; ++i) {
      row[columns[i]] = small_entry(values[i], start + (uint32_t)columns[i]);
    }
  }

 private:
  uint32_t first_of(int y) const { return (uint32_t)y * (uint32_t)weights_.width(); }

  /// From the i-th small one on, until they or the large ones of a row are through; returns the
  /// next. All that changes is in local variables, as stores to the table could be stores to what
  /// the members point to.
  int fill_by_row(const Picked& small, int i, AliasEntry* row) {
    const Picked& large = large_.picked();
    const int32_t* __restrict columns = large.columns.data();
    const float* __restrict weights = large.weights.data();
    const int32_t* __restrict small_columns = small.columns.data();
    const float* __restrict small_weights = small.weights.data();
    const uint32_t start = first_of(large_.y());
    AliasEntry* const large_row = entries_ + start;
    const int count = large.count, small_count = small.count;
    int64_t lacking = lacking_, spared = spared_;
    int at = at_;
    while (at < count) {
      if (lacking <= spared) {
        if (i == small_count) break;
        const float weight = small_weights[i];
        row[small_columns[i]] = small_entry(weight, start + (uint32_t)columns[at]);
        lacking += lack_of(weight);
        ++i;
        continue;
      }
      const float threshold = 1.0f - (float)(lacking - spared) * (1.0f / kUnits);
      large_row[columns[at]] = large_entry(weights[at], threshold);
      if (++at < count) {
        spared += spare_of(weights[at]);
      } else if (large_.next()) {
        spared += spare_of(large.weights[0]);
        at = 0;
        break;
      }
    }
    at_ = at;
    lacking_ = lacking;
    spared_ = spared;
    return i;
  }

  const WeightRows& weights_;
  AliasEntry* const entries_;
  LargeRows large_;
  int at_ = 0;  // of the large row
  int64_t lacking_, spared_;
};

}  // namespace

AliasSampler::AliasSampler(const LatLongImage& image, int threads) {
  const Stopwatch stopwatch;
  check_image(image);
  ThreadTeam team(threads);
  build(LuminancePlane(image, team, [](double) {}), team);
  build_seconds_ = stopwatch.seconds();
}

AliasSampler::AliasSampler(MapStatistics& map, int threads) {
  const Stopwatch stopwatch;
  ThreadTeam team(threads);
  build(*map.luminance(team), team);
  build_seconds_ = stopwatch.seconds();
}

void AliasSampler::build(const LuminancePlane& plane, ThreadTeam& team) {
  width_ = plane.width();
  height_ = plane.height();
  bad_texels_ = plane.bad_texels();
  entries_ = LargeArray<AliasEntry>((size_t)width_ * height_);

  const WeightRows weights(plane, team);
  std::vector<int64_t> lacks(height_ + 1), spares(height_ + 1);  // of the rows above
  std::vector<int> first_large(height_);                         // width_: none
  team.run_chunks(height_, kSweptRows, [&](int, int first, int last) {
    std::vector<float> row(width_);
    for (int y = first; y < last; ++y) {
      weights.read(y, row.data());
      lacks[y + 1] = sum_lacks(row.data(), width_);
      spares[y + 1] = sum_spares(row.data(), width_);
      first_large[y] =
          (int)(std::find_if(row.begin(), row.end(), [](float w) { return w >= 1.0f; }) -
                row.begin());
    }
  });
  std::partial_sum(lacks.begin(), lacks.end(), lacks.begin());
  std::partial_sum(spares.begin(), spares.end(), spares.begin());
  const std::vector<RowWarp> warps = make_row_warps(width_, height_);
  rows_.resize(height_);
  uint32_t next_large = (uint32_t)width_ * (uint32_t)height_;
  for (int y = height_; y-- > 0;) {
    rows_[y] = {warps[y], weights.pdf(y), next_large};
    if (first_large[y] < width_)
      next_large = (uint32_t)y * (uint32_t)width_ + (uint32_t)first_large[y];
  }

  team.run_chunks(height_, kSweptRows, [&](int, int first, int last) {
    Sweep sweep(weights, spares, lacks[first], entries_.data());
    std::vector<float> row(width_);
    Picked picked(width_);
    for (int y = first; y < last; ++y) {
      weights.read(y, row.data());
      picked.pick(row, false);
      sweep.fill(y, picked);
      // Large ones that nobody empties.
      if (spares[y + 1] < lacks[height_]) continue;
      picked.pick(row, true);
      int64_t spared = spares[y];
      const uint32_t start = (uint32_t)y * (uint32_t)width_;
      for (int i = 0; i < picked.count; ++i) {
        spared += spare_of(picked.weights[i]);
        if (spared < lacks[height_]) continue;
        entries_[start + (uint32_t)picked.columns[i]] = large_entry(picked.weights[i], 1.0f);
      }
    }
  });
}

EnvSamplerView AliasSampler::view() const {
  EnvSamplerView view;
  view.type = EnvSamplerType::ALIAS;
  view.alias = {entries_.data(), rows_.data(), width_, height_};
  return view;
}

size_t AliasSampler::nbytes() const {
  return (size_t)width_ * height_ * sizeof(AliasEntry) + rows_.size() * sizeof(AliasRow);
}

}  // namespace skytree
