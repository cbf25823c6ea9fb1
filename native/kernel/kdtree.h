// SPDX-License-Identifier: GPL-3.0-or-later
// Sampling and density of a kd-tree over a lat-long map. Method: Ergun, Kurt and Ozturk, "Real-time
// Kd-tree Based Importance Sampling of Environment Maps", SCCG 2012.
//
// Deviations: a point is uniform in azimuth and in cos(theta), not in the polar angle, so that the
// density is constant in a block and known from the direction alone. Beside the paper's choice of a
// block by rank, a block can be chosen by a monotone warp down the tree (McCool and Harwood,
// "Probability Trees", GI 1997), which keeps neighbouring random numbers in neighbouring
// directions, so that stratification survives.
//
// A sampled point keeps away from its block's border by more than float rounding can move it, so
// that locate_block(direction) finds the block that the direction was drawn from.
#pragma once

#include "kernel/latlong.h"
#include "kernel/linear_blocks.h"
#include "kernel/product_cut.h"
#include "kernel/rank_model.h"

namespace skytree {

/// Where unit random numbers land in a block: u = u_start + u_slope * r, h = h_start + h_slope * s
/// with h as in direction_at_height; a negative h_slope says that h is measured from -Z. So theta
/// grows with s always.
struct alignas(16) BlockWarp {  // one load on a GPU
  float u_start, u_slope;
  float h_start, h_slope;
};

/// Inner nodes come first in the numbering (the root is 0), block b is node inner_count + b. With
/// one block there is no inner node.
struct KdTreeView {
  const LinearBlock* linear_blocks;  // per block; null: constant blocks, by the next three
  const BlockWarp* warps;            // per block
  const float* pdf;                  // per block, per steradian
  const Vec2*
      warp_origins;  // per block: lower corner in (u.y, u.z); null: blocks are chosen by rank
  const int32_t*
      split_keys;  // per inner node: azimuth_key or, with the sign bit set, elevation_key
  const float*
      split_warps;  // per inner node: threshold on u.y or u.z; null: blocks are chosen by rank
  const uint32_t* children;  // per inner node: first child | second child << 16
  const uint16_t*
      start_grid;  // kStartColumns x kStartRows over (u, cos theta): where to start locating
  const uint16_t* warp_grid;  // kWarpGrid^2 over (u.y, u.z): where to start sampling; null: by rank
  RankModel ranks;
  ProductView products;  // of linear blocks, where they were asked for
  float cell_width;      // in turns, of linear blocks
  int32_t inner_count;
};

constexpr int kStartColumns = 64;
constexpr int kStartRows = 32;
constexpr int kWarpGrid = 32;
constexpr int32_t kElevationSplit = INT32_MIN;  // the sign bit of a split key

// Walks branch on nothing but their end: which way a node sends a random point cannot be predicted.

SKY_HD int32_t next_node(uint32_t children, bool second) {
  return (int32_t)(children >> (second ? 16 : 0) & 0xffffu);
}

/// Position along the axis that a split key names.
SKY_HD int32_t position_along(int32_t key, int32_t elevation, int32_t azimuth) {
  const int32_t mask = key >> 31;
  return (elevation & mask) | (azimuth & ~mask);
}

/// Cell of the start grid that a unit direction lies in; u is the azimuth in the frame of the
/// tree's grid, in turns.
SKY_HD int32_t start_cell(float u, Vec3 direction) {
  const int column = (int)minf(maxf(u, 0.0f) * kStartColumns, kStartColumns - 1);
  const int row = (int)minf(maxf(1.0f - direction.z, 0.0f) * (0.5f * kStartRows), kStartRows - 1);
  return row * kStartColumns + column;
}

/// Block below `node` that lies at these keys.
SKY_HD int32_t locate_from(const KdTreeView& tree, int32_t node, int32_t azimuth,
                           int32_t elevation) {
  while (node < tree.inner_count) {
    const int32_t key = tree.split_keys[node];
    const int32_t position = position_along(key, elevation, azimuth);
    node = next_node(tree.children[node], position >= (key & INT32_MAX));
  }
  return node - tree.inner_count;
}

/// Block that a unit direction lies in; u as in start_cell.
SKY_HD int32_t locate_block(const KdTreeView& tree, float u, Vec3 direction) {
  return locate_from(tree, tree.start_grid[start_cell(u, direction)], azimuth_key(u),
                     elevation_key(direction));
}

SKY_HD int32_t locate_block(const KdTreeView& tree, Vec3 direction) {
  return locate_block(tree, latlong_u(direction), direction);
}

SKY_HD float kdtree_pdf(const KdTreeView& tree, Vec3 direction) {
  return tree.pdf[locate_block(tree, direction)];
}

SKY_HD float linear_kdtree_pdf(const KdTreeView& tree, Vec3 direction) {
  const float u = cell_azimuth(direction, tree.cell_width);
  return linear_block_pdf(tree.linear_blocks[locate_block(tree, u, direction)], tree.cell_width, u,
                          direction);
}

/// Direction at offsets (r, s) in a block.
SKY_HD Vec3 direction_in_block(const BlockWarp& warp, float r, float s) {
  return direction_at_height(warp.u_start + warp.u_slope * r, warp.h_start + warp.h_slope * s,
                             warp.h_slope < 0.0f);
}

/// Cell of the warp grid.
SKY_HD int32_t warp_cell(float r, float s) {
  return (int)(s * kWarpGrid) * kWarpGrid + (int)(r * kWarpGrid);
}

/// Block that the warp of (r, s) lands in.
SKY_HD int32_t choose_block_by_warp(const KdTreeView& tree, float r, float s) {
  int32_t node = tree.warp_grid[warp_cell(r, s)];
  // Floats that are not negative are ordered like their bits.
  const int32_t across = (int32_t)float_bits(r), down = (int32_t)float_bits(s);
  while (node < tree.inner_count) {
    const int32_t position = position_along(tree.split_keys[node], down, across);
    node = next_node(tree.children[node], position >= (int32_t)float_bits(tree.split_warps[node]));
  }
  return node - tree.inner_count;
}

}  // namespace skytree
