// SPDX-License-Identifier: GPL-3.0-or-later
// Median cut: P. Debevec, "A Median Cut Algorithm for Light Probe Sampling", SIGGRAPH 2005 poster.
// All regions are cut in turn, each along its longer side, so that both parts have half of its
// power. As a rule of the kd-tree's builder (oldest block first), 2^n blocks are the paper's
// regions after n rounds.
//
// Deviations: a region that cannot be halved (its power sits in one texel) is cut as near to the
// half as texels allow, one without power stays as it is.
#pragma once

#include "src/split_criterion.h"

namespace skytree {

/// The plane nearest to the half of the power, along the side that is longer on the sphere.
Split find_median_cut(const ImageStatistics& statistics, const TexelRect& rect,
                      CornerSums* known = nullptr);

/// The paper's use of the regions: one distant point light for each.
struct PointLight {
  Vec3 direction;  // the region's centroid by luminance
  Vec3 power;      // integral of radiance over the region, RGB
};
std::vector<PointLight> make_point_lights(const LatLongImage& image,
                                          const std::vector<TexelRect>& regions);

}  // namespace skytree
