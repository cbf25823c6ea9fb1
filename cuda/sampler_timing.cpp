// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/sampler_timing.h"

#include <chrono>

#include "cuda/device_sampler.h"
#include "cuda/kernel_parameters.h"

namespace skytree::cuda {

/// Launches that follow each other without a wait, and so hide what starting them costs.
constexpr int kLaunchesTogether = 4;

SamplerTiming time_sampler(int ordinal, const EnvSamplerView& sampler, uint32_t threads,
                           uint32_t samples, int repetitions) {
  using Clock = std::chrono::steady_clock;
  const ContextPointer context = Context::acquire(ordinal);
  const DeviceSampler tables(context, sampler);
  const Buffer sums(context, sizeof(float) * threads);
  const Stream stream(context);
  const DrawParameters parameters = {tables.view(), sums.writable<float>(), threads, samples};
  SamplerTiming timing;
  for (int i = 0; i <= repetitions; ++i) {
    const Clock::time_point started = Clock::now();
    for (int k = 0; k < kLaunchesTogether; ++k) {
      launch(*context, stream, "draw_directions", (threads + kThreads - 1) / kThreads, kThreads,
             parameters);
    }
    stream.synchronize();
    const double seconds = std::chrono::duration<double>(Clock::now() - started).count();
    if (i > 0) timing.seconds.push_back(seconds / kLaunchesTogether);
  }
  timing.sums.resize(threads);
  sums.download(timing.sums.data(), sums.bytes());
  return timing;
}

}  // namespace skytree::cuda
