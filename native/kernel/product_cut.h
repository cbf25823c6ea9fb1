// SPDX-License-Identifier: GPL-3.0-or-later
// Sampling the map times a lobe: the upper part of the kd-tree, cut off at a hundred nodes or so,
// gets new probabilities for one surface point (or one pixel), those of the nodes times the lobe at
// their mean directions; below the cut the tree stays as it is. So the density is that of the tree
// times a factor for each node of the cut, known for any direction. The idea of a cut is that of P.
// Clarberg et al., "Wavelet Importance Sampling", SIGGRAPH 2005, and of B. Walter et al.,
// "Lightcuts", SIGGRAPH 2005.
#pragma once

#include "kernel/bsdf.h"
#include "kernel/env_sampler.h"

namespace skytree {

constexpr int kLargestCut = 128;

/// A node of the cut: what lies below it, and where in the unit square of (u.y, u.z) the tree's
/// warp has it.
struct CutNode {
  Vec3 direction;     // mean, of unit length
  float spread;       // angular variance about it, radians^2
  float probability;  // of the tree
  Vec2 warp_low, warp_extent;
};

/// A split above the cut; a child is another split or, as ~index, a node of the cut.
struct CutSplit {
  int16_t first, second;
  int32_t axis;  // 0: u.y, 1: u.z
};

struct CutView {
  const CutNode* nodes;          // count
  const CutSplit* splits;        // count - 1, parents before children; the root is 0
  const uint8_t* node_of_block;  // the node that a block of the tree lies below
  int32_t count;                 // 1 to kLargestCut
};

/// The cut for one surface point.
struct ProductCut {
  float ratio[kLargestCut];     // of each node's probability to that in the tree
  float fraction[kLargestCut];  // of each split's probability that is its first child's
};

/// Share of the samples that the lobe does not direct: the cut's lobes are rough, and a node's mean
/// direction may lie below the horizon while parts of it do not.
constexpr float kUndirected = 0.1f;

/// How much of what the lobe sees a node is worth: the lobe, widened by the node's spread, at its
/// mean direction (map's frame to world by `world_to_env`).
SKY_HD float cut_importance(const CutNode& node, const Mat3& world_to_env, const Lobe& lobe,
                            Vec3 wo) {
  Lobe widened = lobe;
  // Half vectors turn half as far as directions.
  const float variance = 0.25f * node.spread;
  widened.alpha_x = minf(sqrtf(lobe.alpha_x * lobe.alpha_x + variance), 1.0f);
  widened.alpha_y = minf(sqrtf(lobe.alpha_y * lobe.alpha_y + variance), 1.0f);
  return luminance(eval_lobe(widened, wo, transpose_mul(world_to_env, node.direction)).f);
}

/// `importance[i]` for each node of the cut, at least 0.
SKY_HD void make_product_cut(const CutView& cut, const float* importance, ProductCut* product) {
  float mean = 0.0f;
  for (int32_t i = 0; i < cut.count; ++i) mean += cut.nodes[i].probability * importance[i];
  const bool directed = mean > 0.0f && mean < INFINITY;
  const float scale = directed ? (1.0f - kUndirected) / mean : 0.0f;
  const float floor = directed ? kUndirected : 1.0f;
  float sums[kLargestCut];  // of splits
  for (int32_t i = 0; i < cut.count; ++i) product->ratio[i] = floor + scale * importance[i];
  for (int32_t s = cut.count - 2; s >= 0; --s) {
    float parts[2];
    for (int side = 0; side < 2; ++side) {
      const int32_t child = side ? cut.splits[s].second : cut.splits[s].first;
      parts[side] =
          child >= 0 ? sums[child] : cut.nodes[~child].probability * product->ratio[~child];
    }
    sums[s] = parts[0] + parts[1];
    product->fraction[s] = parts[0] / sums[s];
  }
}

SKY_HD float product_pdf(const KdTreeView& tree, const CutView& cut, const ProductCut& product,
                         Vec3 direction) {
  const float u = cell_azimuth(direction, tree.cell_width);
  const int32_t block = locate_block(tree, u, direction);
  return linear_block_pdf(tree.linear_blocks[block], tree.cell_width, u, direction) *
         product.ratio[cut.node_of_block[block]];
}

/// u in [0,1)^2. The warp is monotone above and below the cut, so neighbours stay neighbours.
SKY_HD DirectionSample sample_product(const KdTreeView& tree, const CutView& cut,
                                      const ProductCut& product, Vec2 u) {
  int32_t node = cut.count > 1 ? 0 : ~0;
  while (node >= 0) {
    const CutSplit split = cut.splits[node];
    const float fraction = product.fraction[node];
    float* x = split.axis == 0 ? &u.x : &u.y;
    const bool second = *x >= fraction;
    *x = second ? (*x - fraction) / (1.0f - fraction) : *x / fraction;
    node = second ? split.second : split.first;
  }
  const CutNode& chosen = cut.nodes[~node];
  // Rounding must not carry a number over the node's border in the warp.
  const Vec2 low = chosen.warp_low, extent = chosen.warp_extent;
  const float r = low.x + extent.x * minf(u.x, 1.0f - 1e-6f);
  const float s = low.y + extent.y * minf(u.y, 1.0f - 1e-6f);
  const float r_end = (low.x + extent.x) * kOneMinusEpsilon;
  const float s_end = (low.y + extent.y) * kOneMinusEpsilon;
  const int32_t index = choose_block_by_warp(tree, minf(r, r_end), minf(s, s_end));
  const LinearBlock& block = tree.linear_blocks[index];
  const Vec3 direction =
      sample_linear_block(block, tree.cell_width, minf(r, r_end), minf(s, s_end));
  return {direction, linear_block_pdf(block, tree.cell_width,
                                      cell_azimuth(direction, tree.cell_width), direction) *
                         product.ratio[cut.node_of_block[index]]};
}

}  // namespace skytree
