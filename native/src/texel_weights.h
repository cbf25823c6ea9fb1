// SPDX-License-Identifier: GPL-3.0-or-later
// What the rivals of the kd-tree sample: for every texel the mean over the texel of the
// interpolated luminance. The renderer interpolates between texel centres, so light spills over a
// texel's border; a weight from the texel's own value alone would give pdf 0 where there is
// radiance.
#pragma once

#include <vector>

#include "src/environment_image.h"

namespace skytree {

/// Reads an image top to bottom once and hands out rows of weights (without the solid angle).
class TexelWeightRows {
 public:
  explicit TexelWeightRows(const LatLongImage& image);

  /// The next row, width floats, valid until the next call: [1 6 1]/8 across and down, wrapping in
  /// x and clamped at the poles as the look-up does.
  const float* next();
  const BadTexels& bad_texels() const { return bad_; }

 private:
  void load(int y, std::vector<float>& row);

  const LatLongImage& image_;
  int y_ = 0;
  std::vector<float> above_, centre_, below_, column_, weights_;
  BadTexels bad_;
};

}  // namespace skytree
