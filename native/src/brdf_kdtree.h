// SPDX-License-Identifier: GPL-3.0-or-later
// A tabulated BRDF with the kd-tree that samples it: three dimensions for an isotropic table, four
// for an anisotropic one.
#pragma once

#include "src/brdf_table.h"
#include "src/nd_kdtree.h"

namespace skytree {

struct BrdfKdTreeConfig {
  NdKdTreeConfig tree;
  BrdfKdTreeConfig() {
    tree.block_count = 0;  // 0: 2048, or 8192 for an anisotropic table
    tree.slice_count = 0;  // 0: 12, or 96
    tree.split_criterion = SplitCriterion::MIN_VARIANCE;
    tree.block_probability = BlockProbability::MIN_VARIANCE;
    // Less than for maps: a lobe is nearly all of its light, and what is spread is lost to it.
    tree.uniform_share = 0.01;
  }
};

/// Immutable once built, so that scenes and Python share it.
class BrdfKdTree {
 public:
  explicit BrdfKdTree(BrdfTablePointer table, BrdfKdTreeConfig config = {});

  TabulatedBrdfView view() const { return {table_->view(), tree_.view()}; }
  const BrdfTable& table() const { return *table_; }
  const NdKdTree& tree() const { return tree_; }
  double build_seconds() const { return build_seconds_; }

 private:
  BrdfTablePointer table_;
  double build_seconds_ = 0;
  NdKdTree tree_;
};

}  // namespace skytree
