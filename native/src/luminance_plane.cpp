// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/luminance_plane.h"

namespace skytree {

LuminancePlane::LuminancePlane(int width, int height) : width_(width), height_(height) {
  // An odd number of cache lines: columns of a map whose width is a power of two would meet in one
  // cache set.
  stride_ = ((width + 2 + 15) / 16 | 1) * 16;
  values_ = LargeArray<float>((size_t)(stride_ * height));
}

void LuminancePlane::read_row(const LatLongImage& image, int y, BadTexels* bad) {
  float* row = values_.data() + y * stride_ + 1;
  luminance_row(image, y, row, bad);
  row[-1] = row[width_ - 1];
  row[width_] = row[0];
}

}  // namespace skytree
