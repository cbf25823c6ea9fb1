// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/film_tiles.h"

namespace skytree {

FilmTiles::FilmTiles(int width, int height, int x0, int y0, int x1, int y1)
    : first_column(x0 / kTileSize),
      first_row(y0 / kTileSize),
      columns((x1 + kTileSize - 1) / kTileSize - first_column),
      rows((y1 + kTileSize - 1) / kTileSize - first_row),
      width_(width),
      height_(height),
      x0_(x0),
      y0_(y0),
      x1_(x1),
      y1_(y1) {}

void FilmTiles::append_sample(int tile, uint32_t sample, std::vector<TilePath>* paths) const {
  const int left = column(tile) * kTileSize, low = row(tile) * kTileSize;
  for (int i = 0; i < kTilePixels; ++i) {
    const int pixel = tile_order(i);
    if (left + pixel % kTileSize >= width_ || low + pixel / kTileSize >= height_) continue;
    paths->push_back({uint32_t(pixel), sample});
  }
}

void FilmTiles::append_planned(const SamplePlan& plan, int tile, int64_t begin, int64_t end,
                               uint32_t first_sample, std::vector<TilePath>* paths) const {
  // Pixel by pixel: rays of one pixel are as alike as rays can be.
  for (int i = 0; i < kTilePixels; ++i) {
    const uint32_t pixel = uint32_t(tile_order(i));
    size_t place;
    if (!find_pixel(tile, pixel, &place)) continue;
    const uint32_t last = plan.samples_at(place, end);
    for (uint32_t k = plan.samples_at(place, begin); k < last; ++k) {
      paths->push_back({pixel, first_sample + k});
    }
  }
}

}  // namespace skytree
