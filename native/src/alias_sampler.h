// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "src/environment_sampler.h"
#include "src/large_array.h"
#include "src/map_statistics.h"

namespace skytree {

/// Alias table over texels, with the weights of InversionSampler. A black map is sampled uniformly.
class AliasSampler : public EnvironmentSampler {
 public:
  /// Throws std::invalid_argument for an empty image. `threads` build, 0: all cores; the table does
  /// not depend on it.
  explicit AliasSampler(const LatLongImage& image, int threads = 0);
  /// The same with the luminance that other builds of the map have read, or leaving it for others.
  /// `map` is not kept.
  explicit AliasSampler(MapStatistics& map, int threads = 0);

  EnvSamplerView view() const override;
  size_t nbytes() const override;
  double build_seconds() const { return build_seconds_; }

 private:
  void build(const LuminancePlane& plane, ThreadTeam& team);

  int width_ = 0, height_ = 0;
  LargeArray<AliasEntry> entries_;
  std::vector<AliasRow> rows_;
  double build_seconds_ = 0;
};

}  // namespace skytree
