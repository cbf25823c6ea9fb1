// SPDX-License-Identifier: GPL-3.0-or-later
// Look-ups in the map for many lanes. In a large map nearly every one waits for memory, so texels
// are asked for some lanes ahead of their use. Included by tile_lanes.h.
#pragma once

namespace skytree {
namespace SKYTREE_ISA {

/// Places in the map that are looked up together, and which lane each belongs to.
struct TexelLookups {
  int count;
  int lane[kBatch];
  float u[kBatch], v[kBatch];
  int x0[kBatch], x1[kBatch], y0[kBatch], y1[kBatch];
  float fx[kBatch], fy[kBatch];
  Vectors<kBatch> radiance;

  void append(int for_lane, float at_u, float at_v) {
    lane[count] = for_lane;
    u[count] = at_u;
    v[count] = at_v;
    ++count;
  }
  void set(int i, const BilinearCell& cell) {
    x0[i] = cell.x0;
    x1[i] = cell.x1;
    y0[i] = cell.y0;
    y1[i] = cell.y1;
    fx[i] = cell.fx;
    fy[i] = cell.fy;
  }
  BilinearCell cell(int i) const { return {x0[i], x1[i], y0[i], y1[i], fx[i], fy[i]}; }
};

SKY_LANE_LOOP void find_cells(const LatLongImage& image, TexelLookups* lookups) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < lookups->count; ++i) {
    lookups->set(i, bilinear_cell(image, lookups->u[i], lookups->v[i]));
  }
}

/// Asks for two neighbouring texels, which may lie in two cache lines.
SKY_HD void fetch_ahead(const LatLongImage& image, int x, int y) {
  const float* texels = image.texels + 3 * (static_cast<int64_t>(y) * image.width + x);
  __builtin_prefetch(texels);
  __builtin_prefetch(texels + 5);
}

/// The radiance of all places.
static void look_up(const LatLongImage& image, TexelLookups* lookups) {
  constexpr int kAhead = 12;  // lanes: about as long as the third-level cache takes
  find_cells(image, lookups);
  for (int i = -kAhead; i < lookups->count; ++i) {
    const int next = i + kAhead;
    if (next < lookups->count) {
      fetch_ahead(image, lookups->x0[next], lookups->y0[next]);
      fetch_ahead(image, lookups->x0[next], lookups->y1[next]);
    }
    if (i >= 0) lookups->radiance.set(i, lookup_cell(image, lookups->cell(i)));
  }
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
