// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/kdtree_builder.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <queue>

#include "src/range_table.h"

namespace skytree {
namespace {

// Reading the image is most of the work.
constexpr double kShareOfReading = 0.7;

/// Of blocks of cells: the share of all that splitting could ever gain that counts as gained by any
/// split. What comes to nothing is pruned afterwards.
constexpr double kHope = 0.1;

void report(const BuildProgress& progress, double done) {
  if (progress && !progress(done)) throw BuildCancelled();
}

struct Candidate {
  double variation;
  int32_t node;
  bool exact;  // else an upper bound, whose block has not been searched yet
  Split split;

  bool operator<(const Candidate& other) const {
    return variation != other.variation ? variation < other.variation : node > other.node;
  }
};

class Builder {
 public:
  Builder(const ImageStatistics& statistics, int block_count, SplitCriterion criterion,
          const BuildProgress& progress)
      : block_count_(block_count),
        criterion_(criterion),
        progress_(progress),
        statistics_(statistics) {
    if (criterion == SplitCriterion::RANGE)
      ranges_ = std::make_unique<RangeTable>(statistics_.luminance());
  }

  BuildTree run() {
    const TexelRect whole = {{0, 0}, {statistics_.extent(0), statistics_.extent(1)}};
    add(whole, statistics_.sum(whole));
    tree_.nodes.reserve(2 * (size_t)block_count_);
    while (tree_.block_count < block_count_ && !candidates_.empty()) {
      Candidate candidate = candidates_.top();
      candidates_.pop();
      const TexelRect rect = tree_.nodes[candidate.node].rect;
      if (candidate.split.axis < 0) candidate.split = find_split(statistics_, rect, criterion_);
      if (!candidate.exact) {
        push_exact(candidate);
        continue;
      }
      split(candidate);
      if (tree_.block_count % 64 == 0) {
        report(progress_,
               kShareOfReading + (1 - kShareOfReading) * tree_.block_count / block_count_);
      }
    }
    tree_.bad_texels = statistics_.bad_texels();
    return std::move(tree_);
  }

 private:
  void add(const TexelRect& rect, const Moments& moments) {
    const int32_t index = (int32_t)tree_.nodes.size();
    BuildNode node;
    node.rect = rect;
    node.moments = moments;
    tree_.nodes.push_back(node);
    const double variation = rect.area() > 1 ? first_variation(node) : 0.0;
    if (variation > 0) {
      candidates_.push({variation, index, criterion_ != SplitCriterion::MIN_VARIANCE, Split()});
    }
  }

  double first_variation(const BuildNode& node) const {
    const double solid_angle = statistics_.solid_angle(node.rect);
    switch (criterion_) {
      case SplitCriterion::RANGE:
        return ranges_->range(node.rect);
      case SplitCriterion::VARIANCE:
        return squared_error(node.moments, solid_angle) / solid_angle;
      case SplitCriterion::SSE:
        return squared_error(node.moments, solid_angle);
      case SplitCriterion::MEDIAN_CUT:
        return node.moments.power > 0 ? 1.0 : 0.0;  // of equals the oldest is split
      default: {
        // However a block is split, by Cauchy and Schwarz the sum of sqrt(n Q) over its parts stays
        // above its power.
        const double cost = std::sqrt(solid_angle * node.moments.square);
        return worth(cost - node.moments.power, cost);
      }
    }
  }

  static double worth(double gain, double cost) {
    return gain > kVariationFloor * cost ? gain : 0.0;
  }

  /// MIN_VARIANCE: the gain of the split replaces the bound, and the block queues again.
  void push_exact(Candidate candidate) {
    const BuildNode& node = tree_.nodes[candidate.node];
    const double cost = std::sqrt(statistics_.solid_angle(node.rect) * node.moments.square);
    double gain = cost + candidate.split.score;
    if (statistics_.grid().cells) {
      // Light on both sides of a peak is alike, and then no single plane gains anything.
      gain = std::max(gain, kHope * (cost - node.moments.power));
    }
    candidate.variation = worth(gain, cost);
    candidate.exact = true;
    if (candidate.variation > 0) candidates_.push(candidate);
  }

  void split(const Candidate& candidate) {
    const Split& split = candidate.split;
    BuildNode& node = tree_.nodes[candidate.node];
    node.first_child = (int32_t)tree_.nodes.size();
    node.axis = split.axis;
    node.position = split.position;
    TexelRect first = node.rect, second = node.rect;
    first.hi[split.axis] = second.lo[split.axis] = split.position;
    add(first, split.first);
    add(second, split.second);
    ++tree_.block_count;
  }

  const int block_count_;
  const SplitCriterion criterion_;
  const BuildProgress& progress_;
  const ImageStatistics& statistics_;
  std::unique_ptr<RangeTable> ranges_;
  std::priority_queue<Candidate> candidates_;
  BuildTree tree_;
};

}  // namespace

ImageStatistics read_statistics(const LatLongImage& image, Statistics statistics,
                                const BuildProgress& progress) {
  return ImageStatistics(image, statistics,
                         [&](double done) { report(progress, kShareOfReading * done); });
}

BuildTree build_kdtree(const ImageStatistics& statistics, int block_count, SplitCriterion criterion,
                       const BuildProgress& progress) {
  return Builder(statistics, block_count, criterion, progress).run();
}

}  // namespace skytree
