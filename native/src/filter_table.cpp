// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/filter_table.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "kernel/filter.h"

namespace skytree {

std::vector<float> make_filter_table(PixelFilter filter, double width) {
  if (!(width > 0.0) || !(width <= 100.0)) {
    throw std::invalid_argument("filter_width must be above 0 and at most 100 pixels");
  }
  // Cycles' supports: Gaussian 3 widths across, Blackman-Harris 2.
  const double support =
      filter == PixelFilter::kBox ? 1.0 : (filter == PixelFilter::kGaussian ? 3.0 : 2.0) * width;
  auto weight = [&](double x) {
    if (filter == PixelFilter::kBox) return 1.0;
    if (filter == PixelFilter::kGaussian) {
      const double v = 6.0 * x / support;
      return std::exp(-2.0 * v * v);
    }
    const double v = 2.0 * M_PI * (x / support + 0.5);
    return 0.35875 - 0.48829 * std::cos(v) + 0.14128 * std::cos(2 * v) - 0.01168 * std::cos(3 * v);
  };
  constexpr int kSteps = 16384;
  std::vector<double> cumulative(kSteps + 1, 0.0);
  for (int i = 0; i < kSteps; ++i) {
    cumulative[i + 1] = cumulative[i] + weight(((i + 0.5) / kSteps - 0.5) * support);
  }
  std::vector<float> table(kFilterTableSize);
  for (int i = 0; i < kFilterTableSize; ++i) {
    const double target = cumulative[kSteps] * i / (kFilterTableSize - 1);
    const auto above = std::upper_bound(cumulative.begin(), cumulative.end(), target);
    const int cell = std::clamp(int(above - cumulative.begin()) - 1, 0, kSteps - 1);
    const double step = cumulative[cell + 1] - cumulative[cell];
    const double position = cell + (step > 0.0 ? (target - cumulative[cell]) / step : 0.0);
    table[i] = float((position / kSteps - 0.5) * support);
  }
  return table;
}

}  // namespace skytree
