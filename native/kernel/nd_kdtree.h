// SPDX-License-Identifier: GPL-3.0-or-later
// Sampling and density of a kd-tree over [0,1]^D, D = 1 to 4: the block sampler of Ergun, Kurt and
// Ozturk, "Real-time Kd-tree Based Importance Sampling of Environment Maps", SCCG 2012, in the
// dimensions that their closing remark speaks of.
//
// The first C dimensions may be given (a condition, such as the view direction of a BRDF); then the
// rest is drawn. The paper's ranks order the blocks of one distribution, but a given condition
// leaves only those blocks that it lies in, another set for each. So the tree splits the condition
// first, into slices; below a slice it splits the rest only. A slice is then a distribution of its
// own with a tree, ranks and an alpha of its own, and the conditional density is exact: it is the
// density of the block, known from one descent. (Splits in any order would make the mass of the
// blocks a sum over everything that the condition meets, at each sample and each density.)
#pragma once

#include "kernel/rank_model.h"

namespace skytree {

constexpr int kNdMaxDimensions = 4;

struct NdPoint {
  float x[kNdMaxDimensions];
};

/// What a node is stands in the low three bits of `link`: the axis that it splits, or one of these.
constexpr uint32_t kNdSlice = 4, kNdBlock = 5, kNdKindMask = 7;

struct NdNode {
  float split;    // inner node: position of the plane; block: its density given the condition
  float share;    // inner node below a slice: probability of its first child
  uint32_t link;  // above the kind: first child (the second follows it), slice or block
};

struct NdSlice {
  int32_t root;  // node
  int32_t first_block;
  RankModel ranks;
};

struct NdKdTreeView {
  const NdNode* nodes;  // the root is 0
  const NdSlice* slices;
  const float* bounds;  // per block, by falling rank in each slice: lower and upper corner of the
                        // free dimensions; null: blocks are chosen by a warp down the tree
  int32_t condition_count, free_count;
};

struct NdSample {
  NdPoint point;  // the free dimensions, from x[0] on
  float pdf;
};

/// The slice that a condition lies in.
SKY_HD const NdSlice& nd_slice(const NdKdTreeView& tree, const NdPoint& condition) {
  NdNode node = tree.nodes[0];
  while ((node.link & kNdKindMask) != kNdSlice) {
    const bool second = condition.x[node.link & kNdKindMask] >= node.split;
    node = tree.nodes[(node.link >> 3) + second];
  }
  return tree.slices[node.link >> 3];
}

/// Density of a point of the free dimensions in [0,1].
SKY_HD float nd_pdf(const NdKdTreeView& tree, const NdSlice& slice, const NdPoint& point) {
  NdNode node = tree.nodes[slice.root];
  while ((node.link & kNdKindMask) != kNdBlock) {
    const int axis = static_cast<int>(node.link & kNdKindMask) - tree.condition_count;
    node = tree.nodes[(node.link >> 3) + (point.x[axis] >= node.split)];
  }
  return node.split;
}

/// lower <= result < upper, so that nd_pdf finds the block that the point was drawn in.
SKY_HD float nd_in_block(float lower, float upper, float u) {
  const float below = bits_float(float_bits(upper) - 1);  // upper > 0
  return minf(maxf(lower + u * (upper - lower), lower), below);
}

/// By ranks; `choice` in [0,1) chooses the block, `u` the point in it.
SKY_HD NdSample nd_sample_by_rank(const NdKdTreeView& tree, const NdSlice& slice, float choice,
                                  const NdPoint& u) {
  const int32_t rank = sample_rank(slice.ranks, choice);
  const int32_t free_count = tree.free_count;
  const float* lower = tree.bounds + 2 * free_count * (slice.first_block + rank);
  NdSample sample = {};
  for (int i = 0; i < free_count; ++i) {
    const float upper = lower[free_count + i];
    sample.point.x[i] = nd_in_block(lower[i], upper, u.x[i]);
  }
  // From the tree, as nd_pdf has it: P / volume computed here could differ in the last bit.
  sample.pdf = nd_pdf(tree, slice, sample.point);
  return sample;
}

/// By a monotone warp down the tree (McCool and Harwood, "Probability Trees", GI 1997): each number
/// is used in its own dimension, so that stratified numbers give stratified points.
SKY_HD NdSample nd_sample_by_warp(const NdKdTreeView& tree, const NdSlice& slice, NdPoint u) {
  float lower[kNdMaxDimensions] = {0, 0, 0, 0}, upper[kNdMaxDimensions] = {1, 1, 1, 1};
  NdNode node = tree.nodes[slice.root];
  while ((node.link & kNdKindMask) != kNdBlock) {
    const int axis = static_cast<int>(node.link & kNdKindMask) - tree.condition_count;
    const float number = u.x[axis];
    const bool second = number >= node.share;
    if (second) {
      u.x[axis] = minf((number - node.share) / (1.0f - node.share), kOneMinusEpsilon);
      lower[axis] = node.split;
    } else {
      u.x[axis] = minf(number / node.share, kOneMinusEpsilon);
      upper[axis] = node.split;
    }
    node = tree.nodes[(node.link >> 3) + second];
  }
  NdSample sample = {};
  sample.pdf = node.split;
  for (int i = 0; i < tree.free_count; ++i) {
    sample.point.x[i] = nd_in_block(lower[i], upper[i], u.x[i]);
  }
  return sample;
}

SKY_HD NdSample nd_sample(const NdKdTreeView& tree, const NdSlice& slice, float choice,
                          const NdPoint& u) {
  return tree.bounds ? nd_sample_by_rank(tree, slice, choice, u)
                     : nd_sample_by_warp(tree, slice, u);
}

/// With one number less: the one that chose the rank is used again for the first dimension.
SKY_HD NdSample nd_sample(const NdKdTreeView& tree, const NdSlice& slice, NdPoint u) {
  if (!tree.bounds) return nd_sample_by_warp(tree, slice, u);
  const RankModel& ranks = slice.ranks;
  const float choice = u.x[0];
  const int32_t rank = sample_rank(ranks, choice);
  const float before = sky_log1p(static_cast<float>(rank) / ranks.alpha) / ranks.log_range;
  const float left = (choice - before) / rank_probability(ranks, rank);
  u.x[0] = minf(maxf(left, 0.0f), kOneMinusEpsilon);
  return nd_sample_by_rank(tree, slice, choice, u);
}

}  // namespace skytree
