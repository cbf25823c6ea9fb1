// SPDX-License-Identifier: GPL-3.0-or-later
// Learnt visibility: what shadow rays from a place met steers where later ones from there go.
//
// A light sampler with a two-dimensional warp maps the unit square to directions in proportion to
// the map's radiance, whatever is in the way. Per cell of space and side of the surface a coarse
// density over that square is learnt and put before the warp: J. Guo, P. Bauszat, J. Bikker and E.
// Eisemann, "Primary Sample Space Path Guiding", EGSR 2018. So it works with every such sampler,
// knows nothing of the tree inside, and being monotone keeps neighbouring random numbers in
// neighbouring directions.
//
// Cells are those of N. Binder, S. Fricke and A. Keller, "Massively Parallel Path Space Filtering",
// 2018: their size grows with the distance to the eye, and they are found by a hash. Two cells
// with one hash share a slot, which costs a little precision and no bookkeeping: what a slot has
// learnt does not depend on the order of its records.
#pragma once

#include "kernel/math.h"
#include "kernel/rng.h"

namespace skytree {

/// A GPU renders without learning: its passes would have to wait for the tables.
#if defined(__CUDA_ARCH__)
constexpr bool kLearnsVisibility = false;
#else
constexpr bool kLearnsVisibility = true;
#endif

/// Regions that the unit square is cut into, by halving it so often.
constexpr int kGuideDepth = 9;
constexpr int kGuideRegions = 1 << kGuideDepth;
/// Slots: a power of two. The lowest three bits say which way the surface faces, guide_side.
constexpr uint32_t kGuideSlots = 1u << 13;
constexpr uint32_t kGuideSides = 6;
/// Side of a cell over the power of two below its distance from the eye.
constexpr float kGuideCellSize = 0.5f;

/// Row of ratios after those of the slots: every region alike.
constexpr uint32_t kGuideEvenSlot = kGuideSlots;

/// What the shadow rays into a region met: how many there were, and the sum of (visible * cosine)^2
/// in units of 1/255.
struct GuideCounter {
  uint32_t trials, squares;
};

struct GuideView {
  // Inner nodes of the tree over the unit square, kGuideRegions - 1, the same for all slots: the
  // children of node n are 2n + 1 and 2n + 2, and region i has the number kGuideRegions - 1 + i.
  const float* cuts = nullptr;    // where they are cut on u.y or, if negative, u.z; null: no guide
  const float* shares = nullptr;  // of their areas that lie before the cuts
  const float* ratios = nullptr;  // (kGuideSlots + 1) x kGuideRegions: of a slot's samples that do
  const uint8_t* used = nullptr;  // whether a slot's ratios are worth using
  GuideCounter* counters = nullptr;  // kGuideSlots x kGuideRegions; null: nothing is recorded
  uint8_t* touched = nullptr;        // whether a slot has records
  bool probing = false;  // first vertices send a ray into any region, to learn what it meets
  Vec3 eye = {0, 0, 0};
  float cell_size = 0.0f;  // fixed side of a cell; 0: by distance to the eye
};

/// Which of +x, -x, +y, -y, +z, -z a normal is nearest to.
SKY_HD uint32_t guide_side(Vec3 normal) {
  const Vec3 a = {fabsf(normal.x), fabsf(normal.y), fabsf(normal.z)};
  const bool along_x = a.x >= a.y && a.x >= a.z, along_y = !along_x && a.y >= a.z;
  const float component = along_x ? normal.x : along_y ? normal.y : normal.z;
  return (along_x ? 0u : along_y ? 2u : 4u) + (component < 0.0f ? 1u : 0u);
}

/// Slot of a point on a surface. `normal` faces the side that is seen.
SKY_HD uint32_t guide_slot(const GuideView& guide, Vec3 position, Vec3 normal) {
  const Vec3 from_eye = position - guide.eye;
  const float distance2 = maxf(dot(from_eye, from_eye), 1e-12f);
  // The exponent of the squared distance by two is that of the distance.
  const int level = ((int)(float_bits(distance2) >> 23) - 127) >> 1;
  const float size =
      guide.cell_size > 0.0f ? guide.cell_size : kGuideCellSize * detail::pow2_int(level);
  const float inv_size = 1.0f / size;
  const uint32_t side = guide_side(normal);
  uint32_t key = hash_u32(side + 8u * (uint32_t)(guide.cell_size > 0.0f ? 0 : level));
  // Far away a cell's number no longer fits an int: all that is left is one cell.
  key = hash_u32(key + (uint32_t)(int32_t)floorf(clampf(position.x * inv_size, -1e9f, 1e9f)));
  key = hash_u32(key + (uint32_t)(int32_t)floorf(clampf(position.y * inv_size, -1e9f, 1e9f)));
  key = hash_u32(key + (uint32_t)(int32_t)floorf(clampf(position.z * inv_size, -1e9f, 1e9f)));
  return (key & (kGuideSlots / 8 - 1)) * 8 + side;
}

/// A walk from the root to a region, for the host in step with those of other lanes: a node's
/// rectangle among the random numbers, and in the square that it is mapped to.
struct GuideWalk {
  Vec2 from, from_size, to, to_size;
  int32_t node;
};

SKY_HD GuideWalk guide_root() { return {{0, 0}, {1, 1}, {0, 0}, {1, 1}, 0}; }

/// From a node with this cut, share and ratio to the child whose random numbers `u` is among.
/// Without branches: which way it goes nobody can predict.
SKY_HD void guide_step(float cut, float share, float ratio, Vec2 u, GuideWalk* walk) {
  const bool up = cut < 0.0f;
  const float start = up ? walk->from.y : walk->from.x;
  const float size = up ? walk->from_size.y : walk->from_size.x;
  const float middle = start + size * ratio;
  const bool second = (up ? u.y : u.x) >= middle;
  const float new_start = second ? middle : start;
  const float new_size = size * (second ? 1.0f - ratio : ratio);
  const float new_to = second ? fabsf(cut) : up ? walk->to.y : walk->to.x;
  const float new_to_size =
      (up ? walk->to_size.y : walk->to_size.x) * (second ? 1.0f - share : share);
  walk->from = {up ? walk->from.x : new_start, up ? new_start : walk->from.y};
  walk->from_size = {up ? walk->from_size.x : new_size, up ? new_size : walk->from_size.y};
  walk->to = {up ? walk->to.x : new_to, up ? new_to : walk->to.y};
  walk->to_size = {up ? walk->to_size.x : new_to_size, up ? new_to_size : walk->to_size.y};
  walk->node = 2 * walk->node + (second ? 2 : 1);
}

struct GuidedPoint {
  Vec2 point;
  float density;  // over the unit square; its mean is 1
  int32_t region;
};

/// Where in its region `u` ends. Clamped, as rounding may put a number a little outside the
/// rectangle that it was found to be in.
SKY_HD GuidedPoint guide_arrival(const GuideWalk& walk, Vec2 u) {
  const float x = clampf((u.x - walk.from.x) / walk.from_size.x, 0.0f, kOneMinusEpsilon);
  const float y = clampf((u.y - walk.from.y) / walk.from_size.y, 0.0f, kOneMinusEpsilon);
  return {{minf(walk.to.x + walk.to_size.x * x, kOneMinusEpsilon),
           minf(walk.to.y + walk.to_size.y * y, kOneMinusEpsilon)},
          (walk.from_size.x * walk.from_size.y) / (walk.to_size.x * walk.to_size.y),
          walk.node - (kGuideRegions - 1)};
}

/// Where a slot's learnt warp puts `u`, both in [0,1)^2.
SKY_HD GuidedPoint guide_warp(const GuideView& guide, uint32_t slot, Vec2 u) {
  const float* ratios = guide.ratios + (size_t)slot * kGuideRegions;
  GuideWalk walk = guide_root();
  for (int level = 0; level < kGuideDepth; ++level) {
    guide_step(guide.cuts[walk.node], guide.shares[walk.node], ratios[walk.node], u, &walk);
  }
  return guide_arrival(walk, u);
}

/// The child of a node with this cut in which `point` lies.
SKY_HD int32_t guide_child(float cut, Vec2 point, int32_t node) {
  return 2 * node + ((cut < 0.0f ? point.y : point.x) >= fabsf(cut) ? 2 : 1);
}

SKY_HD int32_t guide_region(const GuideView& guide, Vec2 point) {
  int32_t node = 0;
  for (int level = 0; level < kGuideDepth; ++level) {
    node = guide_child(guide.cuts[node], point, node);
  }
  return node - (kGuideRegions - 1);
}

/// The areas of a node's rectangles, as in GuideWalk, on the way to a point of the square.
struct GuideAreas {
  float from, to;
  int32_t node;
};

SKY_HD void guide_descend(float cut, float share, float ratio, Vec2 point, GuideAreas* areas) {
  const int32_t child = guide_child(cut, point, areas->node);
  const bool second = child == 2 * areas->node + 2;
  areas->from *= second ? 1.0f - ratio : ratio;
  areas->to *= second ? 1.0f - share : share;
  areas->node = child;
}

/// Density of guide_warp at a point that something else has chosen.
SKY_HD float guide_density(const GuideView& guide, uint32_t slot, Vec2 point) {
  const float* ratios = guide.ratios + (size_t)slot * kGuideRegions;
  GuideAreas areas = {1.0f, 1.0f, 0};
  for (int level = 0; level < kGuideDepth; ++level) {
    guide_descend(guide.cuts[areas.node], guide.shares[areas.node], ratios[areas.node], point,
                  &areas);
  }
  return areas.from / areas.to;
}

SKY_HD void guide_count(uint32_t* counter, uint32_t amount) {
#if defined(__CUDA_ARCH__)
  atomicAdd(counter, amount);
#else
  __atomic_fetch_add(counter, amount, __ATOMIC_RELAXED);
#endif
}

/// A light sample that waits for its shadow ray, in one word: its counter, and what it counts if
/// the ray arrives.
constexpr uint32_t kNoGuideRecord = ~0u;

/// `value` is the cosine at the surface, 0 where the sample lies below it.
SKY_HD uint32_t guide_record(uint32_t slot, int32_t region, float value) {
  const uint32_t square = (uint32_t)(clampf(value * value, 0.0f, 1.0f) * 255.0f + 0.5f);
  return ((slot * kGuideRegions + (uint32_t)region) << 8) | square;
}

SKY_HD void guide_commit(const GuideView& guide, uint32_t record, bool visible) {
  if (record == kNoGuideRecord || !guide.counters) return;
  GuideCounter* counter = guide.counters + (record >> 8);
  guide_count(&counter->trials, 1);
  if (visible) guide_count(&counter->squares, record & 255u);
  guide.touched[(record >> 8) / kGuideRegions] = 1;  // whoever writes, writes the same
}

}  // namespace skytree
