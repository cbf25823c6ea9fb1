// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/nd_blocks.h"

#include <cmath>
#include <queue>

namespace skytree {
namespace {

struct Plane {
  int axis = -1;
  int32_t position = 0;
  double gain = 0;
};

/// What waits to be split: the highest priority first, then what was made first.
struct Candidate {
  double priority;
  int32_t tree, node;
  Plane plane;
  int64_t order;
  bool operator<(const Candidate& other) const {
    return priority != other.priority ? priority < other.priority : order > other.order;
  }
};

void split_node(std::vector<NdBuildNode>* nodes, int32_t index, const Plane& plane) {
  NdBuildNode first, second;
  first.box = second.box = (*nodes)[size_t(index)].box;
  first.box.hi[size_t(plane.axis)] = second.box.lo[size_t(plane.axis)] = plane.position;
  (*nodes)[size_t(index)].first_child = int32_t(nodes->size());
  (*nodes)[size_t(index)].axis = plane.axis;
  (*nodes)[size_t(index)].position = plane.position;
  nodes->push_back(first);
  nodes->push_back(second);
}

/// Calls visit(cell, volume of it) for each cell of a box over the axes [first, first + count);
/// `cell` numbers the cells of those axes, the last innermost.
template <class Visit>
void for_each_cell(const NdGrid& grid, int first, int count, const NdBox& box, Visit visit) {
  std::array<int32_t, kNdMaxDimensions> at = box.lo;
  for (;;) {
    size_t cell = 0;
    double volume = 1;
    for (int a = 0; a < count; ++a) {
      cell = cell * size_t(grid.size(first + a)) + size_t(at[size_t(a)]);
      volume *= grid.width(first + a, at[size_t(a)]);
    }
    visit(cell, volume, at);
    int a = count - 1;
    while (a >= 0 && ++at[size_t(a)] == box.hi[size_t(a)]) {
      at[size_t(a)] = box.lo[size_t(a)];
      --a;
    }
    if (a < 0) return;
  }
}

NdBox whole_box(const NdGrid& grid, int first, int count) {
  NdBox box;
  for (int a = 0; a < count; ++a) box.hi[size_t(a)] = grid.size(first + a);
  return box;
}

std::vector<double> cell_volumes(const NdGrid& grid, int first, int count) {
  std::vector<double> volumes;
  for_each_cell(grid, first, count, whole_box(grid, first, count),
                [&](size_t, double volume, const auto&) { volumes.push_back(volume); });
  return volumes;
}

/// The plane of a slice that takes most from its squared deviations across the condition.
Plane best_slice_plane(const NdGrid& grid, const std::vector<float>& conditional,
                       int condition_count, const std::vector<double>& weights, const NdBox& box) {
  const size_t cells = weights.size();
  Plane best;
  for (int axis = 0; axis < condition_count; ++axis) {
    const int32_t lo = box.lo[size_t(axis)], length = box.hi[size_t(axis)] - lo;
    if (length < 2) continue;
    // Sums over the slabs of cells across the axis, then over all before a plane.
    std::vector<double> volume(size_t(length), 0.0), sum(size_t(length) * cells, 0.0);
    for_each_cell(grid, 0, condition_count, box, [&](size_t c, double v, const auto& at) {
      const size_t slab = size_t(at[size_t(axis)] - lo);
      volume[slab] += v;
      for (size_t x = 0; x < cells; ++x) sum[slab * cells + x] += v * conditional[c * cells + x];
    });
    for (size_t k = 1; k < size_t(length); ++k) {
      volume[k] += volume[k - 1];
      for (size_t x = 0; x < cells; ++x) sum[k * cells + x] += sum[(k - 1) * cells + x];
    }
    const double n = volume.back();
    double floor = 0;  // below it a difference is rounding
    const double* total = &sum[(size_t(length) - 1) * cells];
    for (size_t x = 0; x < cells; ++x) {
      floor += kVariationFloor * weights[x] * total[x] * total[x] / n;
    }
    for (size_t k = 0; k + 1 < size_t(length); ++k) {
      const double n1 = volume[k], n2 = n - n1;
      double gain = 0;
      for (size_t x = 0; x < cells; ++x) {
        const double s = total[x], s1 = sum[k * cells + x], s2 = s - s1;
        gain += weights[x] * (s1 * s1 / n1 + s2 * s2 / n2 - s * s / n);
      }
      if (gain > best.gain && gain > floor) best = {axis, lo + int32_t(k) + 1, gain};
    }
  }
  return best;
}

/// The plane of a block, and with what priority it should be split.
Plane best_block_plane(const NdSums& sums, const NdBox& box, SplitCriterion criterion,
                       int free_count, double* priority) {
  const bool min_variance = criterion == SplitCriterion::MIN_VARIANCE;
  const auto cost = [&](const NdMoments& m) {  // what a split should reduce
    return min_variance ? std::sqrt(std::fmax(m.volume * m.square, 0.0))
                        : -(m.mass * m.mass) / m.volume;
  };
  const NdMoments all = sums.moments(box);
  Plane best;
  for (int axis = 0; axis < free_count; ++axis) {
    for (int32_t at = box.lo[size_t(axis)] + 1; at < box.hi[size_t(axis)]; ++at) {
      NdBox first = box, second = box;
      first.hi[size_t(axis)] = second.lo[size_t(axis)] = at;
      const double gain = cost(all) - cost(sums.moments(first)) - cost(sums.moments(second));
      if (gain > best.gain) best = {axis, at, gain};
    }
  }
  if (best.axis < 0) return best;
  const double error = all.mass_square - all.mass * all.mass / all.volume;
  // As with maps: below this share of the second moment a difference is rounding.
  if (!min_variance && error < kVariationFloor * all.mass_square) return {};
  if (min_variance && best.gain < kVariationFloor * cost(all)) return {};
  *priority = min_variance                            ? best.gain
              : criterion == SplitCriterion::VARIANCE ? error / all.volume
                                                      : error;
  // A slice counts as much as the condition that it covers.
  *priority *= sums.slice_volume();
  return best;
}

}  // namespace

std::vector<NdBuildNode> build_slices(const NdGrid& grid, const std::vector<float>& conditional,
                                      int condition_count, int count) {
  std::vector<NdBuildNode> nodes(1);
  nodes[0].box = whole_box(grid, 0, condition_count);
  if (condition_count == 0) return nodes;
  const std::vector<double> weights =
      cell_volumes(grid, condition_count, grid.dimensions() - condition_count);
  std::priority_queue<Candidate> queue;
  int64_t order = 0;
  const auto offer = [&](int32_t node) {
    const Plane plane =
        best_slice_plane(grid, conditional, condition_count, weights, nodes[size_t(node)].box);
    if (plane.axis >= 0) queue.push({plane.gain, 0, node, plane, order++});
  };
  offer(0);
  for (int made = 1; made < count && !queue.empty(); ++made) {
    const Candidate top = queue.top();
    queue.pop();
    split_node(&nodes, top.node, top.plane);
    const int32_t child = nodes[size_t(top.node)].first_child;
    offer(child);
    offer(child + 1);
  }
  return nodes;
}

NdSums::NdSums(const NdGrid& grid, const std::vector<float>& conditional, int condition_count,
               const NdBox& slice)
    : free_count_(grid.dimensions() - condition_count),
      grid_(grid),
      condition_count_(condition_count) {
  const std::vector<double> weights = cell_volumes(grid, condition_count, free_count_);
  const size_t cells = weights.size();
  std::vector<double> mean(cells, 0.0), square(cells, 0.0);
  for_each_cell(grid, 0, condition_count, slice, [&](size_t c, double v, const auto&) {
    slice_volume_ += v;
    for (size_t x = 0; x < cells; ++x) {
      const double value = conditional[c * cells + x];
      mean[x] += v * value;
      square[x] += v * value * value;
    }
  });
  // Summed-area tables with a zero before the first cell of each axis.
  size_t entries = 1;
  for (int a = 0; a < free_count_; ++a) {
    size_[size_t(a)] = grid.size(condition_count + a) + 1;
    entries *= size_t(size_[size_t(a)]);
  }
  mass_.assign(entries, 0.0);
  mass_square_.assign(entries, 0.0);
  square_.assign(entries, 0.0);
  const NdBox all = whole();
  for_each_cell(grid, condition_count, free_count_, all,
                [&](size_t cell, double volume, const auto& at) {
                  size_t entry = 0;
                  for (int a = 0; a < free_count_; ++a) {
                    entry = entry * size_t(size_[size_t(a)]) + size_t(at[size_t(a)] + 1);
                  }
                  const double m = mean[cell] / slice_volume_;
                  mass_[entry] = volume * m;
                  mass_square_[entry] = volume * m * m;
                  square_[entry] = volume * square[cell] / slice_volume_;
                });
  size_t stride = 1;
  for (int a = free_count_ - 1; a >= 0; --a) {
    const size_t size = size_t(size_[size_t(a)]);
    for (size_t i = 0; i < entries; ++i) {
      if (i / stride % size == 0) continue;
      mass_[i] += mass_[i - stride];
      mass_square_[i] += mass_square_[i - stride];
      square_[i] += square_[i - stride];
    }
    stride *= size;
  }
}

NdBox NdSums::whole() const { return whole_box(grid_, condition_count_, free_count_); }

double NdSums::corner_sum(const std::vector<double>& table, const NdBox& box) const {
  double sum = 0;
  for (int corner = 0; corner < 1 << free_count_; ++corner) {
    size_t entry = 0;
    bool negative = false;
    for (int a = 0; a < free_count_; ++a) {
      const bool high = corner >> a & 1;
      negative ^= !high;
      entry =
          entry * size_t(size_[size_t(a)]) + size_t(high ? box.hi[size_t(a)] : box.lo[size_t(a)]);
    }
    sum += negative ? -table[entry] : table[entry];
  }
  return std::fmax(sum, 0.0);  // a difference of sums falls slightly below 0 in empty parts
}

NdMoments NdSums::moments(const NdBox& box) const {
  NdMoments m;
  m.volume = 1;
  for (int a = 0; a < free_count_; ++a) {
    const std::vector<double>& edges = grid_.edges[size_t(condition_count_ + a)];
    m.volume *= edges[size_t(box.hi[size_t(a)])] - edges[size_t(box.lo[size_t(a)])];
  }
  m.mass = corner_sum(mass_, box);
  m.mass_square = corner_sum(mass_square_, box);
  m.square = corner_sum(square_, box);
  return m;
}

std::vector<std::vector<NdBuildNode>> build_blocks(const std::vector<NdSums>& slices, int count,
                                                   SplitCriterion criterion, int free_count) {
  std::vector<std::vector<NdBuildNode>> trees(slices.size());
  std::priority_queue<Candidate> queue;
  int64_t order = 0;
  const auto offer = [&](int32_t tree, int32_t node) {
    double priority = 0;
    const Plane plane =
        best_block_plane(slices[size_t(tree)], trees[size_t(tree)][size_t(node)].box, criterion,
                         free_count, &priority);
    if (plane.axis >= 0) queue.push({priority, tree, node, plane, order++});
  };
  for (size_t s = 0; s < slices.size(); ++s) {
    trees[s].resize(1);
    trees[s][0].box = slices[s].whole();
    offer(int32_t(s), 0);
  }
  for (int made = int(slices.size()); made < count && !queue.empty(); ++made) {
    const Candidate top = queue.top();
    queue.pop();
    split_node(&trees[size_t(top.tree)], top.node, top.plane);
    const int32_t child = trees[size_t(top.tree)][size_t(top.node)].first_child;
    offer(top.tree, child);
    offer(top.tree, child + 1);
  }
  return trees;
}

}  // namespace skytree
