// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>

#include "src/environment_image.h"

namespace skytree {

/// The grid that a tree's planes lie on: texels, or the cells between texel centres, in which the
/// interpolated map is one bilinear patch. Cell (x, y) has texel centres (x, y - 1) as its upper
/// left and (x + 1, y) as its lower right corner; the last column wraps, and the first and last row
/// are half a texel high, as the look-up clamps there.
struct TreeGrid {
  int width = 0, height = 0;  // of the map
  bool cells = false;

  int columns() const { return width; }
  int rows() const { return cells ? height + 1 : height; }
  /// u of the first column's border, in turns.
  double azimuth_origin() const { return cells ? 0.5 / width : 0.0; }
  /// Border above row y in half texels from the top.
  int half_texels(int y) const { return cells ? std::clamp(2 * y - 1, 0, 2 * height) : 2 * y; }
  /// sin^2(theta/2) of the border above row y.
  double height_at(int y) const { return height_from_north(half_texels(y), 2 * height); }
  /// The same from -Z.
  double height_from_south(int y) const {
    return height_from_north(2 * height - half_texels(y), 2 * height);
  }
  /// Whether rows [y0, y1) are nearer to -Z: there heights are measured from -Z.
  bool is_southern(int y0, int y1) const { return 2 * height - half_texels(y1) < half_texels(y0); }
  /// Height of rows [y0, y1) in h; from the nearer pole, as 1 - (tiny) would lose the digits.
  double rise(int y0, int y1) const {
    return is_southern(y0, y1) ? height_from_south(y0) - height_from_south(y1)
                               : height_at(y1) - height_at(y0);
  }
};

}  // namespace skytree
