// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "src/environment_image.h"
#include "src/large_array.h"

namespace skytree {

/// Luminance of a map, filled row by row, with the wrapped neighbours at either end of each row:
/// at(-1) and at(width) of a row may be read.
class LuminancePlane {
 public:
  LuminancePlane(int width, int height);

  /// Reads row y of the image; every row must be read once before it is used.
  void read_row(const LatLongImage& image, int y, BadTexels* bad);
  /// Texel 0 of row y; rows above and below the map repeat its first and last, as the look-up
  /// clamps there.
  const float* row(int y) const {
    y = y < 0 ? 0 : y < height_ ? y : height_ - 1;
    return values_.data() + (int64_t)y * stride_ + 1;
  }
  int width() const { return width_; }
  int height() const { return height_; }

 private:
  int width_, height_;
  int64_t stride_;
  LargeArray<float> values_;
};

}  // namespace skytree
