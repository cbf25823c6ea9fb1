// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/kdtree_layout.h"

#include <algorithm>
#include <cmath>

namespace skytree {
namespace {

/// Deepest node whose region holds a cell of a grid; side(node) tells whether the cell lies before
/// the node's plane (-1), behind it (1) or across (0).
template <typename Side>
uint16_t deepest_node(const std::vector<uint32_t>& children, const Side& side) {
  int32_t node = 0;
  while (node < (int32_t)children.size()) {
    const int where = side(node);
    if (where == 0) break;
    node = next_node(children[node], where > 0);
  }
  return (uint16_t)node;
}

}  // namespace

std::vector<int32_t> leaves_depth_first(const BuildTree& tree) {
  std::vector<int32_t> leaves, stack = {0};
  while (!stack.empty()) {
    const int32_t index = stack.back();
    stack.pop_back();
    const int32_t child = tree.nodes[index].first_child;
    if (child < 0) {
      leaves.push_back(index);
    } else {
      stack.push_back(child + 1);
      stack.push_back(child);
    }
  }
  return leaves;
}

KdTreeLayout::KdTreeLayout(const BuildTree& tree, const std::vector<int32_t>& blocks,
                           const TreeGrid& grid) {
  std::vector<uint16_t> numbers(tree.nodes.size());
  uint16_t inner = 0;
  for (size_t i = 0; i < tree.nodes.size(); ++i) {
    if (tree.nodes[i].first_child >= 0) numbers[i] = inner++;
  }
  for (size_t b = 0; b < blocks.size(); ++b) numbers[blocks[b]] = (uint16_t)(inner + b);
  for (const BuildNode& node : tree.nodes) {
    if (node.first_child < 0) continue;
    planes.push_back({node.axis, node.position});
    children.push_back(numbers[node.first_child] | (uint32_t)numbers[node.first_child + 1] << 16);
    if (node.axis == 0) {
      split_keys.push_back(azimuth_key((float)((double)node.position / grid.columns())));
    } else {
      const bool southern = grid.half_texels(node.position) > grid.height;
      const double h =
          southern ? grid.height_from_south(node.position) : grid.height_at(node.position);
      split_keys.push_back(elevation_key((float)h, southern) | kElevationSplit);
    }
  }
  // A direction on a cell's border may be rounded into the neighbour: a cell counts as a bit larger
  // than it is.
  constexpr double kMargin = 1e-6;
  for (int row = 0; row < kStartRows; ++row) {
    for (int column = 0; column < kStartColumns; ++column) {
      const double lo[2] = {(double)column / kStartColumns - kMargin,
                            (double)row / kStartRows - kMargin};
      const double hi[2] = {(double)(column + 1) / kStartColumns + kMargin,
                            (double)(row + 1) / kStartRows + kMargin};
      start_grid.push_back(deepest_node(children, [&](int32_t node) {
        const Plane& plane = planes[node];
        const double at = plane.axis == 0 ? (double)plane.position / grid.columns()
                                          : grid.height_at(plane.position);
        return hi[plane.axis] <= at ? -1 : lo[plane.axis] >= at ? 1 : 0;
      }));
    }
  }
}

WarpLayout::WarpLayout(const BuildTree& tree, const std::vector<int32_t>& leaves,
                       const std::vector<double>& probabilities, const KdTreeLayout& layout) {
  struct Part {
    double probability = 0;
    int32_t block_count = 1;
    WarpRect rect;
  };
  std::vector<Part> parts(tree.nodes.size());
  for (size_t b = 0; b < leaves.size(); ++b) parts[leaves[b]].probability = probabilities[b];
  for (size_t i = tree.nodes.size(); i-- > 0;) {
    const int32_t child = tree.nodes[i].first_child;
    if (child < 0) continue;
    parts[i].probability = parts[child].probability + parts[child + 1].probability;
    parts[i].block_count = parts[child].block_count + parts[child + 1].block_count;
  }
  for (size_t i = 0; i < tree.nodes.size(); ++i) {
    const BuildNode& node = tree.nodes[i];
    if (node.first_child < 0) continue;
    Part& first = parts[node.first_child];
    Part& second = parts[node.first_child + 1];
    const Part& part = parts[i];
    const int axis = node.axis;
    const int32_t extent = part.rect.hi[axis] - part.rect.lo[axis];
    const int32_t wanted = (int32_t)std::lround(extent * (first.probability / part.probability));
    const int32_t cut = std::clamp(wanted, first.block_count, extent - second.block_count);
    first.rect = second.rect = part.rect;
    first.rect.hi[axis] = second.rect.lo[axis] = part.rect.lo[axis] + cut;
    split_warps.push_back(second.rect.origin(axis));
  }
  for (int32_t leaf : leaves) blocks.push_back(parts[leaf].rect);
  for (int row = 0; row < kWarpGrid; ++row) {
    for (int column = 0; column < kWarpGrid; ++column) {
      const float lo[2] = {(float)column / kWarpGrid, (float)row / kWarpGrid};
      const float hi[2] = {(float)(column + 1) / kWarpGrid, (float)(row + 1) / kWarpGrid};
      grid.push_back(deepest_node(layout.children, [&](int32_t node) {
        const int axis = layout.planes[node].axis;
        const float at = split_warps[node];
        return hi[axis] <= at ? -1 : lo[axis] >= at ? 1 : 0;
      }));
    }
  }
}

}  // namespace skytree
