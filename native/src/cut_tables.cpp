// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/cut_tables.h"

#include <algorithm>
#include <cmath>

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;

/// Mean of the directions of a block, each solid angle alike; shorter than 1 by what they spread.
void mean_direction(const TreeGrid& grid, const TexelRect& rect, double (&mean)[3]) {
  const auto phi = [&](int x) {
    return 2.0 * kPiDouble * (0.5 - grid.azimuth_origin() - (double)x / grid.columns());
  };
  const double from = phi(rect.lo[0]), to = phi(rect.hi[0]);
  const double z0 = 1.0 - 2.0 * grid.height_at(rect.hi[1]);
  const double z1 = 1.0 - 2.0 * grid.height_at(rect.lo[1]);
  const auto area = [](double z) {  // integral of sin(theta) over z
    return 0.5 * (z * std::sqrt(std::max(1.0 - z * z, 0.0)) + std::asin(std::clamp(z, -1.0, 1.0)));
  };
  const double sine = z1 > z0 ? (area(z1) - area(z0)) / (z1 - z0) : std::sqrt(1.0 - z0 * z0);
  mean[0] = sine * (std::sin(to) - std::sin(from)) / (to - from);
  mean[1] = sine * (std::cos(from) - std::cos(to)) / (to - from);
  mean[2] = 0.5 * (z0 + z1);
}

/// Sums over the blocks below a node.
struct Below {
  double probability = 0, solid_angle = 0, sum[3] = {0, 0, 0};
  int32_t lo[2] = {WarpRect::kUnits, WarpRect::kUnits}, hi[2] = {0, 0};

  void add(const Below& part) {
    probability += part.probability;
    solid_angle += part.solid_angle;
    for (int c = 0; c < 3; ++c) sum[c] += part.sum[c];
    for (int a = 0; a < 2; ++a) {
      lo[a] = std::min(lo[a], part.lo[a]);
      hi[a] = std::max(hi[a], part.hi[a]);
    }
  }
};

}  // namespace

CutTables::CutTables(const BuildTree& tree, const std::vector<int32_t>& blocks,
                     const TreeGrid& grid, const WarpLayout& warp) {
  std::vector<Below> below(tree.nodes.size());
  for (size_t b = 0; b < blocks.size(); ++b) {
    Below& block = below[blocks[b]];
    const WarpRect& rect = warp.blocks[b];
    const TexelRect& cells = tree.nodes[blocks[b]].rect;
    mean_direction(grid, cells, block.sum);
    block.probability = rect.area();
    block.solid_angle =
        4.0 * kPiDouble * grid.rise(cells.lo[1], cells.hi[1]) * cells.size(0) / grid.columns();
    for (double& component : block.sum) component *= block.probability;
    std::copy_n(rect.lo, 2, block.lo);
    std::copy_n(rect.hi, 2, block.hi);
  }
  for (size_t i = tree.nodes.size(); i-- > 0;) {
    const int32_t child = tree.nodes[i].first_child;
    if (child < 0) continue;
    below[i].add(below[child]);
    below[i].add(below[child + 1]);
  }
  // Children were made two at a time, in the order in which their parents were split.
  const size_t made = std::min(tree.nodes.size(), (size_t)(2 * kLargestCut - 1));
  std::vector<int16_t> numbers(made);
  int16_t inner = 0, leaf = 0;
  const auto is_split = [&](size_t i) {
    const int32_t child = tree.nodes[i].first_child;
    return child >= 0 && child + 1 < (int32_t)made;
  };
  for (size_t i = 0; i < made; ++i) numbers[i] = is_split(i) ? inner++ : (int16_t)~leaf++;
  std::vector<uint8_t> node_of(tree.nodes.size());
  for (size_t i = 0; i < tree.nodes.size(); ++i) {
    if (i < made && !is_split(i)) {
      node_of[i] = (uint8_t)~numbers[i];
      const Below& sums = below[i];
      const double length = std::sqrt(sums.sum[0] * sums.sum[0] + sums.sum[1] * sums.sum[1] +
                                      sums.sum[2] * sums.sum[2]);
      const double scale = length > 1e-9 ? 1.0 / length : 0.0;
      CutNode node;
      node.direction = {(float)(scale * sums.sum[0]), (float)(scale * sums.sum[1]),
                        scale > 0 ? (float)(scale * sums.sum[2]) : 1.0f};
      node.spread = (float)(2.0 * std::max(1.0 - length / sums.probability, 0.0));
      node.probability = (float)sums.probability;
      node.solid_angle = (float)sums.solid_angle;
      node.warp_low = {(float)sums.lo[0] / WarpRect::kUnits, (float)sums.lo[1] / WarpRect::kUnits};
      node.warp_extent = {(float)(sums.hi[0] - sums.lo[0]) / WarpRect::kUnits,
                          (float)(sums.hi[1] - sums.lo[1]) / WarpRect::kUnits};
      nodes.push_back(node);
    } else if (i < made) {
      const int32_t child = tree.nodes[i].first_child;
      splits.push_back(make_cut_split(numbers[child], numbers[child + 1], tree.nodes[i].axis));
    }
    const int32_t child = tree.nodes[i].first_child;
    if (child >= 0) node_of[child] = node_of[child + 1] = node_of[i];
  }
  for (int32_t block : blocks) node_of_block.push_back(node_of[block]);
}

}  // namespace skytree
