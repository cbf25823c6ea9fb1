// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "src/kdtree_builder.h"
#include "src/linear_fit.h"

namespace skytree {

/// What samplers of one map have in common: its luminance, sums over it and trees as far as they
/// have been grown, each made when first asked for. A sampler that is built with it is the same to
/// the bit as one built from the image.
///
/// For any thread: builds of one map wait for each other.
class MapStatistics {
 public:
  /// The texels are read when something is asked for, and must not change. Throws
  /// std::invalid_argument for an empty image.
  explicit MapStatistics(const LatLongImage& image);

  const LatLongImage& image() const { return image_; }
  /// Bytes kept so far: for a map of W x H texels 4 W H of luminance and 2 W H for each kind of
  /// statistics, with a few MB of trees.
  size_t nbytes() const;

  std::shared_ptr<const LuminancePlane> luminance(ThreadTeam& team);
  struct Tree {
    std::shared_ptr<const ImageStatistics> statistics;
    BuildTree tree;
    /// Statistics::CELLS: by node, what measure_tilt says of the tree's blocks.
    std::vector<TiltMoments> tilts;
  };
  /// As TreeGrowth::tree.
  Tree tree(Statistics statistics, SplitCriterion criterion, int block_count, ThreadTeam& team,
            const BuildProgress& progress);

 private:
  struct Growth {
    Growth(std::shared_ptr<const ImageStatistics> statistics, SplitCriterion criterion,
           ThreadTeam& team)
        : tree(std::move(statistics), criterion, team) {}

    TreeGrowth tree;
    std::vector<TiltMoments> tilts;
    std::vector<bool> has_tilt;  // nodes that have been blocks of a tree asked for
  };

  void measure_tilts(Growth* growth, Tree* tree, ThreadTeam& team) const;

  const LatLongImage image_;
  mutable std::mutex mutex_;
  std::shared_ptr<const LuminancePlane> luminance_;
  std::map<Statistics, std::shared_ptr<const ImageStatistics>> statistics_;
  std::map<std::pair<Statistics, SplitCriterion>, std::unique_ptr<Growth>> growths_;
};

}  // namespace skytree
