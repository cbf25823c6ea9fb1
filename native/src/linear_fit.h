// SPDX-License-Identifier: GPL-3.0-or-later
// The tilts of a block with linear density (kernel/linear_blocks.h), from the cells in it.
#pragma once

#include "src/image_statistics.h"

namespace skytree {

/// Moments of a block over its solid angle, in coordinates that make those of parts add up.
struct TiltMoments {
  double power = 0;   // integral of L
  double square = 0;  // of L^2
  double along = 0;   // of L times the column
  double down = 0;    // of L times h from +Z
};

inline TiltMoments operator+(const TiltMoments& a, const TiltMoments& b) {
  return {a.power + b.power, a.square + b.square, a.along + b.along, a.down + b.down};
}

/// Density (1 + along (2p - 1)) (1 + down (2q - 1)) of a block, q from its upper border.
struct Tilts {
  double along = 0, down = 0;
};

/// With the block's exact sums; the light's mean position comes from some of its rows. `statistics`
/// must be of Statistics::CELLS.
TiltMoments measure_tilt(const ImageStatistics& statistics, const TexelRect& rect,
                         const Moments& exact);

/// The least-squares tilts, 3 E[L (2p - 1)] / E[L], kept off 1 so that the density has no zero.
Tilts tilts_of(const TreeGrid& grid, const TexelRect& rect, const TiltMoments& moments);

/// About sqrt(solid angle * integral of L^2 / g), g the density of tilts_of: what such a block adds
/// to the root of an estimator's second moment.
double approximate_cost(const ImageStatistics& statistics, const TexelRect& rect,
                        const TiltMoments& moments);

/// Tilts of least integral of L^2 / g, and that integral.
struct FittedTilts {
  Tilts tilts;
  double integral = 0;
};
FittedTilts fit_tilts(const ImageStatistics& statistics, const TexelRect& rect,
                      const TiltMoments& moments);

}  // namespace skytree
