// SPDX-License-Identifier: GPL-3.0-or-later
// One sampler of any kind behind one pair of functions: a tagged union of plain views.
#pragma once

#include "kernel/latlong.h"

namespace skytree {

enum class EnvSamplerType : int32_t { UNIFORM };

struct EnvSamplerView {
  EnvSamplerType type = EnvSamplerType::UNIFORM;
};

/// A unit direction in the map's frame and its density per steradian.
struct DirectionSample {
  Vec3 direction;
  float pdf;
};

SKY_HD DirectionSample sample_uniform_sphere(Vec3 u) {
  return {direction_at_height(u.y, u.z, false), kInvFourPi};
}

/// u in [0,1)^3: u.x chooses where a method chooses once, (u.y, u.z) is the pair that a method
/// warps or places inside what was chosen; a well-stratified point set should have its best pair
/// there.
SKY_HD DirectionSample sample_environment(const EnvSamplerView& sampler, Vec3 u) {
  switch (sampler.type) {
    default:
      return sample_uniform_sphere(u);
  }
}

/// Density per steradian with which sample_environment returns `direction` (unit, the map's frame).
SKY_HD float environment_pdf(const EnvSamplerView& sampler, Vec3 direction) {
  (void)direction;
  switch (sampler.type) {
    default:
      return kInvFourPi;
  }
}

}  // namespace skytree
