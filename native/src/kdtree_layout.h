// SPDX-License-Identifier: GPL-3.0-or-later
// The inner nodes of a grown tree as the kernel reads them (kernel/kdtree.h).
#pragma once

#include <vector>

#include "kernel/kdtree.h"
#include "src/kdtree_builder.h"

namespace skytree {

/// Leaves depth first, the first child (left or top) before the second.
std::vector<int32_t> leaves_depth_first(const BuildTree& tree);

struct Plane {
  int32_t axis, position;  // in texels or cells
};

/// Inner nodes keep their order of creation; block b is blocks[b] of the tree.
struct KdTreeLayout {
  std::vector<Plane> planes;
  std::vector<int32_t> split_keys;
  std::vector<uint32_t> children;
  std::vector<uint16_t> start_grid;

  KdTreeLayout() = default;
  KdTreeLayout(const BuildTree& tree, const std::vector<int32_t>& blocks, const TreeGrid& grid);
};

/// A part of the unit square of (u.y, u.z), in units of 2^-24.
struct WarpRect {
  static constexpr int32_t kUnits = 1 << 24;
  int32_t lo[2] = {0, 0}, hi[2] = {kUnits, kUnits};

  double extent(int axis) const { return (hi[axis] - lo[axis]) * (1.0 / kUnits); }
  double area() const { return extent(0) * extent(1); }
  float origin(int axis) const { return (float)lo[axis] * (1.0f / kUnits); }
};

/// The unit square, cut like the map in proportion to probability. Thresholds are exact in a float,
/// and a block's probability is the area that it really gets. Every part keeps at least as many
/// units a side as it has blocks, so that no block vanishes.
struct WarpLayout {
  std::vector<WarpRect> blocks;    // in the order of `blocks`
  std::vector<float> split_warps;  // per inner node
  std::vector<uint16_t> grid;

  WarpLayout() = default;
  WarpLayout(const BuildTree& tree, const std::vector<int32_t>& blocks,
             const std::vector<double>& probabilities, const KdTreeLayout& layout);
};

}  // namespace skytree
