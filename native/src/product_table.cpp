// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/product_table.h"

namespace skytree {

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
      means[index] = make_product_cut(cut, importance, &cuts[index]);
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
