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

#include "src/median_cut.h"
#include "src/split_scores.h"

namespace skytree {
namespace {

constexpr int kTile = ImageStatistics::kTile;

class SplitSearch {
 public:
  SplitSearch(const ImageStatistics& statistics, const TexelRect& rect, SplitCriterion criterion,
              CornerSums* known)
      : statistics_(statistics),
        known_(known),
        rect_(rect),
        solid_angle_(statistics.solid_angle(rect)),
        min_variance_(criterion == SplitCriterion::MIN_VARIANCE),
        quantity_(min_variance_ ? Quantity::SQUARE : Quantity::POWER) {}

  Split run() {
    if (min_variance_)
      unsplit_score_ = -std::sqrt(solid_angle_ * statistics_.sum(rect_, known_).square);
    search_axis(0);
    search_axis(1);
    if (best_.axis >= 0) {
      TexelRect first = rect_, second = rect_;
      first.hi[best_.axis] = second.lo[best_.axis] = best_.position;
      best_.first = statistics_.sum(first, known_);
      best_.second = statistics_.sum(second, known_);
    }
    return best_;
  }

 private:
  /// Planes with what lies before and behind them.
  struct Planes {
    int count = 0;
    double n1[kTile + 1], q1[kTile + 1], n2[kTile + 1], q2[kTile + 1], scores[kTile + 1];
  };

  void add_plane(int axis, int32_t position, double before, double behind, Planes* planes) const {
    TexelRect part = rect_;
    part.hi[axis] = position;
    const int i = planes->count++;
    planes->n1[i] = statistics_.solid_angle(part);
    planes->n2[i] = solid_angle_ - planes->n1[i];
    planes->q1[i] = before;
    planes->q2[i] = behind;
  }

  void score(Planes* planes) const {
    (min_variance_ ? min_variance_scores : pooled_variance_scores)(
        planes->n1, planes->q1, planes->n2, planes->q2, planes->count, planes->scores);
  }

  /// Takes the best of scored planes, the i-th of which is at `position(i)`.
  template <typename Position>
  void consider(int axis, const Planes& planes, const Position& position) {
    for (int i = 0; i < planes.count; ++i) {
      const double score = planes.scores[i];
      const bool better =
          best_.axis < 0 || score > best_.score ||
          (score == best_.score && axis == best_.axis && position(i) < best_.position);
      if (!better) continue;
      best_.axis = axis;
      best_.position = position(i);
      best_.score = score;
    }
  }

  /// Whether a score, or a bound on it, could be the best, with a margin for rounding of
  /// single-precision sums; with MIN_VARIANCE, whether by more than is worth looking for.
  bool may_win(const Planes& planes) const {
    const double gain = min_variance_ ? best_.score - unsplit_score_ : 0.0;
    const double needed = best_.score + kGainTolerance * std::max(gain, 0.0);
    bool wins = best_.axis < 0;
    for (int i = 0; i < planes.count; ++i) {
      wins |= planes.scores[i] + 1e-6 * std::abs(planes.scores[i]) >= needed;
    }
    return wins;
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
    behind_.assign(tiles + 1, 0.0);
    for (int i = 0; i < tiles; ++i) {
      TexelRect part = rect_;
      part.lo[axis] = cuts_[i];
      part.hi[axis] = cuts_[i + 1];
      const bool aligned = i > 0 && i + 1 < tiles;
      behind_[i] = aligned ? statistics_.aligned_sum(part, axis, quantity_)
                           : quantity(statistics_.sum(part, known_));
      before_[i + 1] = before_[i] + behind_[i];
    }
    for (int i = tiles - 1; i >= 0; --i) behind_[i] += behind_[i + 1];
    for (int first = 1; first < tiles; first += kTile) {
      Planes planes;
      for (int i = first; i < std::min(first + kTile, tiles); ++i) {
        add_plane(axis, cuts_[i], before_[i], behind_[i], &planes);
      }
      score(&planes);
      consider(axis, planes, [&](int i) { return cuts_[first + i]; });
    }
    for (int i = 0; i < tiles; ++i) {
      if (cuts_[i + 1] - cuts_[i] >= 2 && corners_may_win(axis, i)) search_tile(axis, i);
    }
  }

  double quantity(const Moments& moments) const {
    return min_variance_ ? moments.square : moments.power;
  }

  bool corners_may_win(int axis, int tile) const {
    Planes corners;
    for (int32_t position : {cuts_[tile] + 1, cuts_[tile + 1] - 1}) {
      add_plane(axis, position, before_[tile], behind_[tile], &corners);
      add_plane(axis, position, before_[tile + 1], behind_[tile + 1], &corners);
    }
    score(&corners);
    return may_win(corners);
  }

  /// Between the tile's borders only the rim of the slices is unknown before the image is read, and
  /// of that the sum is known: it lies somewhere between all before and all behind a plane.
  void search_tile(int axis, int tile) {
    TexelRect part = rect_;
    part.lo[axis] = cuts_[tile];
    part.hi[axis] = cuts_[tile + 1];
    const int count = part.size(axis);
    double slices[kTile];
    statistics_.inner_slices(part, axis, quantity_, slices);
    double inner = 0;
    for (int i = 0; i < count; ++i) inner += slices[i];
    const double rim = std::max(before_[tile + 1] - before_[tile] - inner, 0.0);

    Planes planes, rim_before;
    double before = before_[tile], behind = behind_[tile + 1] + inner;
    for (int i = 1; i < count; ++i) {
      before += slices[i - 1];
      behind = std::max(behind - slices[i - 1], behind_[tile + 1]);
      add_plane(axis, cuts_[tile] + i, before, behind + rim, &planes);
    }
    score(&planes);
    if (!may_win(planes)) {
      rim_before = planes;
      for (int i = 0; i < planes.count; ++i) {
        rim_before.q1[i] += rim;
        rim_before.q2[i] = std::max(rim_before.q2[i] - rim, 0.0);
      }
      score(&rim_before);
      if (!may_win(rim_before)) return;
    }

    statistics_.add_rim_slices(part, axis, quantity_, slices);
    behind = behind_[tile + 1];
    for (int i = count - 1; i > 0; --i) planes.q2[i - 1] = behind += slices[i];
    before = before_[tile];
    for (int i = 1; i < count; ++i) planes.q1[i - 1] = before += slices[i - 1];
    score(&planes);
    consider(axis, planes, [&](int i) { return cuts_[tile] + 1 + i; });
  }

  const ImageStatistics& statistics_;
  CornerSums* const known_;
  const TexelRect rect_;
  const double solid_angle_;
  const bool min_variance_;
  const Quantity quantity_;
  double unsplit_score_ = 0;
  Split best_;
  std::vector<int32_t> cuts_;
  std::vector<double> before_, behind_;  // of each cut
};

}  // namespace

double squared_error(const Moments& moments, double solid_angle) {
  const double error = moments.square - moments.power * moments.power / solid_angle;
  return error > kVariationFloor * moments.square ? error : 0.0;
}

Split find_split(const ImageStatistics& statistics, const TexelRect& rect, SplitCriterion criterion,
                 CornerSums* known) {
  if (criterion == SplitCriterion::MEDIAN_CUT) return find_median_cut(statistics, rect, known);
  return SplitSearch(statistics, rect, criterion, known).run();
}

}  // namespace skytree
