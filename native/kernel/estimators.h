// SPDX-License-Identifier: GPL-3.0-or-later
// How the samples of one vertex become its light: multiple importance sampling over several light
// samples and one BSDF sample, and a control variate for diffuse lobes.
//
// With n light samples of density p_light and one BSDF sample of density p_bsdf each sample counts
// L f / (n p_light + p_bsdf): the balance heuristic, E. Veach, "Robust Monte Carlo Methods for
// Light Transport Simulation", 1997, chapter 9.
//
// Control variate: a diffuse lobe reflects kd/pi times the integral of L V max(cos, 0). With P the
// polynomial close to max(cos, 0) of diffuse_moments.h, the integral of L P is G(n), exactly and
// for every normal. So G(n) is added and L P is taken off every sample with the weights of the same
// heuristic, whether the sample reaches the environment or not: what noise is left is that of
// L (V max(cos, 0) - P). A factor on both keeps every mean and decides how much noise is traded.
//
// The densities must cover all light: where a light sample below the horizon could not be drawn,
// L P would be missing there. Samplers give no density 0 where the map is not black.
#pragma once

#include "kernel/scene_view.h"

namespace skytree {

/// Narrower lobes (alpha along the wider axis) take one light sample: their BSDF sample does the
/// work.
constexpr float kSharpAlpha = 0.03f;

/// The light samples of a vertex: how many, and which point of their sequence the first takes. The
/// others take those that follow, so that the samples of one vertex are stratified among themselves
/// and with those of other paths.
struct LightSamples {
  int count;
  uint32_t first;
};

/// Those of a vertex with at least one lobe.
SKY_HD LightSamples light_samples(const RenderSettings& settings, int bounce, uint32_t sample,
                                  const Shading& shading) {
  if (!settings.light_sampling) return {0, sample};
  if (bounce > 0 || settings.candidates > 0) return {1, sample};
  for (int i = 0; i < shading.count; ++i) {
    const Lobe& lobe = shading.lobes[i];
    if (lobe.type == LobeType::kDiffuse || lobe.type == LobeType::kRoughDiffuse ||
        maxf(lobe.alpha_x, lobe.alpha_y) >= kSharpAlpha) {
      return {settings.light_rays,
              sample * static_cast<uint32_t>(settings.light_rays) + settings.light_skip};
    }
  }
  return {1, sample};
}

/// Sign of light sample `i` of `count` in the difference of two halves of them, whose square tells
/// how much noise they bring; 0 where they have no halves.
SKY_HD float light_half(int count, int i) { return count % 2 ? 0.0f : i % 2 ? -1.0f : 1.0f; }

/// The third number of light sample `i`: one for all of them, turned on.
SKY_HD float light_choice(float choice, int light_rays, int i) {
  const float turned = choice + static_cast<float>(i) / static_cast<float>(light_rays);
  return minf(turned < 1.0f ? turned : turned - 1.0f, kOneMinusEpsilon);
}

/// BSDF samples of a vertex that count.
SKY_HD float bsdf_ray_count(const RenderSettings& settings) {
  return settings.bsdf_sampling ? 1.0f : 0.0f;
}

/// Density of all samples of a vertex together; `light_rays` is 0 where there are none.
SKY_HD float mixture_density(int light_rays, float light_pdf, float bsdf_rays, float bsdf_pdf) {
  return static_cast<float>(light_rays) * light_pdf + bsdf_rays * bsdf_pdf;
}

/// What the diffuse lobes would reflect from `direction` if P were the cosine.
SKY_HD Vec3 control_value(const Shading& shading, Vec3 direction) {
  Vec3 sum = {0, 0, 0};
  for (int i = 0; i < shading.count; ++i) {
    const Lobe& lobe = shading.lobes[i];
    if (lobe.type != LobeType::kDiffuse) continue;
    sum += lobe.weight * (kInvPi * diffuse_polynomial(dot(lobe.normal, direction)));
  }
  return sum;
}

/// The integral of control_value times the environment's radiance over the sphere.
SKY_HD Vec3 control_integral(const EnvironmentView& environment, const Shading& shading) {
  Vec3 sum = {0, 0, 0};
  for (int i = 0; i < shading.count; ++i) {
    const Lobe& lobe = shading.lobes[i];
    if (lobe.type != LobeType::kDiffuse) continue;
    sum += lobe.weight * kInvPi *
           diffuse_integral(environment.moments, environment.world_to_env * lobe.normal);
  }
  return environment.color * sum;
}

}  // namespace skytree
