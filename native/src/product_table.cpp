// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/product_table.h"

namespace skytree {
namespace {

/// Leaves to BSDF samples what they do well by themselves: nodes no brighter than the mean of what
/// the lobe reflects lose their importance, those twice as bright keep all of it. MIS compensation
/// (O. Karlik et al., SIGGRAPH Asia 2019), which the tree's blocks have for the whole map, with a
/// soft limit: taking the mean off bright nodes, too, costs noise in highlights.
void compensate(const CutView& cut, float mean, float* importance) {
  float solid_angle = 0.0f;
  for (int32_t i = 0; i < cut.count; ++i) solid_angle += cut.nodes[i].solid_angle * importance[i];
  const float even = mean / solid_angle;
  for (int32_t i = 0; i < cut.count; ++i) {
    const CutNode& node = cut.nodes[i];
    const float contrast = node.probability / (even * node.solid_angle);
    importance[i] *= clampf(contrast - 1.0f, 0.0f, 1.0f);
  }
}

}  // namespace

ProductTable::ProductTable(const CutView& cut, ThreadTeam& team)
    : cuts(kTableCuts), means(kTableCuts) {
  // As arrays, for loops that the compiler vectorises.
  float x[kLargestCut], y[kLargestCut], z[kLargestCut], spread[kLargestCut];
  for (int32_t i = 0; i < cut.count; ++i) {
    const CutNode& node = cut.nodes[i];
    x[i] = node.direction.x;
    y[i] = node.direction.y;
    z[i] = node.direction.z;
    // Half vectors turn half as far as directions.
    spread[i] = 0.25f * node.spread;
  }
  // Of the directions in a cell about its middle, as if it were a square.
  const float cell_spread = 0.25f * (4.0f * kPi / kLobeAxes) / 6.0f;
  team.run(kLobeAxes, [&](int, int cell) {
    const Vec3 axis = lobe_axis(cell);
    float cosines[kLargestCut], importance[kLargestCut];
    for (int32_t i = 0; i < cut.count; ++i) {
      cosines[i] = axis.x * x[i] + axis.y * y[i] + axis.z * z[i];
    }
    const auto make = [&](int32_t index) {
      const float mean = mean_importance(cut, importance);
      float share = 1.0f - kUndirected;
      if (index < kCompensatedWidths * kLobeAxes && mean > 0.0f) {
        compensate(cut, mean, importance);
        share *= mean_importance(cut, importance) / mean;
      }
      make_product_cut(cut, importance, share, &cuts[index]);
      means[index] = mean < INFINITY ? mean : 0.0f;
    };
    for (int w = 0; w < kLobeWidths; ++w) {
      const float narrowest = lobe_width(w) * lobe_width(w) + cell_spread;
      for (int32_t i = 0; i < cut.count; ++i) {
        importance[i] = table_lobe(narrowest + spread[i], cosines[i]);
      }
      make(w * kLobeAxes + cell);
    }
    for (int32_t i = 0; i < cut.count; ++i) importance[i] = table_cosine(cosines[i]);
    make(kCosineCuts + cell);
  });
}

}  // namespace skytree
