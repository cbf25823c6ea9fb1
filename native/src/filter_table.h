// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

namespace skytree {

enum class PixelFilter { kBox, kGaussian, kBlackmanHarris };

/// Inverse cumulative distribution for kernel/filter.h, of the filter that Cycles draws for the
/// same name and width (pixels). Box is one pixel wide whatever the width, as in Cycles. Throws
/// std::invalid_argument for a width that is not positive.
std::vector<float> make_filter_table(PixelFilter filter, double width);

}  // namespace skytree
