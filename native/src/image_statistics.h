// SPDX-License-Identifier: GPL-3.0-or-later
// Sums over rectangles of a map, for the kd-tree builder: solid angle, power (integral of L) and
// square (integral of L^2), in constant time whatever the rectangle.
//
// A summed-area table (Crow, SIGGRAPH 1984) at every texel would be written once per texel, in
// double, and that alone takes longer than building the rivals' tables. Two strip tables are kept
// instead: one is exact in x and knows every kTile-th border in y, the other the reverse. A
// rectangle is an inner part whose borders in y are known to the first, thin parts above and below
// whose borders in x are known to the second, and at most eight corners that are read from the
// image. Every part holds only what lies inside the rectangle: a sun outside adds nothing, not even
// rounding.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "src/luminance_plane.h"
#include "src/moment_rows.h"
#include "src/tree_grid.h"

namespace skytree {

/// What is measured.
enum class Statistics {
  RADIANCE,  ///< weighted by solid angle; L as the renderer looks it up, interpolated between texel
             ///< centres
  PIXELS,    ///< the paper's: every pixel counts alike, with its own value
  CELLS,     ///< as RADIANCE, but of cells between texel centres (TreeGrid) in place of texels
};

/// What is summed: L or L^2.
enum class Quantity { POWER, SQUARE };

/// Sums over texels. In Statistics::PIXELS the solid angle is the number of pixels.
struct Moments {
  double power, square;
};

inline Moments operator+(Moments a, Moments b) { return {a.power + b.power, a.square + b.square}; }

/// Texels or cells [lo[0], hi[0]) x [lo[1], hi[1]); axis 0 is x, axis 1 is y.
struct TexelRect {
  int32_t lo[2], hi[2];

  int32_t size(int axis) const { return hi[axis] - lo[axis]; }
  int64_t area() const { return (int64_t)size(0) * size(1); }
};

struct StripSums;

/// Sums of corners that a thread has read, as a block's corners come up again and again; a new one
/// takes the place of an old one. What is remembered changes no sum.
class CornerSums {
  static constexpr int kSlots = 8192;
  struct Slot {
    uint64_t key = 0;
    Moments sum{};
  };

 public:
  CornerSums() : slots_(kSlots) {}

  static constexpr size_t nbytes() { return kSlots * sizeof(Slot); }

 private:
  friend class ImageStatistics;

  Slot& slot(uint64_t key) { return slots_[key * 0x9e3779b97f4a7c15u >> 51]; }

  std::vector<Slot> slots_;
};

/// Immutable once built: threads may share it.
class ImageStatistics {
 public:
  static constexpr int kTile = 16;

  /// `keep_going` is asked now and then with the share that is done and stops the work by throwing.
  ImageStatistics(std::shared_ptr<const LuminancePlane> luminance, Statistics statistics,
                  ThreadTeam& team, const std::function<void(double done)>& keep_going);

  const TreeGrid& grid() const { return grid_; }
  int extent(int axis) const { return axis == 0 ? grid_.columns() : grid_.rows(); }
  Moments sum(const TexelRect& rect, CornerSums* known = nullptr) const;
  /// Solid angle in steradians, or the number of pixels.
  double solid_angle(const TexelRect& rect) const {
    return rect.size(0) * (cumulative_rows_[rect.hi[1]] - cumulative_rows_[rect.lo[1]]);
  }
  /// One sum for each coordinate of `axis` in the rectangle, at most kTile of them: out[i] belongs
  /// to rect.lo[axis] + i. The inner slices are what the tables know; adding the rim, read from the
  /// image, makes them complete.
  void inner_slices(const TexelRect& rect, int axis, Quantity quantity, double* out) const;
  void add_rim_slices(const TexelRect& rect, int axis, Quantity quantity, double* out) const;
  /// Sum over a rectangle with lo[axis] and hi[axis] on tile borders: from the tables alone.
  double aligned_sum(const TexelRect& rect, int axis, Quantity quantity) const;
  /// Borders of tiles along an axis: multiples of kTile, and the end of the image.
  int first_border_from(int32_t coordinate) const { return (coordinate + kTile - 1) / kTile; }
  int last_border_until(int axis, int32_t coordinate) const {
    return coordinate == extent(axis) ? (coordinate + kTile - 1) / kTile : coordinate / kTile;
  }
  int32_t border(int axis, int index) const;

  const LuminancePlane& luminance() const { return *plane_; }
  /// Statistics::CELLS: the weights of row y.
  const CellRow& cell_row(int y) const { return cell_rows_[y]; }
  const BadTexels& bad_texels() const { return plane_->bad_texels(); }
  /// Of the tables, the luminance left out.
  size_t nbytes() const;

 private:
  void build(ThreadTeam& team, const std::function<void(double)>& keep_going);
  /// Sums of a strip of tiles by column, and of each of its rows by tile, both from the image's
  /// left.
  void sum_strip(int strip, StripSums* sums);
  TexelRect inner_part(const TexelRect& rect, int axis) const;
  Moments aligned_moments(const TexelRect& rect, int axis) const;
  Moments thin_sum(const TexelRect& rect, CornerSums* known) const;
  /// Of at most kTile x kTile texels, read from the image.
  Moments corner_sum(const TexelRect& rect, CornerSums* known) const;
  /// Values of texels [x, x + count) of row y.
  void moments_of_row(int x, int y, int count, Quantity quantity, float* out) const;
  /// Values of a patch of at most kTile x kTile texels, rows kTile apart; beyond its columns
  /// something is written, too.
  void load_patch(const TexelRect& rect, Quantity quantity, float* values) const;

  std::shared_ptr<const LuminancePlane> plane_;
  Statistics statistics_;
  TreeGrid grid_;
  std::vector<CellRow> cell_rows_;
  std::vector<CellFactors> cell_factors_;
  std::vector<double> row_weights_;      // of a texel
  std::vector<double> cumulative_rows_;  // height + 1
  // tables_[quantity][a]: exact along axis a, tile borders along the other; sums from the image's
  // origin.
  LargeArray<double> tables_[2][2];
};

}  // namespace skytree
