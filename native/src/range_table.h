// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "src/image_statistics.h"

namespace skytree {

/// Smallest and largest luminance in rectangles of a map, for SplitCriterion::RANGE: whole tiles
/// from a table, the rest from the image.
class RangeTable {
 public:
  /// Keeps a reference to the plane.
  RangeTable(const LuminancePlane& luminance, ThreadTeam& team);

  /// Largest minus smallest.
  double range(const TexelRect& rect) const;
  size_t nbytes() const { return tiles_.size() * sizeof(Bounds); }

 private:
  static constexpr int kTile = ImageStatistics::kTile;
  struct Bounds {
    float smallest, largest;
  };

  /// Of at most kTile columns.
  void include_texels(const TexelRect& rect, Bounds* bounds) const;

  const LuminancePlane& luminance_;
  int columns_;
  std::vector<Bounds> tiles_;
};

}  // namespace skytree
