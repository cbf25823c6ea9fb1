// SPDX-License-Identifier: GPL-3.0-or-later
// Sampling the map times a lobe: the upper part of the kd-tree, cut off at a hundred nodes or so,
// gets new probabilities, those of the nodes times the lobe at their mean directions; below the cut
// the tree stays as it is. So the density is that of the tree times a factor for each node of the
// cut, known for any direction. The idea of a cut is that of P. Clarberg et al., "Wavelet
// Importance Sampling", SIGGRAPH 2005, and of B. Walter et al., "Lightcuts", SIGGRAPH 2005.
//
// No probability is computed at a surface: a table has the cuts of some widths of lobe about many
// directions of the map, and a surface mixes those that are most like its own lobes
// (product_lobes.h). A mixture is drawn from split by split, not by choosing one of its cuts, so it
// is as monotone as the tree and keeps the stratification of its random numbers.
#pragma once

#include "kernel/math.h"
#include "kernel/vec.h"

namespace skytree {

constexpr int kLargestCut = 128;

/// A node of the cut: what lies below it, and where in the unit square of (u.y, u.z) the tree's
/// warp has it.
struct CutNode {
  Vec3 direction;     // mean, of unit length
  float spread;       // angular variance about it, radians^2
  float probability;  // of the tree
  Vec2 warp_low, warp_extent;
  float solid_angle;
};

/// A split above the cut; a child is another split or, as ~index, a node of the cut. Words, as a
/// host gathers those of many lanes at once.
struct CutSplit {
  uint32_t children;  // first | second << 16, each an int16_t
  int32_t axis;       // 0: u.y, 1: u.z
};

SKY_HD CutSplit make_cut_split(int32_t first, int32_t second, int32_t axis) {
  return {(uint32_t)(first & 0xffff) | (uint32_t)second << 16, axis};
}

SKY_HD int32_t cut_child(uint32_t children, bool second) {
  return (int32_t)(children << (second ? 0 : 16)) >> 16;
}

struct CutView {
  const CutNode* nodes;          // count
  const CutSplit* splits;        // count - 1, parents before children; the root is 0
  const uint8_t* node_of_block;  // the node that a block of the tree lies below
  int32_t count;                 // 1 to kLargestCut
};

/// The root: a split, or the only node as ~0.
SKY_HD int32_t first_cut_node(const CutView& cut) { return cut.count > 1 ? 0 : ~0; }

/// The cut for one lobe.
struct ProductCut {
  float ratio[kLargestCut];  // of each node's probability to that in the tree
  // Of each split's probability that is its first child's, in 1/65536, two to a word.
  uint32_t fractions[kLargestCut / 2];
};

SKY_HD float first_fraction(uint32_t fractions, int32_t split) {
  return (float)(int32_t)(fractions >> 16 * (split & 1) & 0xffffu) * (1.0f / 65536.0f);
}
SKY_HD float first_fraction(const ProductCut& cut, int32_t split) {
  return first_fraction(cut.fractions[split >> 1], split);
}

struct ProductView {
  CutView cut;
  const ProductCut* cuts;  // kTableCuts (product_lobes.h); null: the tree alone is sampled
  const float* means;      // of each cut's lobe, per steradian, over the tree's samples
};

constexpr int kMixedCuts = 4;

/// A mixture of cuts; without any the tree alone is meant.
struct ProductMix {
  int32_t count;
  int32_t cut[kMixedCuts];
  float weight[kMixedCuts];  // sum to 1
};

/// Share of the samples that a lobe does not direct: cuts are rough, and a node's mean direction
/// may lie below the horizon while parts of it do not.
constexpr float kUndirected = 0.1f;

/// Mean over the tree's samples of `importance[i]`, which each node of the cut has.
SKY_HD float mean_importance(const CutView& cut, const float* importance) {
  float mean = 0.0f;
  for (int32_t i = 0; i < cut.count; ++i) mean += cut.nodes[i].probability * importance[i];
  return mean;
}

/// `share` of the samples by `importance`, which is at least 0, the rest by the tree alone.
SKY_HD void make_product_cut(const CutView& cut, const float* importance, float share,
                             ProductCut* product) {
  const float mean = mean_importance(cut, importance);
  const bool directed = mean > 0.0f && mean < INFINITY;
  const float scale = directed ? share / mean : 0.0f;
  const float floor = directed ? 1.0f - share : 1.0f;
  float sums[kLargestCut];  // of splits
  for (uint32_t& pair : product->fractions) pair = 0;
  for (int32_t s = cut.count - 2; s >= 0; --s) {
    float parts[2];
    for (int side = 0; side < 2; ++side) {
      const int32_t child = cut_child(cut.splits[s].children, side);
      parts[side] = child >= 0
                        ? sums[child]
                        : cut.nodes[~child].probability * (floor + scale * importance[~child]);
    }
    sums[s] = parts[0] + parts[1];
    const float fraction = clampf(parts[0] / sums[s] * 65536.0f + 0.5f, 1.0f, 65535.0f);
    product->fractions[s >> 1] |= (uint32_t)fraction << 16 * (s & 1);
  }
  // The ratios are those of the rounded fractions.
  if (cut.count == 1) product->ratio[0] = 1.0f;
  for (int32_t s = 0; s + 1 < cut.count; ++s) {
    const float all = s == 0 ? 1.0f : sums[s], first = first_fraction(*product, s);
    for (int side = 0; side < 2; ++side) {
      const int32_t child = cut_child(cut.splits[s].children, side);
      const float part = all * (side ? 1.0f - first : first);
      if (child >= 0) {
        sums[child] = part;
      } else {
        product->ratio[~child] = part / cut.nodes[~child].probability;
      }
    }
  }
}

/// Density below a node of the cut to that of the tree alone.
SKY_HD_RARE float product_ratio(const ProductView& products, const ProductMix& mix, int32_t node) {
  float ratio = 0.0f;
  for (int k = 0; k < mix.count; ++k) {
    ratio += mix.weight[k] * products.cuts[mix.cut[k]].ratio[node];
  }
  return ratio;
}

/// A point of the tree's unit square, and product_ratio of the node that it lies in.
struct ProductPoint {
  Vec2 point;
  float ratio;
};

/// Takes u, a point of the unit square of what lies below a split, to one of its children, and so
/// `node`. Of each cut `fraction` goes to the first child and `reach` is its part of the
/// probability of the node.
SKY_HD void pass_split(CutSplit split, int cuts, const float* fraction, float* reach, Vec2* u,
                       int32_t* node) {
  float parts[kMixedCuts], first = 0.0f, both = 0.0f;
  for (int k = 0; k < cuts; ++k) {
    parts[k] = reach[k] * fraction[k];
    first += parts[k];
    both += reach[k];
  }
  // Without branches: which way a split sends a random point cannot be predicted.
  const float border = first / both;
  const bool across = split.axis == 0;
  const float x = across ? u->x : u->y;
  const bool second = x >= border;
  const float inside = (second ? x - border : x) / (second ? 1.0f - border : border);
  *u = {across ? inside : u->x, across ? u->y : inside};
  for (int k = 0; k < cuts; ++k) reach[k] = second ? reach[k] - parts[k] : parts[k];
  *node = cut_child(split.children, second);
}

/// The point of the tree's unit square that is u below a node of the cut.
SKY_HD Vec2 point_in_node(Vec2 low, Vec2 extent, Vec2 u) {
  // Rounding must not carry a number over the node's border.
  const float x = low.x + extent.x * minf(u.x, 1.0f - 1e-6f);
  const float y = low.y + extent.y * minf(u.y, 1.0f - 1e-6f);
  return {minf(x, (low.x + extent.x) * kOneMinusEpsilon),
          minf(y, (low.y + extent.y) * kOneMinusEpsilon)};
}

/// Where u lands. Monotone, so neighbours stay neighbours.
SKY_HD_RARE ProductPoint product_warp(const ProductView& products, const ProductMix& mix, Vec2 u) {
  const CutView& cut = products.cut;
  float reach[kMixedCuts], fraction[kMixedCuts];
  for (int k = 0; k < mix.count; ++k) reach[k] = mix.weight[k];
  int32_t node = first_cut_node(cut);
  while (node >= 0) {
    for (int k = 0; k < mix.count; ++k) {
      fraction[k] = first_fraction(products.cuts[mix.cut[k]], node);
    }
    pass_split(cut.splits[node], mix.count, fraction, reach, &u, &node);
  }
  return {point_in_node(cut.nodes[~node].warp_low, cut.nodes[~node].warp_extent, u),
          product_ratio(products, mix, ~node)};
}

}  // namespace skytree
