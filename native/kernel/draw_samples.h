// SPDX-License-Identifier: GPL-3.0-or-later
// What the microbenchmark of the samplers times: nothing but drawing directions.
#pragma once

#include "kernel/env_sampler.h"
#include "kernel/rng.h"

namespace skytree {

/// Draws `count` directions with random numbers of `thread`, made as the renderer makes them, and
/// returns a sum that depends on every one of them.
SKY_HD float draw_samples(const EnvSamplerView& sampler, uint32_t thread, uint32_t count) {
  const uint32_t seed = pixel_seed(0, thread, 0);
  float sum = 0.0f;
  for (uint32_t i = 0; i < count; ++i) {
    const Vec2 pair = inlined_random_pair(seed, i, 0);
    const DirectionSample sample =
        sample_environment(sampler, {inlined_random_pair(seed, i, 1).x, pair.x, pair.y});
    sum += sample.direction.x + sample.direction.y + sample.direction.z + 1.0f / sample.pdf;
  }
  return sum;
}

}  // namespace skytree
