// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "src/environment_sampler.h"
#include "src/large_array.h"

namespace skytree {

/// Marginal and conditional distribution functions over texels, weighted by solid angle times the
/// mean interpolated luminance. A black map is sampled uniformly.
class InversionSampler : public EnvironmentSampler {
 public:
  /// guided: search from a table of starting points, else by plain binary search. `threads` build,
  /// 0: all cores; the tables do not depend on it. Throws std::invalid_argument for an empty image.
  explicit InversionSampler(const LatLongImage& image, bool guided = true, int threads = 0);

  EnvSamplerView view() const override;
  size_t nbytes() const override;
  double build_seconds() const { return build_seconds_; }

 private:
  int width_, height_;
  std::vector<float> marginal_;
  LargeArray<float> conditional_;
  std::vector<RowWarp> rows_;
  std::vector<uint16_t> marginal_guide_;
  LargeArray<uint16_t> conditional_guide_;
  double build_seconds_ = 0;
};

}  // namespace skytree
