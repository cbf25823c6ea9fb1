// SPDX-License-Identifier: GPL-3.0-or-later
// The kd-tree sampler over one to four dimensions, of which the first may be given: building and
// tables behind kernel/nd_kdtree.h, which says how conditions are dealt with.
#pragma once

#include <vector>

#include "src/kdtree_sampler.h"
#include "src/nd_grid.h"

namespace skytree {

struct NdKdTreeConfig {
  static constexpr int kLargestBlockCount = 1 << 22;

  int block_count = 1024;  ///< of all slices together; at least one each
  int slice_count = 16;    ///< into which the condition is cut, at most
  SplitCriterion split_criterion = SplitCriterion::SSE;  ///< not RANGE
  BlockProbability block_probability = BlockProbability::EXACT;
  /// As in KdTreeConfig: share of the probability spread evenly, with EXACT and MIN_VARIANCE.
  double uniform_share = 0.05;
};

class NdKdTree {
 public:
  /// Conditional on the first `condition_count` dimensions of the grid. Throws
  /// std::invalid_argument for a bad grid or a setting out of range.
  NdKdTree(const NdGrid& grid, int condition_count, const NdKdTreeConfig& config = {});

  NdKdTreeView view() const;
  /// What sampling and density need at run time.
  size_t nbytes() const;
  int condition_count() const { return condition_count_; }
  int free_count() const { return free_count_; }
  int block_count() const { return block_count_; }
  int slice_count() const { return int(slices_.size()); }
  size_t node_count() const { return nodes_.size(); }
  size_t bounds_count() const { return bounds_.size(); }
  /// The model's fit to the blocks of each slice; with FITTED it is what is sampled.
  const std::vector<RankFit>& fits() const { return fits_; }
  double build_seconds() const { return build_seconds_; }

 private:
  int condition_count_, free_count_;
  int block_count_ = 0;
  std::vector<NdNode> nodes_;
  std::vector<NdSlice> slices_;
  std::vector<float> bounds_;
  std::vector<RankFit> fits_;
  double build_seconds_ = 0;
};

}  // namespace skytree
