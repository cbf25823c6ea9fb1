// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "kernel/diffuse_moments.h"
#include "kernel/latlong.h"

namespace skytree {

/// Moments of the map as lookup_bilinear sees it, exact but for float rounding of its rows' sums.
/// Reads every texel once. Bad texels (src/environment_image.h) are not looked for: give the image
/// that is rendered. Throws std::invalid_argument for an empty image.
DiffuseMoments diffuse_moments(const LatLongImage& image);

/// False where radiance was so large that a sum overflowed: such moments are of no use.
bool is_finite(const DiffuseMoments& moments);

}  // namespace skytree
