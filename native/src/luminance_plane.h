// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>

#include "src/environment_image.h"
#include "src/large_array.h"
#include "src/thread_team.h"

namespace skytree {

/// Luminance of a map with the wrapped neighbours at either end of each row: columns -1 to width of
/// a row may be read, and up to kSlack more, which mean nothing.
class LuminancePlane {
 public:
  static constexpr int kSlack = 8;

  /// Reads the image once. `keep_going` is asked now and then with the share that is done and stops
  /// the work by throwing.
  LuminancePlane(const LatLongImage& image, ThreadTeam& team,
                 const std::function<void(double done)>& keep_going);

  /// Texel 0 of row y; rows above and below the map repeat its first and last, as the look-up
  /// clamps there.
  const float* row(int y) const {
    y = y < 0 ? 0 : y < height_ ? y : height_ - 1;
    return values_.data() + (int64_t)y * stride_ + 1;
  }
  int width() const { return width_; }
  int height() const { return height_; }
  const BadTexels& bad_texels() const { return bad_; }
  size_t nbytes() const { return values_.nbytes(); }

 private:
  int width_, height_;
  int64_t stride_;
  LargeArray<float> values_;
  BadTexels bad_;
};

}  // namespace skytree
