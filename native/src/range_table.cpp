// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/range_table.h"

#include <algorithm>
#include <cfloat>

namespace skytree {

RangeTable::RangeTable(const LuminancePlane& luminance)
    : luminance_(luminance), columns_((luminance.width() + kTile - 1) / kTile) {
  const int width = luminance.width(), height = luminance.height();
  tiles_.assign((size_t)columns_ * ((height + kTile - 1) / kTile), {FLT_MAX, 0.0f});
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; x += kTile) {
      Bounds* tile = &tiles_[(size_t)(y / kTile) * columns_ + x / kTile];
      include_texels({{x, y}, {std::min(x + kTile, width), y + 1}}, tile);
    }
  }
}

void RangeTable::include_texels(const TexelRect& rect, Bounds* bounds) const {
  float smallest = bounds->smallest, largest = bounds->largest;
  for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
    const float* row = luminance_.row(y);
    for (int x = rect.lo[0]; x < rect.hi[0]; ++x) {
      smallest = row[x] < smallest ? row[x] : smallest;
      largest = row[x] > largest ? row[x] : largest;
    }
  }
  *bounds = {smallest, largest};
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
