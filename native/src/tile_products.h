// SPDX-License-Identifier: GPL-3.0-or-later
// Product sampling for many vertices at once: a packet of lanes goes down the splits level by
// level, each loop over the lanes one that the compiler vectorises. Same kernel functions and same
// bits as product_warp and product_ratio. Included by tile_lanes.h.
#pragma once

#include "src/tile_packets.h"
#include "src/tile_sampling.h"

namespace skytree {
namespace SKYTREE_ISA {

/// The mixture of each lane; a cut beyond a lane's own weighs 0.
struct LaneMixes {
  int count[kBatch];
  int32_t cut[kMixedCuts][kBatch];
  float weight[kMixedCuts][kBatch];

  void set(int i, const ProductMix& mix) {
    count[i] = mix.count;
    for (int k = 0; k < kMixedCuts; ++k) {
      cut[k][i] = k < mix.count ? mix.cut[k] : 0;
      weight[k][i] = k < mix.count ? mix.weight[k] : 0.0f;
    }
  }
  /// Fills up the last packet.
  void pad(int size) {
    for (int i = size; i % kLanes != 0; ++i) set(i, {});
  }
};

/// Words of the tables, for gathers.
struct ProductWords {
  static constexpr int kCut = sizeof(ProductCut) / 4, kFractions = kLargestCut;
  static constexpr int kNode = sizeof(CutNode) / 4, kLow = 5, kExtent = 7;
  static_assert(offsetof(ProductCut, fractions) == 4 * kFractions, "words of a cut");
  static_assert(offsetof(CutNode, warp_low) == 4 * kLow, "words of a node");
  static_assert(offsetof(CutNode, warp_extent) == 4 * kExtent, "words of a node");

  const CutSplit* splits;
  const uint32_t* cuts;
  const float *ratios, *nodes;
  int32_t root;

  explicit ProductWords(const ProductView& products)
      : splits(products.cut.splits),
        cuts(reinterpret_cast<const uint32_t*>(products.cuts)),
        ratios(reinterpret_cast<const float*>(products.cuts)),
        nodes(reinterpret_cast<const float*>(products.cut.nodes)),
        root(first_cut_node(products.cut)) {}
};

/// product_warp for lanes first, ..., first + kLanes - 1, which mix at most kCuts cuts each, in
/// place. Lanes without a mixture keep their point and have the factor 1.
template <int kCuts>
SKY_LANE_LOOP void warp_packet(const ProductWords& words, const LaneMixes& mixes, int first,
                               float* __restrict x, float* __restrict y, float* __restrict factor) {
  float reach[kCuts][kLanes], u[2][kLanes];
  int32_t node[kLanes];
  int left = 0;
  for (int i = 0; i < kLanes; ++i) {
    for (int k = 0; k < kCuts; ++k) reach[k][i] = mixes.weight[k][first + i];
    u[0][i] = x[first + i];
    u[1][i] = y[first + i];
    node[i] = mixes.count[first + i] > 0 ? words.root : ~0;
    left |= node[i] >= 0;
  }
  while (left) {
    left = 0;
    SKY_VECTOR_LOOP
    for (int i = 0; i < kLanes; ++i) {
      const bool inner = node[i] >= 0;
      const int32_t split = inner ? node[i] : 0;
      float fraction[kCuts], parts[kCuts];
      for (int k = 0; k < kCuts; ++k) {
        const int32_t word =
            mixes.cut[k][first + i] * ProductWords::kCut + ProductWords::kFractions + (split >> 1);
        fraction[k] = first_fraction(words.cuts[word], split);
        parts[k] = reach[k][i];
      }
      Vec2 point = {u[0][i], u[1][i]};
      int32_t next;
      pass_split({words.splits[split].children, words.splits[split].axis}, kCuts, fraction, parts,
                 &point, &next);
      for (int k = 0; k < kCuts; ++k) reach[k][i] = inner ? parts[k] : reach[k][i];
      u[0][i] = inner ? point.x : u[0][i];
      u[1][i] = inner ? point.y : u[1][i];
      node[i] = inner ? next : node[i];
      left |= node[i] >= 0 ? 1 : 0;
    }
  }
  SKY_VECTOR_LOOP
  for (int i = 0; i < kLanes; ++i) {
    const int32_t at = ~node[i];
    const float* part = words.nodes + ProductWords::kNode * at;
    const Vec2 point = point_in_node({part[ProductWords::kLow], part[ProductWords::kLow + 1]},
                                     {part[ProductWords::kExtent], part[ProductWords::kExtent + 1]},
                                     {u[0][i], u[1][i]});
    float ratio = 0.0f;
    for (int k = 0; k < kCuts; ++k) {
      const int32_t word = mixes.cut[k][first + i] * ProductWords::kCut + at;
      ratio += mixes.weight[k][first + i] * words.ratios[word];
    }
    const bool mixed = mixes.count[first + i] > 0;
    x[first + i] = mixed ? point.x : x[first + i];
    y[first + i] = mixed ? point.y : y[first + i];
    factor[first + i] = mixed ? ratio : 1.0f;
  }
}

/// product_warp of all lanes' points; `mixes` are padded.
static void warp_by_products(const ProductView& products, const LaneMixes& mixes, int count,
                             float* x, float* y, float* factor) {
  const ProductWords words(products);
  for (int first = 0; first < count; first += kLanes) {
    int most = 0;
    for (int i = first; i < first + kLanes; ++i) {
      if (i >= count) x[i] = y[i] = 0.0f;
      most = mixes.count[i] > most ? mixes.count[i] : most;
    }
    static_assert(kMixedCuts == 4, "cases");
    switch (most) {
      case 0:
      case 1:
        warp_packet<1>(words, mixes, first, x, y, factor);
        break;
      case 2:
        warp_packet<2>(words, mixes, first, x, y, factor);
        break;
      case 3:
        warp_packet<3>(words, mixes, first, x, y, factor);
        break;
      default:
        warp_packet<4>(words, mixes, first, x, y, factor);
    }
  }
}

/// product_ratio at nodes of the cut, 1 for lanes without a mixture.
SKY_LANE_LOOP void find_ratios(const ProductView& products, const LaneMixes& mixes, int count,
                               const int32_t* __restrict node, float* __restrict factor) {
  const ProductWords words(products);
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    float ratio = 0.0f;
    for (int k = 0; k < kMixedCuts; ++k) {
      ratio += mixes.weight[k][i] * words.ratios[mixes.cut[k][i] * ProductWords::kCut + node[i]];
    }
    factor[i] = mixes.count[i] > 0 ? ratio : 1.0f;
  }
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
