// SPDX-License-Identifier: GPL-3.0-or-later
// Every plane of a block is a candidate, yet few are evaluated: first those on tile borders, whose
// sums cost two table look-ups. Between two borders the score is bounded, because it is convex in
// (n1, S1) or (n1, Q1) jointly (x^2/n and -sqrt(n x) are), so that its maximum over the box that
// both can be in lies in a corner; only the tiles whose bound exceeds the best score so far are
// looked at plane by plane.
#include "src/split_criterion.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace skytree {
namespace {

// n is the solid angle, q the quantity of the first and the second part.

struct PooledVariance {
  static constexpr Quantity kQuantity = Quantity::POWER;
  static double of(const Moments& moments) { return moments.power; }
  static double score(double n1, double q1, double n2, double q2) {
    return q1 * q1 / n1 + q2 * q2 / n2;
  }
};

struct MinVariance {
  static constexpr Quantity kQuantity = Quantity::SQUARE;
  static double of(const Moments& moments) { return moments.square; }
  static double score(double n1, double q1, double n2, double q2) {
    return -(std::sqrt(n1 * q1) + std::sqrt(n2 * q2));
  }
};

template <typename Criterion>
class SplitSearch {
 public:
  SplitSearch(const ImageStatistics& statistics, const TexelRect& rect)
      : statistics_(statistics), rect_(rect), solid_angle_(statistics.solid_angle(rect)) {}

  Split run() {
    search_axis(0);
    search_axis(1);
    if (best_.axis >= 0) {
      TexelRect first = rect_, second = rect_;
      first.hi[best_.axis] = second.lo[best_.axis] = best_.position;
      best_.first = statistics_.sum(first);
      best_.second = statistics_.sum(second);
    }
    return best_;
  }

 private:
  double solid_angle_before(int axis, int32_t position) const {
    TexelRect part = rect_;
    part.hi[axis] = position;
    return statistics_.solid_angle(part);
  }

  void consider(int axis, int32_t position, double before, double after) {
    const double n = solid_angle_before(axis, position);
    const double score = Criterion::score(n, before, solid_angle_ - n, after);
    const bool better = best_.axis < 0 || score > best_.score ||
                        (score == best_.score && axis == best_.axis && position < best_.position);
    if (better) {
      best_.axis = axis;
      best_.position = position;
      best_.score = score;
    }
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
    before_.assign(tiles + 1, 0.0);
    after_.assign(tiles + 1, 0.0);
    for (int i = 0; i < tiles; ++i) {
      TexelRect part = rect_;
      part.lo[axis] = cuts_[i];
      part.hi[axis] = cuts_[i + 1];
      const bool aligned = i > 0 && i + 1 < tiles;
      after_[i] = aligned ? statistics_.aligned_sum(part, axis, Criterion::kQuantity)
                          : Criterion::of(statistics_.sum(part));
      before_[i + 1] = before_[i] + after_[i];
    }
    for (int i = tiles - 1; i >= 0; --i) after_[i] += after_[i + 1];
    for (int i = 1; i < tiles; ++i) consider(axis, cuts_[i], before_[i], after_[i]);
    for (int i = 0; i < tiles; ++i) {
      if (cuts_[i + 1] - cuts_[i] >= 2 && may_improve(axis, i)) search_tile(axis, i);
    }
  }

  bool may_improve(int axis, int tile) const {
    double bound = -INFINITY;
    for (int32_t position : {cuts_[tile] + 1, cuts_[tile + 1] - 1}) {
      const double n = solid_angle_before(axis, position);
      for (int end = tile; end <= tile + 1; ++end) {
        bound = std::max(bound, Criterion::score(n, before_[end], solid_angle_ - n, after_[end]));
      }
    }
    return may_win(bound);
  }

  /// With a margin for rounding of single-precision sums.
  bool may_win(double bound) const {
    return best_.axis < 0 || bound + 1e-6 * std::abs(bound) >= best_.score;
  }

  /// Between the tile's borders only the rim of the slices is unknown before the image is read, and
  /// of that the sum is known: it lies somewhere between all before and all behind a plane.
  void search_tile(int axis, int tile) {
    TexelRect part = rect_;
    part.lo[axis] = cuts_[tile];
    part.hi[axis] = cuts_[tile + 1];
    const int count = part.size(axis);
    double slices[ImageStatistics::kTile];
    statistics_.inner_slices(part, axis, Criterion::kQuantity, slices);
    double inner = 0;
    for (int i = 0; i < count; ++i) inner += slices[i];
    const double rim = std::max(before_[tile + 1] - before_[tile] - inner, 0.0);
    bool worth_reading = false;
    double before = before_[tile], after = after_[tile + 1] + inner;
    for (int i = 1; i < count; ++i) {
      before += slices[i - 1];
      after = std::max(after - slices[i - 1], after_[tile + 1]);
      const double n = solid_angle_before(axis, cuts_[tile] + i);
      worth_reading |= may_win(Criterion::score(n, before, solid_angle_ - n, after + rim)) ||
                       may_win(Criterion::score(n, before + rim, solid_angle_ - n, after));
    }
    if (!worth_reading) return;
    statistics_.add_rim_slices(part, axis, Criterion::kQuantity, slices);
    double behind[ImageStatistics::kTile];
    after = after_[tile + 1];
    for (int i = count - 1; i > 0; --i) behind[i] = after += slices[i];
    before = before_[tile];
    for (int i = 1; i < count; ++i) {
      before += slices[i - 1];
      consider(axis, cuts_[tile] + i, before, behind[i]);
    }
  }

  const ImageStatistics& statistics_;
  const TexelRect rect_;
  const double solid_angle_;
  Split best_;
  std::vector<int32_t> cuts_;
  std::vector<double> before_, after_;  // of each cut
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
