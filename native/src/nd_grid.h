// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernel/nd_kdtree.h"

namespace skytree {

/// A non-negative function on [0,1]^D as its means over the cells of a rectilinear grid.
struct NdGrid {
  /// Per axis: borders of its cells, rising from 0 to 1.
  std::vector<std::vector<double>> edges;
  std::vector<float> values;  // first axis outermost

  int dimensions() const { return int(edges.size()); }
  int size(int axis) const { return int(edges[size_t(axis)].size()) - 1; }
  double width(int axis, int cell) const {
    return edges[size_t(axis)][size_t(cell) + 1] - edges[size_t(axis)][size_t(cell)];
  }
};

/// Cells of equal width.
std::vector<double> uniform_edges(int cells);

/// Throws std::invalid_argument with what is wrong.
void check_grid(const NdGrid& grid, int condition_count);

/// A box of cells of some consecutive axes; unused axes are [0,1).
struct NdBox {
  std::array<int32_t, kNdMaxDimensions> lo{0, 0, 0, 0}, hi{1, 1, 1, 1};
};

}  // namespace skytree
