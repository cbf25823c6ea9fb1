// SPDX-License-Identifier: GPL-3.0-or-later
// The tiles that a render's region of the film is cut into, and the paths that make a tile's
// samples. The grid is fixed to the film: where a region begins changes no tile.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "src/sample_plan.h"
#include "src/tile_integrator.h"

namespace skytree {

class FilmTiles {
 public:
  FilmTiles() = default;
  /// The region (x0,y0)-(x1,y1) of a film of width x height pixels.
  FilmTiles(int width, int height, int x0, int y0, int x1, int y1);

  int count() const { return columns * rows; }
  size_t pixel_count() const { return size_t(x1_ - x0_) * (y1_ - y0_); }
  /// A tile's place in the film's grid.
  int column(int tile) const { return first_column + tile % columns; }
  int row(int tile) const { return first_row + tile / columns; }

  /// A tile's pixel, as in TilePath: whether it lies in the region, and where, row by row.
  bool find_pixel(int tile, uint32_t pixel, size_t* place) const {
    const int x = column(tile) * kTileSize + int(pixel % kTileSize);
    const int y = row(tile) * kTileSize + int(pixel / kTileSize);
    *place = size_t(y - y0_) * size_t(x1_ - x0_) + size_t(x - x0_);
    return x >= x0_ && y >= y0_ && x < x1_ && y < y1_;
  }

  /// Calls visit(place of the first, count) for each row of the tile's pixels in the region.
  template <class Visit>
  void for_each_row(int tile, Visit visit) const {
    const int left = std::max(column(tile) * kTileSize, x0_);
    const int right = std::min((column(tile) + 1) * kTileSize, x1_);
    const int high = std::min((row(tile) + 1) * kTileSize, y1_);
    for (int y = std::max(row(tile) * kTileSize, y0_); y < high; ++y) {
      visit(size_t(y - y0_) * size_t(x1_ - x0_) + size_t(left - x0_), size_t(right - left));
    }
  }

  /// Sample `sample` of all of the tile's pixels, also of those beyond the region: which rays share
  /// a packet must not depend on it.
  void append_sample(int tile, uint32_t sample, std::vector<TilePath>* paths) const;
  /// The samples that the plan has for the tile's pixels between `begin` and `end` samples in the
  /// mean, counted from `first_sample`.
  void append_planned(const SamplePlan& plan, int tile, int64_t begin, int64_t end,
                      uint32_t first_sample, std::vector<TilePath>* paths) const;

  int first_column = 0, first_row = 0, columns = 0, rows = 0;

 private:
  int width_ = 0, height_ = 0, x0_ = 0, y0_ = 0, x1_ = 0, y1_ = 0;
};

}  // namespace skytree
