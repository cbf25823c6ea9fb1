// SPDX-License-Identifier: GPL-3.0-or-later
// What the rivals of the kd-tree sample: for every texel the mean over the texel of the
// interpolated luminance. The renderer interpolates between texel centres, so light spills over a
// texel's border; a weight from the texel's own value alone would give pdf 0 where there is
// radiance.
#pragma once

#include <functional>
#include <vector>

#include "src/environment_image.h"
#include "src/thread_team.h"

namespace skytree {

/// Reads an image from row `first` downwards and hands out rows of weights (without the solid
/// angle).
class TexelWeightRows {
 public:
  TexelWeightRows(const LatLongImage& image, int first);

  /// The next row, width floats, valid until the next call: [1 6 1]/8 across and down, wrapping in
  /// x and clamped at the poles as the look-up does.
  const float* next();
  /// In the rows that were handed out.
  const BadTexels& bad_texels() const { return bad_; }

 private:
  const LatLongImage& image_;
  int y_;
  std::vector<float> above_, centre_, below_, column_, weights_;
  BadTexels bad_, bad_below_;
};

/// use(worker, y, row y's weights) for every row, on the team's threads, in any order; returns the
/// bad texels.
BadTexels for_texel_weights(
    const LatLongImage& image, ThreadTeam& team,
    const std::function<void(int worker, int y, const float* weights)>& use);

}  // namespace skytree
