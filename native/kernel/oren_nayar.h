// SPDX-License-Identifier: GPL-3.0-or-later
// Rough diffuse reflection: Fujii's qualitative Oren-Nayar model with the light that bounces
// between facets given back, as Cycles has it since Blender 4.2. A white surface reflects all it
// receives at any roughness.
//
// M. Oren and S. Nayar, "Generalization of Lambert's Reflectance Model", SIGGRAPH 1994; Y. Fujii,
// "A tiny improvement of Oren-Nayar reflectance model", 2013; J. Portsmouth, P. Kutz, S. Hill,
// "EON: A Practical Energy-Preserving Rough Diffuse BRDF", JCGT 14(1), 2025, section 2 (the albedo
// integrals and the compensation).
#pragma once

#include "kernel/math.h"
#include "kernel/vec.h"

namespace skytree {

/// f = single_scatter + between_facets; both without the surface's colour.
struct OrenNayar {
  float a, b;     // 1/pi and 0 for a smooth surface
  float average;  // albedo of single scattering over all directions
};

SKY_HD OrenNayar make_oren_nayar(float roughness) {
  const float sigma = clampf(roughness, 0.0f, 1.0f);
  const float a = 1.0f / (kPi + sigma * (0.5f * kPi - 2.0f / 3.0f));
  const float b = sigma * a;
  return {a, b, a * kPi + b * (kTwoPi - 5.6f) / 3.0f};
}

/// Albedo of single scattering for light at the cosine.
SKY_HD float oren_nayar_albedo(const OrenNayar& model, float cosine) {
  const float c = clampf(cosine, 1e-4f, 1.0f);
  const float s = sqrtf(1.0f - c * c);
  const float theta = sky_atan2(s, c);
  const float g = s * (theta - 2.0f / 3.0f - s * c) + 2.0f / 3.0f * (s / c) * (1.0f - s * s * s);
  return model.a * kPi + model.b * g;
}

SKY_HD float oren_nayar_single(const OrenNayar& model, float cos_o, float cos_i,
                               float cos_between) {
  const float s = cos_between - cos_o * cos_i;
  return model.a + model.b * (s > 0.0f ? s / maxf(cos_o, cos_i) : s);
}

}  // namespace skytree
