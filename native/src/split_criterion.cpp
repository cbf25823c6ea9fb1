// SPDX-License-Identifier: GPL-3.0-or-later
// Every plane of a block is a candidate, yet few are evaluated: first those on tile borders, whose
// sums cost two table look-ups. Between two borders the score is bounded, because it is convex in
// (n1, S1) or (n1, Q1) jointly (x^2/n and -sqrt(n x) are), so that its maximum over the box that
// both can be in lies in a corner; only the tiles whose bound exceeds the best score so far are
// looked at plane by plane.
#include "src/split_criterion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace skytree {
namespace {

struct PooledVariance {
  static double score(double n1, const Moments& first, double n2, const Moments& second) {
    return first.power * first.power / n1 + second.power * second.power / n2;
  }
};

struct MinVariance {
  static double score(double n1, const Moments& first, double n2, const Moments& second) {
    return -(std::sqrt(n1 * first.square) + std::sqrt(n2 * second.square));
  }
};

template <typename Criterion>
class SplitSearch {
 public:
  SplitSearch(const ImageStatistics& statistics, const TexelRect& rect)
      : statistics_(statistics), rect_(rect) {}

  Split run() {
    search_axis(0);
    search_axis(1);
    return best_;
  }

 private:
  double solid_angle_before(int axis, int32_t position) const {
    TexelRect part = rect_;
    part.hi[axis] = position;
    return statistics_.solid_angle(part);
  }

  void consider(int axis, int32_t position, const Moments& first, const Moments& second) {
    const double n1 = solid_angle_before(axis, position);
    const double n2 = statistics_.solid_angle(rect_) - n1;
    const double score = Criterion::score(n1, first, n2, second);
    const bool better = best_.axis < 0 || score > best_.score ||
                        (score == best_.score && axis == best_.axis && position < best_.position);
    if (better) best_ = {axis, position, score, first, second};
  }

  void search_axis(int axis) {
    const int32_t lo = rect_.lo[axis], hi = rect_.hi[axis];
    if (hi - lo < 2) return;
    cuts_.assign(1, lo);
    for (int b = statistics_.first_border_from(lo + 1); statistics_.border(axis, b) < hi; ++b) {
      cuts_.push_back(statistics_.border(axis, b));
    }
    cuts_.push_back(hi);
    const int tiles = (int)cuts_.size() - 1;
    before_.assign(tiles + 1, Moments{});
    after_.assign(tiles + 1, Moments{});
    for (int i = 0; i < tiles; ++i) {
      TexelRect part = rect_;
      part.lo[axis] = cuts_[i];
      part.hi[axis] = cuts_[i + 1];
      const bool aligned = i > 0 && i + 1 < tiles;
      after_[i] = aligned ? statistics_.aligned_sum(part, axis) : statistics_.sum(part);
      before_[i + 1] = before_[i] + after_[i];
    }
    for (int i = tiles - 1; i >= 0; --i) after_[i] = after_[i] + after_[i + 1];
    for (int i = 1; i < tiles; ++i) consider(axis, cuts_[i], before_[i], after_[i]);
    for (int i = 0; i < tiles; ++i) {
      if (cuts_[i + 1] - cuts_[i] >= 2 && may_improve(axis, i)) search_tile(axis, i);
    }
  }

  bool may_improve(int axis, int tile) const {
    if (best_.axis < 0) return true;
    const double total = statistics_.solid_angle(rect_);
    const double n[2] = {solid_angle_before(axis, cuts_[tile] + 1),
                         solid_angle_before(axis, cuts_[tile + 1] - 1)};
    double bound = -INFINITY;
    for (int end = tile; end <= tile + 1; ++end) {
      for (double n1 : n) {
        bound = std::max(bound, Criterion::score(n1, before_[end], total - n1, after_[end]));
      }
    }
    return bound + 1e-6 * std::abs(bound) >= best_.score;  // the margin covers rounding of sums
  }

  void search_tile(int axis, int tile) {
    TexelRect part = rect_;
    part.lo[axis] = cuts_[tile];
    part.hi[axis] = cuts_[tile + 1];
    const int count = part.size(axis);
    std::array<Moments, ImageStatistics::kTile> slices, after;
    statistics_.slices(part, axis, slices.data());
    Moments sum = after_[tile + 1];
    for (int i = count - 1; i > 0; --i) after[i] = sum = sum + slices[i];
    sum = before_[tile];
    for (int i = 1; i < count; ++i) {
      sum = sum + slices[i - 1];
      consider(axis, part.lo[axis] + i, sum, after[i]);
    }
  }

  const ImageStatistics& statistics_;
  const TexelRect rect_;
  Split best_;
  std::vector<int32_t> cuts_;
  std::vector<Moments> before_, after_;  // of each cut
};

}  // namespace

double squared_error(const Moments& moments, double solid_angle) {
  const double error = moments.square - moments.power * moments.power / solid_angle;
  return error > kVariationFloor * moments.square ? error : 0.0;
}

Split find_split(const ImageStatistics& statistics, const TexelRect& rect,
                 SplitCriterion criterion) {
  if (criterion == SplitCriterion::MIN_VARIANCE) {
    return SplitSearch<MinVariance>(statistics, rect).run();
  }
  return SplitSearch<PooledVariance>(statistics, rect).run();
}

}  // namespace skytree
