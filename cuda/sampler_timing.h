// SPDX-License-Identifier: GPL-3.0-or-later
// How long a GPU takes to draw directions and to do nothing else.
#pragma once

#include <vector>

#include "kernel/env_sampler.h"

namespace skytree::cuda {

struct SamplerTiming {
  std::vector<double> seconds;  // of one launch, mean of a few without a wait, by the wall's clock
  std::vector<float> sums;      // what draw_samples returned, by thread
};

/// Times draw_samples on GPU `ordinal`: `threads` threads, `samples` directions each, once to warm
/// up and `repetitions` times by the clock. Throws Error.
SamplerTiming time_sampler(int ordinal, const EnvSamplerView& sampler, uint32_t threads,
                           uint32_t samples, int repetitions);

}  // namespace skytree::cuda
