// SPDX-License-Identifier: GPL-3.0-or-later
// Points of many pixels at once: the same bits as kernel/multi_jittered.h's sample_pair. Included
// by tile_lanes.h.
#pragma once

#include "src/tile_sampling.h"

namespace skytree {
namespace SKYTREE_ISA {

/// permute_index of `v`. Walks are short: three steps in step, and what then is still outside.
SKY_LANE_LOOP void permute_lanes(const PermutedRange& range, JitterKey use, const uint32_t* seeds,
                                 uint32_t pair, int count, uint32_t* v) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    const uint32_t key = jitter_key(seeds[i], pair, use);
    uint32_t walked = permute_once(range, v[i], key);
    for (int step = 1; step < 3; ++step) {
      const uint32_t next = permute_once(range, walked, key);
      walked = walked < range.count ? walked : next;
    }
    v[i] = walked;
  }
  for (int i = 0; i < count; ++i) {
    if (v[i] >= range.count) v[i] = permute_index(range, v[i], jitter_key(seeds[i], pair, use));
  }
}

SKY_LANE_LOOP void draw_grid_pairs(const JitteredGrid& grid, const uint32_t* seeds,
                                   const uint32_t* index, int count, uint32_t pair,
                                   float* __restrict x, float* __restrict y) {
  uint32_t place[kBatch], column[kBatch], row[kBatch];
  for (int i = 0; i < count; ++i) place[i] = index[i];
  permute_lanes(grid.places, kIndexKey, seeds, pair, count, place);
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    row[i] = row_of_place(grid, place[i]);
    column[i] = place[i] - row[i] * grid.columns.count;
  }
  permute_lanes(grid.columns, kColumnKey, seeds, pair, count, column);
  permute_lanes(grid.rows, kRowKey, seeds, pair, count, row);
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    const Vec2 u = point_of_place(grid, place[i], column[i], row[i], seeds[i], pair);
    x[i] = u.x;
    y[i] = u.y;
  }
}

/// Pair `pair` of the points `index` of sequences, all of one kind; count as in sample_pair.
SKY_LANE_LOOP void draw_pairs(uint32_t point_count, const uint32_t* seeds, const uint32_t* index,
                              int count, uint32_t pair, float* __restrict x, float* __restrict y) {
  if (point_count > 0 && is_power_of_two(point_count)) {
    const uint32_t bits = bits_of(point_count - 1);
    SKY_VECTOR_LOOP
    for (int i = 0; i < count; ++i) {
      const Vec2 u = jittered_power_pair(seeds[i], index[i], pair, bits);
      x[i] = u.x;
      y[i] = u.y;
    }
    return;
  }
  if (point_count > 0) {
    draw_grid_pairs(jittered_grid(point_count), seeds, index, count, pair, x, y);
    return;
  }
  if (count > 0 && has_blue_noise(seeds[0])) {
    for (int i = 0; i < count; ++i) {
      const Vec2 u = blue_noise_pair(seeds[i], index[i], pair);
      x[i] = u.x;
      y[i] = u.y;
    }
    return;
  }
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    const Vec2 u = hashed_pair(seeds[i], index[i], pair);
    x[i] = u.x;
    y[i] = u.y;
  }
}

/// The same for light samples, of which vertices take differing numbers: 1 or settings.light_rays.
static void draw_light_points(const RenderSettings& settings, const int* light_rays,
                              const uint32_t* seeds, const uint32_t* index, int count,
                              uint32_t pair, float* x, float* y) {
  const int most = settings.light_rays;
  draw_pairs(settings.point_count * static_cast<uint32_t>(most), seeds, index, count, pair, x, y);
  if (settings.point_count == 0 || most == 1) return;
  for (int i = 0; i < count; ++i) {
    if (light_rays[i] == most || light_rays[i] == 0) continue;
    const Vec2 u = sample_pair(settings.point_count, seeds[i], index[i], pair);
    x[i] = u.x;
    y[i] = u.y;
  }
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
