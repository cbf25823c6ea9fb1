// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "src/environment_sampler.h"

namespace skytree {

struct FilterConfig {
  /// N: how many samples a pixel takes. It sets how wide each is filtered; taking more leaves the
  /// picture as blurred.
  int samples = 64;
  /// K: how many times the samples' solid angles overlap. 4 is the paper's, 1 that of GPU Gems 3.
  double overlap = 4.0;
};

/// Filtered importance sampling (kernel/filtered.h): the map's prefiltered chain, as the biased way
/// for a renderer to look up BSDF samples. It draws no directions: pdf() is 0 everywhere.
class FilteredMap : public EnvironmentSampler {
 public:
  /// The image is read here and must be the one that is rendered: samples that ask for no filter
  /// read it. Throws std::invalid_argument for an empty image or a setting out of range.
  explicit FilteredMap(const LatLongImage& image, const FilterConfig& config = {});

  EnvSamplerView view() const override;
  size_t nbytes() const override;
  const FilterConfig& config() const { return config_; }
  int level_count() const { return (int)levels_.size(); }
  double build_seconds() const { return build_seconds_; }

 private:
  template <typename Source>
  void add_level(int height, int source_height, const Source& source);

  FilterConfig config_;
  std::vector<float> texels_;
  std::vector<FilteredRow> rows_;
  std::vector<FilteredLevel> levels_;
  float level_offset_ = 0;
  double build_seconds_ = 0;
};

}  // namespace skytree
