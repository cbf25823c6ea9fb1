// SPDX-License-Identifier: GPL-3.0-or-later
// Growth of the kd-tree: Ergun, Kurt and Ozturk, SCCG 2012, section "Kd-tree Construction". Keep a
// list of blocks, split the one with the largest variation, until the wanted number exists.
#pragma once

#include <functional>
#include <memory>
#include <stdexcept>
#include <vector>

#include "src/split_criterion.h"

namespace skytree {

/// Children are neighbours in the list: first_child and first_child + 1; first_child is -1 in a
/// leaf (a block).
struct BuildNode {
  TexelRect rect;
  Moments moments;
  int32_t first_child = -1;
  int32_t axis = -1, position = 0;  // of the plane, in texels
};

/// Thrown when the progress callback asked to stop.
class BuildCancelled : public std::runtime_error {
 public:
  BuildCancelled()
      : std::runtime_error("building the kd-tree was cancelled by its progress callback") {}
};

/// Called with the share that is done; returning false stops the build with BuildCancelled.
using BuildProgress = std::function<bool(double done)>;

struct BuildTree {
  std::vector<BuildNode> nodes;  // the root first, in order of creation
  int32_t block_count = 1;
  BadTexels bad_texels;
};

/// A kd-tree that grows on demand. The first n - 1 splits of a larger tree are those of the tree
/// with n blocks, so that a smaller one costs nothing and a larger one what is added. Depends on
/// the image and the criterion only; equal variations split in order of creation.
class TreeGrowth {
 public:
  TreeGrowth(std::shared_ptr<const ImageStatistics> statistics, SplitCriterion criterion,
             ThreadTeam& team);
  ~TreeGrowth();

  /// Fewer blocks come out if no block with variation is left: a constant map stays one block.
  /// After a BuildCancelled it may be asked again. For one thread at a time.
  BuildTree tree(int block_count, ThreadTeam& team, const BuildProgress& progress);
  /// Of the tree so far, the statistics left out.
  size_t nbytes() const;

 private:
  class Builder;
  std::unique_ptr<Builder> builder_;
};

/// A tree that is grown once.
BuildTree build_kdtree(const LatLongImage& image, Statistics statistics, int block_count,
                       SplitCriterion criterion, const BuildProgress& progress);
/// What a builder reads of a map, with the reading as the first part of the progress.
std::shared_ptr<const LuminancePlane> read_luminance(const LatLongImage& image, ThreadTeam& team,
                                                     const BuildProgress& progress);
std::shared_ptr<const ImageStatistics> measure_statistics(
    std::shared_ptr<const LuminancePlane> luminance, Statistics statistics, ThreadTeam& team,
    const BuildProgress& progress);

}  // namespace skytree
