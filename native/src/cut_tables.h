// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "kernel/product_cut.h"
#include "src/kdtree_layout.h"

namespace skytree {

/// The upper part of a tree of linear blocks as kernel/product_cut.h reads it.
struct CutTables {
  std::vector<CutNode> nodes;
  std::vector<CutSplit> splits;
  std::vector<uint8_t> node_of_block;

  CutTables() = default;
  /// The first splits of the tree, which were worth most, up to kLargestCut nodes. `blocks` are the
  /// tree's leaves, `warp` their places in the unit square.
  CutTables(const BuildTree& tree, const std::vector<int32_t>& blocks, const TreeGrid& grid,
            const WarpLayout& warp);

  CutView view() const {
    return {nodes.data(), splits.data(), node_of_block.data(), (int32_t)nodes.size()};
  }
};

}  // namespace skytree
