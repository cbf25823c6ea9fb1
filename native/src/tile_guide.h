// SPDX-License-Identifier: GPL-3.0-or-later
// What has been learnt of visibility, for many vertices at once: lanes go down the guide's tree in
// step, so that the compiler vectorises every step. Same kernel functions and same bits as
// guide_warp and guide_density. Included by tile_lanes.h.
#pragma once

#include "src/tile_sampling.h"

namespace skytree {
namespace SKYTREE_ISA {

/// The lanes whose slots are guided, and what the guide is asked: random numbers or points in (x,
/// y).
struct GuideLanes {
  int count;
  int lane[kBatch];
  int32_t ratios[kBatch];  // where a slot's begin
  float x[kBatch], y[kBatch];
  float density[kBatch];
  int32_t node[kBatch];
  float from_x[kBatch], from_y[kBatch], from_width[kBatch], from_height[kBatch];
  float to_x[kBatch], to_y[kBatch], to_width[kBatch], to_height[kBatch];

  void append(int which, uint32_t slot, Vec2 point) {
    lane[count] = which;
    ratios[count] = static_cast<int32_t>(slot * kGuideRegions);
    x[count] = point.x;
    y[count++] = point.y;
  }
  int32_t region(int i) const { return node[i] - (kGuideRegions - 1); }
  GuideWalk walk(int i) const {
    return {{from_x[i], from_y[i]},
            {from_width[i], from_height[i]},
            {to_x[i], to_y[i]},
            {to_width[i], to_height[i]},
            node[i]};
  }
  void set(int i, const GuideWalk& walk) {
    from_x[i] = walk.from.x;
    from_y[i] = walk.from.y;
    from_width[i] = walk.from_size.x;
    from_height[i] = walk.from_size.y;
    to_x[i] = walk.to.x;
    to_y[i] = walk.to.y;
    to_width[i] = walk.to_size.x;
    to_height[i] = walk.to_size.y;
    node[i] = walk.node;
  }
};

/// guide_warp: random numbers become points.
SKY_LANE_LOOP void warp_lanes(const GuideView& guide, GuideLanes* lanes) {
  const float *cuts = guide.cuts, *shares = guide.shares, *ratios = guide.ratios;
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes->count; ++i) lanes->set(i, guide_root());
  for (int level = 0; level < kGuideDepth; ++level) {
    SKY_VECTOR_LOOP
    for (int i = 0; i < lanes->count; ++i) {
      GuideWalk walk = lanes->walk(i);
      guide_step(cuts[walk.node], shares[walk.node], ratios[lanes->ratios[i] + walk.node],
                 {lanes->x[i], lanes->y[i]}, &walk);
      lanes->set(i, walk);
    }
  }
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes->count; ++i) {
    const GuidedPoint guided = guide_arrival(lanes->walk(i), {lanes->x[i], lanes->y[i]});
    lanes->x[i] = guided.point.x;
    lanes->y[i] = guided.point.y;
    lanes->density[i] = guided.density;
  }
}

/// guide_density at points.
SKY_LANE_LOOP void find_guide_densities(const GuideView& guide, GuideLanes* lanes) {
  const float *cuts = guide.cuts, *shares = guide.shares, *ratios = guide.ratios;
  float *from = lanes->from_width, *to = lanes->to_width;
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes->count; ++i) {
    from[i] = to[i] = 1.0f;
    lanes->node[i] = 0;
  }
  for (int level = 0; level < kGuideDepth; ++level) {
    SKY_VECTOR_LOOP
    for (int i = 0; i < lanes->count; ++i) {
      GuideAreas areas = {from[i], to[i], lanes->node[i]};
      guide_descend(cuts[areas.node], shares[areas.node], ratios[lanes->ratios[i] + areas.node],
                    {lanes->x[i], lanes->y[i]}, &areas);
      from[i] = areas.from;
      to[i] = areas.to;
      lanes->node[i] = areas.node;
    }
  }
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes->count; ++i) lanes->density[i] = from[i] / to[i];
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
