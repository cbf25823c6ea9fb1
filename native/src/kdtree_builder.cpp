// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/kdtree_builder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <queue>
#include <unordered_map>

#include "src/range_table.h"

namespace skytree {
namespace {

// Reading the image is most of the work, half of it for the luminance.
constexpr double kShareOfReading = 0.7;

/// Of blocks of cells: the share of all that splitting could ever gain that counts as gained by any
/// split. What comes to nothing is pruned afterwards.
constexpr double kHope = 0.1;

/// Blocks that a thread searches in turn: enough to be worth waking it.
constexpr int kBlocksAhead = 32;

void report(const BuildProgress& progress, double done) {
  if (progress && !progress(done)) throw BuildCancelled();
}

struct Candidate {
  double variation;
  int32_t node;

  bool operator<(const Candidate& other) const {
    return variation != other.variation ? variation < other.variation : node > other.node;
  }
};

}  // namespace

class TreeGrowth::Builder {
 public:
  Builder(std::shared_ptr<const ImageStatistics> statistics, SplitCriterion criterion,
          ThreadTeam& team)
      : criterion_(criterion), shared_(std::move(statistics)), statistics_(*shared_) {
    if (criterion == SplitCriterion::RANGE)
      ranges_ = std::make_unique<RangeTable>(statistics_.luminance(), team);
    const TexelRect whole = {{0, 0}, {statistics_.extent(0), statistics_.extent(1)}};
    add(whole, statistics_.sum(whole));
  }

  size_t nbytes() const {
    return nodes_.size() * sizeof(BuildNode) + splits_.size() * sizeof(Split) +
           (waiting_.size() + ready_.size()) * sizeof(Candidate) +
           ahead_.size() * sizeof(*ahead_.begin()) + known_.size() * CornerSums::nbytes() +
           (ranges_ ? ranges_->nbytes() : 0);
  }

  BuildTree tree(int block_count, ThreadTeam& team, const BuildProgress& progress) {
    for (;;) {
      while (block_count_ < block_count && !waiting_.empty() &&
             (ready_.empty() || ready_.top() < waiting_.top())) {
        make_ready(team);
      }
      if (block_count_ >= block_count || ready_.empty()) break;
      const int32_t node = ready_.top().node;
      ready_.pop();
      split(node);
      if (block_count_ % 64 == 0) {
        report(progress, kShareOfReading + (1 - kShareOfReading) * block_count_ / block_count);
      }
    }
    return first_splits(std::min(block_count, block_count_));
  }

 private:
  /// Moves the first of the waiting blocks to those whose plane is known.
  void make_ready(ThreadTeam& team) {
    const Candidate candidate = waiting_.top();
    if (splits_[candidate.node].axis < 0) search_ahead(team);
    waiting_.pop();
    const double variation = criterion_ == SplitCriterion::MIN_VARIANCE
                                 ? std::min(exact_variation(candidate.node), candidate.variation)
                                 : candidate.variation;
    if (variation > 0) ready_.push({variation, candidate.node});
  }

  /// Finds the planes of the first block that waits and, with several threads, of those that will
  /// most likely come next: others that wait, and what the next blocks will be split into.
  void search_ahead(ThreadTeam& team) {
    struct Wanted {
      TexelRect rect;
      Split* split;
    };
    const size_t most = team.size() > 1 ? kBlocksAhead * team.size() : 1;
    std::vector<Wanted> wanted;
    std::vector<Candidate> waiting, ready;  // looked at
    while (wanted.size() < most && waiting.size() + ready.size() < 2 * most) {
      if (!waiting_.empty() && (ready_.empty() || ready_.top() < waiting_.top())) {
        const int32_t node = waiting_.top().node;
        if (splits_[node].axis < 0) wanted.push_back({nodes_[node].rect, &splits_[node]});
        waiting.push_back(waiting_.top());
        waiting_.pop();
      } else if (!ready_.empty()) {
        const int32_t node = ready_.top().node;
        const auto [children, is_new] = ahead_.try_emplace(node);
        for (int i = 0; is_new && i < 2; ++i) {
          const TexelRect rect = child_rect(node, i);
          if (rect.area() > 1) wanted.push_back({rect, &children->second[i]});
        }
        ready.push_back(ready_.top());
        ready_.pop();
      } else {
        break;
      }
    }
    if ((int)known_.size() < team.size()) known_.resize(team.size());
    team.run((int)wanted.size(), [&](int worker, int i) {
      *wanted[i].split = find_split(statistics_, wanted[i].rect, criterion_, &known_[worker]);
    });
    for (const Candidate& candidate : waiting) waiting_.push(candidate);
    for (const Candidate& candidate : ready) ready_.push(candidate);
  }

  TexelRect child_rect(int32_t node, int child) const {
    const Split& split = splits_[node];
    TexelRect rect = nodes_[node].rect;
    (child == 0 ? rect.hi : rect.lo)[split.axis] = split.position;
    return rect;
  }

  BuildTree first_splits(int block_count) const {
    BuildTree tree;
    const int32_t count = 2 * block_count - 1;
    tree.nodes.assign(nodes_.begin(), nodes_.begin() + count);
    for (BuildNode& node : tree.nodes) {
      if (node.first_child >= count) node = {node.rect, node.moments};
    }
    tree.block_count = block_count;
    tree.bad_texels = statistics_.bad_texels();
    return tree;
  }

  void add(const TexelRect& rect, const Moments& moments) {
    const int32_t index = (int32_t)nodes_.size();
    BuildNode node;
    node.rect = rect;
    node.moments = moments;
    nodes_.push_back(node);
    splits_.emplace_back();
    const double variation = rect.area() > 1 ? first_variation(node) : 0.0;
    if (variation > 0) waiting_.push({variation, index});
  }

  /// By what a block queues; with MIN_VARIANCE a bound on it, which the search replaces.
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

  /// MIN_VARIANCE: the gain of the split.
  double exact_variation(int32_t index) const {
    const BuildNode& node = nodes_[index];
    const double cost = std::sqrt(statistics_.solid_angle(node.rect) * node.moments.square);
    double gain = cost + splits_[index].score;
    if (statistics_.grid().cells) {
      // Light on both sides of a peak is alike, and then no single plane gains anything.
      gain = std::max(gain, kHope * (cost - node.moments.power));
    }
    return worth(gain, cost);
  }

  void split(int32_t index) {
    const Split split = splits_[index];
    nodes_[index].first_child = (int32_t)nodes_.size();
    nodes_[index].axis = split.axis;
    nodes_[index].position = split.position;
    for (int i = 0; i < 2; ++i) add(child_rect(index, i), i == 0 ? split.first : split.second);
    ++block_count_;
    const auto known = ahead_.find(index);
    if (known == ahead_.end()) return;
    for (int i = 0; i < 2; ++i) splits_[nodes_[index].first_child + i] = known->second[i];
    ahead_.erase(known);
  }

  const SplitCriterion criterion_;
  const std::shared_ptr<const ImageStatistics> shared_;
  const ImageStatistics& statistics_;
  std::unique_ptr<RangeTable> ranges_;
  std::vector<CornerSums> known_;                   // of each thread
  std::priority_queue<Candidate> waiting_, ready_;  // ready: with a plane
  std::vector<BuildNode> nodes_;
  std::vector<Split> splits_;                                // by node; axis -1: not searched
  std::unordered_map<int32_t, std::array<Split, 2>> ahead_;  // of a block's parts to be
  int32_t block_count_ = 1;
};

TreeGrowth::TreeGrowth(std::shared_ptr<const ImageStatistics> statistics, SplitCriterion criterion,
                       ThreadTeam& team)
    : builder_(std::make_unique<Builder>(std::move(statistics), criterion, team)) {}

TreeGrowth::~TreeGrowth() = default;

BuildTree TreeGrowth::tree(int block_count, ThreadTeam& team, const BuildProgress& progress) {
  return builder_->tree(block_count, team, progress);
}

size_t TreeGrowth::nbytes() const { return builder_->nbytes(); }

BuildTree build_kdtree(const LatLongImage& image, Statistics statistics, int block_count,
                       SplitCriterion criterion, const BuildProgress& progress) {
  ThreadTeam team;
  TreeGrowth growth(
      measure_statistics(read_luminance(image, team, progress), statistics, team, progress),
      criterion, team);
  return growth.tree(block_count, team, progress);
}

std::shared_ptr<const LuminancePlane> read_luminance(const LatLongImage& image, ThreadTeam& team,
                                                     const BuildProgress& progress) {
  return std::make_shared<LuminancePlane>(
      image, team, [&](double done) { report(progress, 0.5 * kShareOfReading * done); });
}

std::shared_ptr<const ImageStatistics> measure_statistics(
    std::shared_ptr<const LuminancePlane> luminance, Statistics statistics, ThreadTeam& team,
    const BuildProgress& progress) {
  return std::make_shared<ImageStatistics>(
      std::move(luminance), statistics, team,
      [&](double done) { report(progress, 0.5 * kShareOfReading * (1 + done)); });
}

}  // namespace skytree
