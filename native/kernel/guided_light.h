// SPDX-License-Identifier: GPL-3.0-or-later
// Light samples of a surface point: the environment's sampler, its random numbers sent through what
// has been learnt of visibility there (visibility_guide.h), or else through the cuts that direct
// them to what its lobes reflect (product_cut.h).
#pragma once

#include "kernel/env_sampler.h"
#include "kernel/visibility_guide.h"

namespace skytree {

/// Whether directions come from a monotone map of (u.y, u.z) that warp_point can invert.
SKY_HD bool has_warp(const EnvSamplerView& sampler) {
  return sampler.type == EnvSamplerType::KDTREE_WARP ||
         sampler.type == EnvSamplerType::KDTREE_LINEAR;
}

/// Where in the warp's unit square a direction inside the block comes from; `u` its azimuth in the
/// frame of the tree's cells.
SKY_HD Vec2 linear_block_point(const LinearBlock& block, float cell_width, float u,
                               Vec3 direction) {
  const float near = polar_height(direction);
  const float h = (direction.z < 0.0f) == (block.h_rise < 0.0f) ? near : 1.0f - near;
  const float p = (u - block_u_start(block, cell_width)) / block_u_extent(block, cell_width);
  const float q = (h - block.h_start) / fabsf(block.h_rise);
  // Distribution functions of the densities 1 + a (2p - 1).
  const float a = tilt_along_azimuth(block), b = tilt_along_height(block);
  const float across = p * (1.0f - a + a * p), up = q * (1.0f - b + b * q);
  const float down = block.h_rise < 0.0f ? 1.0f - up : up;
  return {clampf(block.warp_origin.x + across / block.warp_scale.x, 0.0f, kOneMinusEpsilon),
          clampf(block.warp_origin.y + down / block.warp_scale.y, 0.0f, kOneMinusEpsilon)};
}

/// Where in the unit square of (u.y, u.z) a direction comes from, of a sampler that has a warp.
SKY_HD Vec2 warp_point(const EnvSamplerView& sampler, Vec3 direction) {
  const KdTreeView& tree = sampler.kdtree;
  if (sampler.type == EnvSamplerType::KDTREE_LINEAR) {
    const float u = cell_azimuth(direction, tree.cell_width);
    return linear_block_point(tree.linear_blocks[locate_block(tree, u, direction)], tree.cell_width,
                              u, direction);
  }
  const float near = polar_height(direction);
  const int32_t index = locate_block(tree, direction);
  const BlockWarp warp = tree.warps[index];
  const float h = (direction.z < 0.0f) == (warp.h_slope < 0.0f) ? near : 1.0f - near;
  const Vec2 origin = tree.warp_origins[index];
  return {clampf(origin.x + (latlong_u(direction) - warp.u_start) / warp.u_slope, 0.0f,
                 kOneMinusEpsilon),
          clampf(origin.y + (h - warp.h_start) / warp.h_slope, 0.0f, kOneMinusEpsilon)};
}

/// Slot of a place that nothing is learnt of.
constexpr uint32_t kNoGuideSlot = ~0u;
/// Region of a sample of which nothing is to be recorded.
constexpr int32_t kNoGuideRegion = -1;

/// Whether what has been learnt steers the samples of a place with this slot.
SKY_HD bool is_guided(const GuideView& guide, uint32_t slot) {
  return slot != kNoGuideSlot && guide.used[slot];
}

/// Where a light sample of a place with this slot starts from in the warp's unit square: at u, or
/// where the guide or, without it, the mixture sends it.
SKY_HD GuidedPoint guide_point(const EnvSamplerView& sampler, const GuideView& guide, uint32_t slot,
                               const ProductMix& mix, Vec2 u) {
  if (!is_guided(guide, slot)) {
    ProductPoint product = {u, 1.0f};
    if (mix.count > 0) product = product_warp(sampler.kdtree.products, mix, u);
    const bool recorded = slot != kNoGuideSlot && guide.counters;
    return {product.point, product.ratio,
            recorded ? guide_region(guide, product.point) : kNoGuideRegion};
  }
  GuidedPoint guided = guide_warp(guide, slot, u);
  if (!guide.counters) guided.region = kNoGuideRegion;
  return guided;
}

struct GuidedSample {
  DirectionSample light;  // in the map's frame
  int32_t region;
};

/// sample_environment from a place with this slot and mixture.
SKY_HD GuidedSample sample_guided(const EnvSamplerView& sampler, const GuideView& guide,
                                  uint32_t slot, const ProductMix& mix, Vec3 u) {
  const GuidedPoint guided = guide_point(sampler, guide, slot, mix, {u.y, u.z});
  DirectionSample light = sample_environment(sampler, {u.x, guided.point.x, guided.point.y});
  light.pdf *= guided.density;
  return {light, guided.region};
}

/// Factor that guide or mixture put on environment_pdf at a direction that something else has
/// chosen; `block` of the tree that it lies in, if there is a mixture.
SKY_HD float guide_factor(const EnvSamplerView& sampler, const GuideView& guide, uint32_t slot,
                          const ProductMix& mix, int32_t block, Vec3 direction) {
  if (!is_guided(guide, slot)) {
    if (mix.count == 0) return 1.0f;
    const ProductView& products = sampler.kdtree.products;
    return product_ratio(products, mix, products.cut.node_of_block[block]);
  }
  return guide_density(guide, slot, warp_point(sampler, direction));
}

/// Density of sample_guided at a direction that something else has chosen.
SKY_HD float guided_pdf(const EnvSamplerView& sampler, const GuideView& guide, uint32_t slot,
                        const ProductMix& mix, Vec3 direction) {
  const KdTreeView& tree = sampler.kdtree;
  if (mix.count == 0) {
    return environment_pdf(sampler, direction) *
           guide_factor(sampler, guide, slot, mix, 0, direction);
  }
  const float u = cell_azimuth(direction, tree.cell_width);
  const int32_t block = locate_block(tree, u, direction);
  return linear_block_pdf(tree.linear_blocks[block], tree.cell_width, u, direction) *
         guide_factor(sampler, guide, slot, mix, block, direction);
}

}  // namespace skytree
