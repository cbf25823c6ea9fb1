// SPDX-License-Identifier: GPL-3.0-or-later
// Host side of every sampler of directions: owns the tables that an EnvSamplerView points into.
// Immutable once built, so that scenes, threads and Python share one by std::shared_ptr.
#pragma once

#include <cstddef>

#include "kernel/env_sampler.h"
#include "src/environment_image.h"

namespace skytree {

class EnvironmentSampler {
 public:
  virtual ~EnvironmentSampler() = default;

  /// Valid as long as this object lives.
  virtual EnvSamplerView view() const = 0;
  /// The same with tables for product sampling, where the kind of sampler has them. Made at the
  /// first call, in some milliseconds; threads may call at once.
  virtual EnvSamplerView product_view() const { return view(); }
  /// Bytes that sampling and pdf read at run time; the image is not among them.
  virtual size_t nbytes() const = 0;
  /// Texels of the source that were left out of the statistics.
  const BadTexels& bad_texels() const { return bad_texels_; }

 protected:
  EnvironmentSampler() = default;
  EnvironmentSampler(const EnvironmentSampler&) = delete;
  EnvironmentSampler& operator=(const EnvironmentSampler&) = delete;

  BadTexels bad_texels_;
};

/// Every direction alike, 1/4 pi per steradian.
class UniformSampler : public EnvironmentSampler {
 public:
  EnvSamplerView view() const override { return {}; }
  size_t nbytes() const override { return 0; }
};

}  // namespace skytree
