// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/range_table.h"

#include <algorithm>
#include <cfloat>

#include "src/clones.h"

namespace skytree {

namespace {

SKY_CLONES void include_row(const float* __restrict row, int count, float* __restrict smallest,
                            float* __restrict largest) {
  for (int x = 0; x < count; ++x) {
    smallest[x] = row[x] < smallest[x] ? row[x] : smallest[x];
    largest[x] = row[x] > largest[x] ? row[x] : largest[x];
  }
}

}  // namespace

RangeTable::RangeTable(const LuminancePlane& luminance, ThreadTeam& team)
    : luminance_(luminance), columns_((luminance.width() + kTile - 1) / kTile) {
  const int width = luminance.width(), height = luminance.height();
  tiles_.resize((size_t)columns_ * ((height + kTile - 1) / kTile));
  team.run_chunks(height, kTile, [&](int, int first, int last) {
    std::vector<float> smallest(width, FLT_MAX), largest(width, 0.0f);
    for (int y = first; y < last; ++y) {
      include_row(luminance.row(y), width, smallest.data(), largest.data());
    }
    Bounds* tile = &tiles_[(size_t)(first / kTile) * columns_];
    for (int x = 0; x < width; x += kTile) {
      const int end = std::min(x + kTile, width);
      *tile++ = {*std::min_element(&smallest[x], smallest.data() + end),
                 *std::max_element(&largest[x], largest.data() + end)};
    }
  });
}

void RangeTable::include_texels(const TexelRect& rect, Bounds* bounds) const {
  float smallest[kTile], largest[kTile];
  std::fill_n(smallest, kTile, bounds->smallest);
  std::fill_n(largest, kTile, bounds->largest);
  for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
    include_row(luminance_.row(y) + rect.lo[0], rect.size(0), smallest, largest);
  }
  *bounds = {*std::min_element(smallest, smallest + kTile),
             *std::max_element(largest, largest + kTile)};
}

double RangeTable::range(const TexelRect& rect) const {
  Bounds bounds = {FLT_MAX, 0.0f};
  for (int y = rect.lo[1]; y < rect.hi[1];) {
    const int y_end = std::min((y / kTile + 1) * kTile, rect.hi[1]);
    for (int x = rect.lo[0]; x < rect.hi[0];) {
      const int x_end = std::min((x / kTile + 1) * kTile, rect.hi[0]);
      const TexelRect part = {{x, y}, {x_end, y_end}};
      // At the image's edge a tile may be smaller than kTile: then its texels are read, which is
      // right too.
      if (part.area() == kTile * kTile) {
        const Bounds& tile = tiles_[(size_t)(y / kTile) * columns_ + x / kTile];
        bounds.smallest = std::min(bounds.smallest, tile.smallest);
        bounds.largest = std::max(bounds.largest, tile.largest);
      } else {
        include_texels(part, &bounds);
      }
      x = x_end;
    }
    y = y_end;
  }
  return (double)bounds.largest - bounds.smallest;
}

}  // namespace skytree
