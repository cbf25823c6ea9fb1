// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/nd_grid.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace skytree {

std::vector<double> uniform_edges(int cells) {
  std::vector<double> edges;
  for (int i = 0; i <= cells; ++i) edges.push_back(double(i) / cells);
  return edges;
}

void check_grid(const NdGrid& grid, int condition_count) {
  const int dimensions = grid.dimensions();
  if (dimensions < 1 || dimensions > kNdMaxDimensions) {
    throw std::invalid_argument("table: 1 to 4 dimensions are supported, not " +
                                std::to_string(dimensions));
  }
  if (condition_count < 0 || condition_count >= dimensions) {
    throw std::invalid_argument(
        "condition_dimensions must be at least 0 and leave a dimension to sample: " +
        std::to_string(condition_count) + " of " + std::to_string(dimensions));
  }
  size_t cells = 1;
  for (int axis = 0; axis < dimensions; ++axis) {
    const std::vector<double>& edges = grid.edges[size_t(axis)];
    const std::string name = "edges of axis " + std::to_string(axis);
    if (edges.size() < 2) throw std::invalid_argument("table: axis without cells");
    if (edges.front() != 0.0 || edges.back() != 1.0) {
      throw std::invalid_argument(name + " must begin at 0 and end at 1");
    }
    for (size_t i = 0; i + 1 < edges.size(); ++i) {
      // Floats in the kernel: two planes must not become one.
      if (!(float(edges[i]) < float(edges[i + 1]))) {
        throw std::invalid_argument(name + " must rise, by more than a float resolves");
      }
    }
    cells *= edges.size() - 1;
  }
  if (cells != grid.values.size()) {
    throw std::invalid_argument("table: its edges make " + std::to_string(cells) +
                                " cells, but it has " + std::to_string(grid.values.size()));
  }
  size_t bad = 0;
  for (const float value : grid.values) bad += !(value >= 0.0f && value <= 3.4e38f);
  if (bad > 0) {
    throw std::invalid_argument("table: " + std::to_string(bad) +
                                " values are negative, infinite or not a number; a density needs "
                                "finite values that are not negative");
  }
}

}  // namespace skytree
