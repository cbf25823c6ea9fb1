// SPDX-License-Identifier: GPL-3.0-or-later
// A map as its blocks alone tell it: the paper's Figure 1.
#pragma once

#include <array>
#include <vector>

#include "src/image_statistics.h"

namespace skytree {

/// What each of `height` rows counts for in a mean: its texels' solid angle, or 1 with PIXELS.
std::vector<double> mean_row_weights(int width, int height, Statistics statistics);

/// Mean radiance (RGB) of a block; bad texels are left out, and a block of bad texels is black.
std::array<double, 3> block_mean(const LatLongImage& image, const TexelRect& rect,
                                 const std::vector<double>& row_weights);

/// Sets the block's texels of an image (RGB row by row, `width` texels wide) to one colour.
void fill_block(const TexelRect& rect, const std::array<float, 3>& color, int width, float* out);

}  // namespace skytree
