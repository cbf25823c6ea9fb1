// SPDX-License-Identifier: GPL-3.0-or-later
// Growth of the kd-tree: Ergun, Kurt and Ozturk, SCCG 2012, section "Kd-tree Construction". Keep a
// list of blocks, split the one with the largest variation, until the wanted number exists.
#pragma once

#include <functional>
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

/// Fewer blocks come out if no block with variation is left: a constant map stays one block.
/// Depends on the image and the arguments only; equal variations split in order of creation.
BuildTree build_kdtree(const ImageStatistics& statistics, int block_count, SplitCriterion criterion,
                       const BuildProgress& progress);
/// What the builder reads, with the reading as the first part of the progress.
ImageStatistics read_statistics(const LatLongImage& image, Statistics statistics,
                                const BuildProgress& progress);

}  // namespace skytree
