// SPDX-License-Identifier: GPL-3.0-or-later
// An environment map as the blocks of a kd-tree, in a file: the compression that Figure 1 of Ergun,
// Kurt and Ozturk, SCCG 2012, shows. A renderer lights from it alone.
//
// Bytes (little endian): a header, the tree in depth-first order, four bytes of colour for each
// block. Not bounds but the tree's topology is stored: one bit says whether a node is a block, one
// which axis its plane cuts, and the position takes as many bits as the node has texels to choose
// from, so that a plane costs few bits deep down in the tree. Colours share an exponent (9 bits a
// component, 5 bits of exponent above a common one), which keeps the brightest component to 0.2 %.
//
//    0  "SKYM"             8  bytes of the file    16  width, height (16 bits each)
//    4  version            12 CRC-32 of all        20  blocks
//    6  0                     other bytes          24  common exponent (16 bits), 0 (16 bits)
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "src/kdtree_builder.h"

namespace skytree {

struct CompressionConfig {
  int64_t max_bytes = 48 * 1024;  ///< of the file; the paper's
  int32_t max_blocks = INT32_MAX;
  SplitCriterion split_criterion = SplitCriterion::SSE;
  Statistics statistics = Statistics::RADIANCE;
  BuildProgress progress;
};

class CompressedMap {
 public:
  static constexpr int kVersion = 1;

  /// As many blocks as fit. Throws std::invalid_argument for an image that the builder refuses and
  /// for limits that leave room for no block.
  static CompressedMap compress(const LatLongImage& image, const CompressionConfig& config);
  /// Throws std::invalid_argument, saying what is wrong, for bytes that are not such a map, are cut
  /// short or damaged, or were written by a newer version.
  static CompressedMap decode(std::vector<uint8_t> bytes);

  const std::vector<uint8_t>& bytes() const { return bytes_; }
  int width() const { return width_; }
  int height() const { return height_; }
  /// Depth first down the tree.
  const std::vector<TexelRect>& rects() const { return rects_; }
  const std::vector<std::array<float, 3>>& colors() const { return colors_; }
  /// The whole map, RGB row by row, every block at its colour.
  void paint(float* out) const;

 private:
  std::vector<uint8_t> bytes_;
  int width_ = 0, height_ = 0;
  std::vector<TexelRect> rects_;
  std::vector<std::array<float, 3>> colors_;
};

}  // namespace skytree
