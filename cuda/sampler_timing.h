// SPDX-License-Identifier: GPL-3.0-or-later
// How long a GPU takes to draw directions and to do nothing else.
#pragma once

#include <vector>

#include "kernel/env_sampler.h"

namespace skytree::cuda {

struct SamplerTiming {
  std::vector<double> seconds;  // wall clock of each launch
  std::vector<float> sums;      // what draw_samples returned, by thread
};

/// Launches draw_samples on GPU `ordinal`: `threads` threads, `samples` directions each, once to
/// warm up and `launches` times by the clock. Throws Error.
SamplerTiming time_sampler(int ordinal, const EnvSamplerView& sampler, uint32_t threads,
                           uint32_t samples, int launches);

}  // namespace skytree::cuda
