// SPDX-License-Identifier: GPL-3.0-or-later
// Product sampling by resampling, for comparison and teaching: of M candidate directions, half by
// the environment sampler and half by the BSDF, one is kept in proportion to BSDF times radiance
// and only that one is traced. Burke, Ghosh and Heidrich, "Bidirectional Importance Sampling for
// Direct Illumination", EGSR 2005 (their SIR); in the unbiased form of Talbot, Cline and Egbert,
// "Importance Resampling for Global Illumination", EGSR 2005.
//
// The two kinds of candidates form one pool: each weighs its target by the sum of the densities
// that could have made it. Only the choice among candidates must be independent of them: they
// themselves may be shifted copies of one stratified point.
#pragma once

#include "kernel/rng.h"
#include "kernel/scene_view.h"

namespace skytree {

/// The light sample of a vertex as resampling draws it.
struct ResampledLight {
  Vec3 direction;  // world
  Vec3 f;          // BSDF and cosine
  float pdf;       // f times the radiance of `direction` by this is the estimate
};

/// Point number `index` of a lattice (the additive recurrence by the plastic number's kin in three
/// dimensions) shifted by u, in [0,1)^3.
SKY_HD Vec3 shifted_point(Vec3 u, int index) {
  const Vec3 at = u + Vec3{0.819172513396f, 0.671043606704f, 0.549700477902f} * (float)index;
  return {minf(at.x - floorf(at.x), kOneMinusEpsilon), minf(at.y - floorf(at.y), kOneMinusEpsilon),
          minf(at.z - floorf(at.z), kOneMinusEpsilon)};
}

/// light_u as sample_environment takes it, bsdf_u: lobe, then its pair; `choice` is independent of
/// both. False if no candidate brings light.
SKY_HD_RARE bool resample_light(const EnvironmentView& environment, const Surface& surface,
                                const Shading& shading, Vec3 view, int candidates,
                                bool with_bsdf_candidates, Vec3 light_u, Vec3 bsdf_u, float choice,
                                ResampledLight* chosen) {
  const int of_bsdf = with_bsdf_candidates ? candidates / 2 : 0;
  const int of_light = candidates - of_bsdf;
  float total = 0.0f, chosen_target = 0.0f;
  for (int i = 0; i < candidates; ++i) {
    Vec3 direction;
    float light_pdf;
    if (i < of_light) {
      const DirectionSample light =
          sample_environment(environment.sampler, shifted_point(light_u, i));
      direction = transpose_mul(environment.world_to_env, light.direction);
      light_pdf = light.pdf;
    } else {
      const Vec3 u = shifted_point(bsdf_u, i - of_light);
      direction = sample_bsdf(shading, view, u.x, {u.y, u.z});
      light_pdf = environment_pdf(environment.sampler, environment.world_to_env * direction);
    }
    const BsdfValue bsdf = eval_bsdf(shading, surface, view, direction);
    if (!(max_component(bsdf.f) > 0.0f)) continue;
    const float density = (float)of_light * light_pdf + (float)of_bsdf * bsdf.pdf;
    const float target = luminance(
        bsdf.f * lookup_bilinear(environment.image, environment.world_to_env * direction));
    const float weight = target / density;
    if (!(weight > 0.0f) || !(weight < INFINITY)) continue;
    // Keeps the newcomer with its share of the total; the number is stretched to be used again.
    const float share = weight / (total + weight);
    total += weight;
    if (choice < share) {
      choice = minf(choice / share, kOneMinusEpsilon);
      chosen->direction = direction;
      chosen->f = bsdf.f;
      chosen_target = target;
    } else {
      choice = minf((choice - share) / (1.0f - share), kOneMinusEpsilon);
    }
  }
  if (!(total > 0.0f)) return false;
  chosen->pdf = chosen_target / total;
  return true;
}

}  // namespace skytree
