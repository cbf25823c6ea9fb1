// SPDX-License-Identifier: GPL-3.0-or-later
// The two halves of building a conditional kd-tree: slices of the condition, and blocks of what is
// sampled in each slice. Criteria as in two dimensions (src/split_criterion.h).
#pragma once

#include <vector>

#include "src/nd_grid.h"
#include "src/split_criterion.h"

namespace skytree {

/// A binary tree of boxes; children are neighbours and follow their parent.
struct NdBuildNode {
  NdBox box;
  int32_t first_child = -1;
  int axis = -1;
  int32_t position = 0;  // cell border of the plane
};

/// Cuts the condition's box, `condition_count` first axes of the grid, into at most `count` slices.
/// Each cell of the condition counts with its volume, and the rest is normalised in it: how bright
/// a view is says nothing about how it should be sampled. The slice with the largest sum of
/// squared deviations *across* the condition is cut where that falls most (equation 1 of the paper
/// along the condition alone). `conditional`: the grid's values, normalised.
std::vector<NdBuildNode> build_slices(const NdGrid& grid, const std::vector<float>& conditional,
                                      int condition_count, int count);

/// Sums over boxes of the free axes, for one slice.
struct NdMoments {
  double volume = 0;
  double mass = 0;         // integral of the mean over the slice
  double mass_square = 0;  // of the squared mean
  double square = 0;       // of the mean square: what changes within the slice included
};

class NdSums {
 public:
  NdSums(const NdGrid& grid, const std::vector<float>& conditional, int condition_count,
         const NdBox& slice);

  NdMoments moments(const NdBox& box) const;
  /// Volume of the slice in the condition.
  double slice_volume() const { return slice_volume_; }
  NdBox whole() const;

 private:
  double corner_sum(const std::vector<double>& table, const NdBox& box) const;

  int free_count_;
  const NdGrid& grid_;
  int condition_count_;
  double slice_volume_ = 0;
  std::array<int32_t, kNdMaxDimensions> size_{1, 1, 1, 1};
  std::vector<double> mass_, mass_square_, square_;
};

/// Cuts all slices into at most `count` blocks together, at least one each: always the block that
/// the criterion names, wherever it lies. Result: one tree per slice.
std::vector<std::vector<NdBuildNode>> build_blocks(const std::vector<NdSums>& slices, int count,
                                                   SplitCriterion criterion, int free_count);

}  // namespace skytree
