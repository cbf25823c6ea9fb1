// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/range_table.h"

#include <algorithm>
#include <cfloat>

namespace skytree {

RangeTable::RangeTable(const LatLongImage& image)
    : image_(image), columns_((image.width + kTile - 1) / kTile) {
  const int rows = (image.height + kTile - 1) / kTile;
  tiles_.assign((size_t)columns_ * rows, {FLT_MAX, 0.0f});
  std::vector<float> luminance(image.width);
  BadTexels ignored;
  for (int y = 0; y < image.height; ++y) {
    luminance_row(image, y, luminance.data(), &ignored);
    Bounds* row = &tiles_[(size_t)(y / kTile) * columns_];
    for (int x = 0; x < image.width; ++x) {
      Bounds& tile = row[x / kTile];
      tile.smallest = std::min(tile.smallest, luminance[x]);
      tile.largest = std::max(tile.largest, luminance[x]);
    }
  }
}

void RangeTable::include_texels(const TexelRect& rect, Bounds* bounds) const {
  for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
    const float* row = image_.texels + 3 * (int64_t)y * image_.width;
    for (int x = rect.lo[0]; x < rect.hi[0]; ++x) {
      const float l = texel_luminance(row + 3 * (int64_t)x);
      bounds->smallest = std::min(bounds->smallest, l);
      bounds->largest = std::max(bounds->largest, l);
    }
  }
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
