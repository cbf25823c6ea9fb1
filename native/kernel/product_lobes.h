// SPDX-License-Identifier: GPL-3.0-or-later
// The lobes whose cuts stand in the table of product_cut.h, and which of them a surface mixes. That
// depends on the surface alone, never on a sample that is weighed: so every estimate stays
// unbiased, however roughly the lobes are met.
//
// The table's lobes lie about the directions of the map and know no surface, so the table is made
// once for a map: GGX as seen along the normal, and cosine lobes. An anisotropic lobe is a row of
// narrower ones along its longer axis.
#pragma once

#include "kernel/kdtree.h"
#include "kernel/material.h"

namespace skytree {

constexpr int kLobeEdge = 32;                     // cells along the octahedral map of directions
constexpr int kLobeAxes = kLobeEdge * kLobeEdge;  // cuts of one kind of lobe
constexpr int kLobeWidths = 6;                    // of GGX lobes, each twice the one before
constexpr float kLeastLobeWidth = 0.02f;          // alpha of the first
/// So many of them are narrower than a cell: most samples that a cut directs miss such a lobe, and
/// only light that is brighter than the rest of it is worth that (product_table.cpp).
constexpr int kCompensatedWidths = 1;
constexpr int kCosineCuts = kLobeWidths * kLobeAxes;  // before them those of GGX, width by width
constexpr int kTableCuts = kCosineCuts + kLobeAxes;

/// Lobes narrower than this (alpha along the wider axis) leave the work to the BSDF samples.
constexpr float kLeastDirectedAlpha = 0.0075f;

/// An anisotropic lobe whose alphas differ more than by this factor is a row of three.
constexpr float kElongated = 2.0f;
constexpr float kRowStep = 0.8f;   // slopes of its half vectors' axes, in the larger alpha
constexpr float kRowWidth = 0.5f;  // alpha of each, in the larger alpha
constexpr float kRowSide = 0.24f;  // weight of an outer one: (1 + kRowStep^2)^-1.5 of the middle's

/// Weight of a diffuse lobe by what it reflects: much of that needs no samples (estimators.h).
constexpr float kDiffuseShare = 0.5f;

SKY_HD float lobe_width(int i) { return kLeastLobeWidth * (float)(1 << i); }

/// Between the halves of the octahedral map.
SKY_HD void fold_octahedron(float* x, float* y) {
  const float folded = (1.0f - fabsf(*y)) * (*x < 0.0f ? -1.0f : 1.0f);
  *y = (1.0f - fabsf(*x)) * (*y < 0.0f ? -1.0f : 1.0f);
  *x = folded;
}

/// Cell of a direction that is not 0.
SKY_HD int32_t lobe_cell(Vec3 d) {
  const float scale = 1.0f / (fabsf(d.x) + fabsf(d.y) + fabsf(d.z));
  float x = d.x * scale, y = d.y * scale;
  if (d.z < 0.0f) fold_octahedron(&x, &y);
  const int column = (int)clampf((x + 1.0f) * (0.5f * kLobeEdge), 0.0f, kLobeEdge - 1);
  const int row = (int)clampf((y + 1.0f) * (0.5f * kLobeEdge), 0.0f, kLobeEdge - 1);
  return row * kLobeEdge + column;
}

/// Direction in the middle of a cell.
SKY_HD Vec3 lobe_axis(int32_t cell) {
  float x = ((float)(cell % kLobeEdge) + 0.5f) * (2.0f / kLobeEdge) - 1.0f;
  float y = ((float)(cell / kLobeEdge) + 0.5f) * (2.0f / kLobeEdge) - 1.0f;
  const float z = 1.0f - fabsf(x) - fabsf(y);
  if (z < 0.0f) fold_octahedron(&x, &y);
  return normalize({x, y, z});
}

/// Density per steradian of a GGX lobe with this alpha^2 at a cosine from its axis.
SKY_HD float table_lobe(float alpha_squared, float cosine) {
  const float tangent = (1.0f - cosine) / maxf(1.0f + cosine, 1e-3f);  // of half the angle, squared
  const float k = 1.0f + tangent / alpha_squared;
  return 0.25f * kInvPi / (alpha_squared * k * k);
}

/// What a diffuse surface's samples are worth: half by the cosine, half even, as its control
/// variate takes off most of what is seen (estimators.h).
SKY_HD float table_cosine(float cosine) {
  return 0.5f * kInvPi * maxf(cosine, 0.0f) + 0.125f * kInvPi;
}

SKY_HD void mix_cut(const ProductView& products, int32_t cut, float weight, ProductMix* mix) {
  if (mix->count == kMixedCuts) return;
  mix->cut[mix->count] = cut;
  mix->weight[mix->count++] = weight * products.means[cut];
}

/// A lobe of width number `width` about where `view` (world space) is mirrored by `half_vector`.
SKY_HD void mix_mirrored(const ProductView& products, const Mat3& world_to_env, int width,
                         Vec3 half_vector, Vec3 view, float weight, ProductMix* mix) {
  const Vec3 mirrored = half_vector * (2.0f * dot(half_vector, view)) - view;
  mix_cut(products, width * kLobeAxes + lobe_cell(world_to_env * mirrored), weight, mix);
}

SKY_HD void mix_lobe(const ProductView& products, const Mat3& world_to_env, const Lobe& lobe,
                     Vec3 view, ProductMix* mix) {
  const float least = minf(lobe.alpha_x, lobe.alpha_y), most = maxf(lobe.alpha_x, lobe.alpha_y);
  const bool elongated = most > kElongated * least;
  const float alpha = elongated ? maxf(least, kRowWidth * most) : sqrtf(least * most);
  int width = 0;
  while (width + 1 < kLobeWidths && 2.0f * lobe_width(width) * lobe_width(width) < alpha * alpha)
    ++width;
  const float middle = elongated ? 1.0f - 2.0f * kRowSide : 1.0f;
  mix_mirrored(products, world_to_env, width, lobe.normal, view, lobe.select * middle, mix);
  if (!elongated) return;
  const Vec3 step =
      (lobe.alpha_x > lobe.alpha_y ? lobe.tangent : lobe.bitangent) * (kRowStep * most);
  for (int side = 0; side < 2; ++side) {
    const Vec3 half_vector = normalize(lobe.normal + (side ? -step : step));
    mix_mirrored(products, world_to_env, width, half_vector, view, lobe.select * kRowSide, mix);
  }
}

/// The mixture for a surface seen from `view`; none where no lobe is directed enough to gain.
SKY_HD_RARE ProductMix mix_products(const ProductView& products, const Mat3& world_to_env,
                                    const Shading& shading, Vec3 view) {
  const ProductMix none = {};
  ProductMix mix = none;
  bool directed = false;
  for (int i = 0; i < shading.count; ++i) {
    const Lobe& lobe = shading.lobes[i];
    if (lobe.type == LobeType::kTabulated) return none;
    if (lobe.type == LobeType::kDiffuse || lobe.type == LobeType::kRoughDiffuse) {
      mix_cut(products, kCosineCuts + lobe_cell(world_to_env * lobe.normal),
              kDiffuseShare * lobe.select, &mix);
    } else if (maxf(lobe.alpha_x, lobe.alpha_y) >= kLeastDirectedAlpha) {
      directed = true;
      mix_lobe(products, world_to_env, lobe, view, &mix);
    }
  }
  float sum = 0.0f;
  for (int k = 0; k < mix.count; ++k) sum += mix.weight[k];
  if (!directed || !(sum > 0.0f)) return none;
  for (int k = 0; k < mix.count; ++k) mix.weight[k] *= 1.0f / sum;
  return mix;
}

}  // namespace skytree
