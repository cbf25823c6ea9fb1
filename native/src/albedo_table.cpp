// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/albedo_table.h"

#include <vector>

#include "kernel/material.h"
#include "kernel/rng.h"

namespace skytree {
namespace {

std::vector<float> integrate_table() {
  constexpr int n = kAlbedoTableSize;
  constexpr int kSamples = 64;
  std::vector<float> table(size_t(n) * n * n);
  Lobe lobe = {};
  lobe.type = LobeType::kDielectric;
  lobe.weight = {1, 1, 1};
  lobe.normal = {0, 0, 1};
  lobe.tangent = {1, 0, 0};
  lobe.bitangent = {0, 1, 0};
  for (int i = 0; i < n * n * n; ++i) {
    const float roughness = float(i / (n * n)) / (n - 1);
    const float cosine = float(i / n % n) / (n - 1);
    const float sqrt_f0 = float(i % n) / (n - 1) * kAlbedoMaxSqrtF0;
    const Vec2 alpha = glossy_alpha(roughness, 0.0f);
    lobe.alpha_x = alpha.x;
    lobe.alpha_y = alpha.y;
    lobe.eta = (1.0f + sqrt_f0) / (1.0f - sqrt_f0);
    const float z = cosine > 0.01f ? cosine : 0.01f;
    const Vec3 view = {sqrtf(1.0f - z * z), 0.0f, z};
    double sum = 0.0;
    for (uint32_t s = 0; s < kSamples; ++s) {
      const Vec3 direction = sample_lobe(lobe, view, random_pair(1u, s, 0u));
      const BsdfValue value = eval_lobe(lobe, view, direction);
      if (value.pdf > 0.0f) sum += value.f.x / value.pdf;
    }
    table[i] = float(sum / kSamples);
  }
  return table;
}

}  // namespace

const float* dielectric_albedo_table() {
  static const std::vector<float> table = integrate_table();
  return table.data();
}

}  // namespace skytree
