// SPDX-License-Identifier: GPL-3.0-or-later
// One sampler of any kind behind one pair of functions: a tagged union of plain views.
#pragma once

#include "kernel/alias.h"
#include "kernel/filtered.h"
#include "kernel/hierarchy.h"
#include "kernel/inversion.h"
#include "kernel/kdtree.h"

namespace skytree {

enum class EnvSamplerType : int32_t {
  UNIFORM,
  KDTREE_RANK,    // block by the fitted model of ranks (the paper's)
  KDTREE_WARP,    // block by the warp down the tree
  KDTREE_LINEAR,  // the same with linear density in a block
  INVERSION_GUIDED,
  INVERSION_BINARY,
  ALIAS,
  HIERARCHY,
  FILTERED  // BIASED, draws no directions: BSDF samples look up the filtered map (filtered.h)
};

struct EnvSamplerView {
  EnvSamplerType type = EnvSamplerType::UNIFORM;
  union {
    KdTreeView kdtree;
    InversionView inversion;
    AliasView alias;
    HierarchyView hierarchy;
    FilteredView filtered;
  };

  EnvSamplerView() : kdtree() {}
};

/// A unit direction in the map's frame and its density per steradian.
struct DirectionSample {
  Vec3 direction;
  float pdf;
};

SKY_HD DirectionSample sample_uniform_sphere(Vec3 u) {
  return {direction_at_height(u.y, u.z, false), kInvFourPi};
}

SKY_HD DirectionSample sample_kdtree_rank(const KdTreeView& tree, Vec3 u) {
  const int32_t block = sample_rank(tree.ranks, u.x);
  return {direction_in_block(tree.warps[block], u.y, u.z), tree.pdf[block]};
}

SKY_HD DirectionSample sample_kdtree_warp(const KdTreeView& tree, Vec3 u) {
  const int32_t block = choose_block_by_warp(tree, u.y, u.z);
  const Vec2 origin = tree.warp_origins[block];
  return {direction_in_block(tree.warps[block], u.y - origin.x, u.z - origin.y), tree.pdf[block]};
}

SKY_HD DirectionSample sample_kdtree_linear(const KdTreeView& tree, Vec3 u) {
  const LinearBlock& block = tree.linear_blocks[choose_block_by_warp(tree, u.y, u.z)];
  const Vec3 direction = sample_linear_block(block, tree.cell_width, u.y, u.z);
  return {direction, linear_block_pdf(block, tree.cell_width,
                                      cell_azimuth(direction, tree.cell_width), direction)};
}

SKY_HD float inversion_pdf(const InversionView& table, int32_t x, int32_t y) {
  const float* cdf = table.conditional + (int64_t)y * (table.width + 1);
  return (table.marginal[y + 1] - table.marginal[y]) * (cdf[x + 1] - cdf[x]) *
         table.rows[y].inv_solid_angle;
}

SKY_HD DirectionSample sample_inversion(const InversionView& table, Vec3 u, bool guided) {
  const int32_t y = guided ? search_guided(table.marginal, table.marginal_guide, table.height, u.z)
                           : search_binary(table.marginal, table.height, u.z);
  const float* cdf = table.conditional + (int64_t)y * (table.width + 1);
  const uint16_t* guide = guided ? table.conditional_guide + (int64_t)y * table.width : nullptr;
  const int32_t x =
      guided ? search_guided(cdf, guide, table.width, u.y) : search_binary(cdf, table.width, u.y);
  const float row_mass = table.marginal[y + 1] - table.marginal[y];
  const float texel_mass = cdf[x + 1] - cdf[x];
  const RowWarp row = table.rows[y];
  const float azimuth = texel_azimuth(x, (u.y - cdf[x]) / texel_mass, table.width);
  const float height = row.h_start + row.h_slope * ((u.z - table.marginal[y]) / row_mass);
  return {direction_at_height(azimuth, height, row.h_slope < 0.0f),
          row_mass * texel_mass * row.inv_solid_angle};
}

SKY_HD DirectionSample sample_alias_table(const AliasView& table, Vec3 u) {
  float offset, weight;
  const uint32_t texel = sample_alias(table, u, &offset, &weight);
  const uint32_t y = texel / (uint32_t)table.width;
  const AliasRow& row = table.rows[y];
  const float azimuth =
      texel_azimuth((int32_t)(texel - y * (uint32_t)table.width), offset, table.width);
  const RowWarp warp = row.warp;
  return {direction_at_height(azimuth, warp.h_start + warp.h_slope * u.z, warp.h_slope < 0.0f),
          weight * row.pdf};
}

SKY_HD DirectionSample sample_hierarchy(const HierarchyView& table, Vec3 u) {
  int32_t x, y;
  int64_t base;
  descend_hierarchy(table, &u.y, &u.z, &x, &y, &base);
  const RowWarp row = table.rows[y];
  return {direction_at_height(texel_azimuth(x, u.y, table.width), row.h_start + row.h_slope * u.z,
                              row.h_slope < 0.0f),
          hierarchy_pdf(table, base, x, y)};
}

/// u in [0,1)^3: u.x chooses where a method chooses once, (u.y, u.z) is the pair that a method
/// warps or places inside what was chosen; a well-stratified point set should have its best pair
/// there.
SKY_HD DirectionSample sample_environment(const EnvSamplerView& sampler, Vec3 u) {
  switch (sampler.type) {
    case EnvSamplerType::KDTREE_RANK:
      return sample_kdtree_rank(sampler.kdtree, u);
    case EnvSamplerType::KDTREE_WARP:
      return sample_kdtree_warp(sampler.kdtree, u);
    case EnvSamplerType::KDTREE_LINEAR:
      return sample_kdtree_linear(sampler.kdtree, u);
    case EnvSamplerType::INVERSION_GUIDED:
      return sample_inversion(sampler.inversion, u, true);
    case EnvSamplerType::INVERSION_BINARY:
      return sample_inversion(sampler.inversion, u, false);
    case EnvSamplerType::ALIAS:
      return sample_alias_table(sampler.alias, u);
    case EnvSamplerType::HIERARCHY:
      return sample_hierarchy(sampler.hierarchy, u);
    case EnvSamplerType::FILTERED:
      return {{0.0f, 0.0f, 1.0f}, 0.0f};
    default:
      return sample_uniform_sphere(u);
  }
}

/// Density per steradian with which sample_environment returns `direction` (unit, the map's frame).
SKY_HD float environment_pdf(const EnvSamplerView& sampler, Vec3 direction) {
  int32_t x, y;
  switch (sampler.type) {
    case EnvSamplerType::KDTREE_RANK:
    case EnvSamplerType::KDTREE_WARP:
      return kdtree_pdf(sampler.kdtree, direction);
    case EnvSamplerType::KDTREE_LINEAR:
      return linear_kdtree_pdf(sampler.kdtree, direction);
    case EnvSamplerType::INVERSION_GUIDED:
    case EnvSamplerType::INVERSION_BINARY:
      latlong_texel(direction, sampler.inversion.width, sampler.inversion.height, &x, &y);
      return inversion_pdf(sampler.inversion, x, y);
    case EnvSamplerType::ALIAS:
      latlong_texel(direction, sampler.alias.width, sampler.alias.height, &x, &y);
      return sampler.alias.entries[(int64_t)y * sampler.alias.width + x].weight *
             sampler.alias.rows[y].pdf;
    case EnvSamplerType::HIERARCHY:
      latlong_texel(direction, sampler.hierarchy.width, sampler.hierarchy.height, &x, &y);
      return hierarchy_pdf(sampler.hierarchy, hierarchy_base(sampler.hierarchy), x, y);
    case EnvSamplerType::FILTERED:
      return 0.0f;
    default:
      return kInvFourPi;
  }
}

}  // namespace skytree
