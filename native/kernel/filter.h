// SPDX-License-Identifier: GPL-3.0-or-later
// Pixel filters by importance sampling: every sample belongs to one pixel and its position in the
// pixel's filter is drawn from the filter itself, so no weights and no traffic between pixels. M.
// Ernst et al., "Filter Importance Sampling", IEEE Symposium on Interactive Ray Tracing 2006.
#pragma once

#include "kernel/vec.h"

namespace skytree {

/// Inverse of the filter's cumulative distribution at i/(kFilterTableSize-1), in pixels from the
/// pixel's centre.
constexpr int kFilterTableSize = 1024;

SKY_HD float sample_filter(const float* table, float u) {
  const float position = u * (kFilterTableSize - 1);
  const int i = static_cast<int>(position);
  const float fraction = position - static_cast<float>(i);
  return table[i] + (table[i + 1] - table[i]) * fraction;
}

}  // namespace skytree
