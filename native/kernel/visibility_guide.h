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

/// Regions that the unit square is cut into.
constexpr int kGuideRegions = 512;
/// Slots: a power of two. The lowest three bits say which way the surface faces, guide_side.
constexpr uint32_t kGuideSlots = 1u << 13;
constexpr uint32_t kGuideSides = 6;
/// Side of a cell over the power of two below its distance from the eye.
constexpr float kGuideCellSize = 0.5f;

/// Row of ratios after those of the slots: every region alike.
constexpr uint32_t kGuideEvenSlot = kGuideSlots;

/// Inner node of the tree over the unit square, the same for all slots. Node 0 is the root; a child
/// that is not smaller than kGuideRegions - 1 is the region child - (kGuideRegions - 1).
struct GuideNode {
  float threshold;    // where the square is cut, on u.y (axis 0) or u.z (axis 1)
  float first_share;  // of the node's area that lies before it
  uint16_t children[2];
  int32_t axis;
};

/// What the shadow rays into a region met: how many there were, and the sum of (visible * cosine)^2
/// in units of 1/255.
struct GuideCounter {
  uint32_t trials, squares;
};

struct GuideView {
  const GuideNode* nodes = nullptr;  // kGuideRegions - 1; null: no guide
  const uint16_t* ratios = nullptr;  // (kGuideSlots + 1) x kGuideRegions: per inner node
  const float* densities = nullptr;  // the same, per region: of the warp over the unit square
  const uint8_t* used = nullptr;     // whether a slot's ratios are worth using
  GuideCounter* counters = nullptr;  // kGuideSlots x kGuideRegions; null: nothing is recorded
  uint8_t* touched = nullptr;        // whether a slot has records
  bool probing = false;              // vertices send a ray into any region, to learn what it meets
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

SKY_HD float guide_ratio(uint16_t ratio) { return ((float)ratio + 0.5f) * (1.0f / 65536.0f); }

struct GuidedPoint {
  Vec2 point;
  float density;  // over the unit square; its mean is 1
  int32_t region;
};

/// Where a slot's learnt warp puts `u`, both in [0,1)^2.
SKY_HD GuidedPoint guide_warp(const GuideView& guide, uint32_t slot, Vec2 u) {
  const uint16_t* ratios = guide.ratios + (size_t)slot * kGuideRegions;
  // The node's rectangle among the random numbers, and in the square that it is mapped to.
  Vec2 from = {0, 0}, from_size = {1, 1}, to = {0, 0}, to_size = {1, 1};
  int32_t node = 0;
  while (node < kGuideRegions - 1) {
    const GuideNode cut = guide.nodes[node];
    const bool vertical = cut.axis != 0;
    const float ratio = guide_ratio(ratios[node]);
    const float start = vertical ? from.y : from.x, size = vertical ? from_size.y : from_size.x;
    const float middle = start + size * ratio;
    const bool second = (vertical ? u.y : u.x) >= middle;
    const float new_start = second ? middle : start;
    const float new_size = size * (second ? 1.0f - ratio : ratio);
    const float share = second ? 1.0f - cut.first_share : cut.first_share;
    if (vertical) {
      from.y = new_start;
      from_size.y = new_size;
      to.y = second ? cut.threshold : to.y;
      to_size.y *= share;
    } else {
      from.x = new_start;
      from_size.x = new_size;
      to.x = second ? cut.threshold : to.x;
      to_size.x *= share;
    }
    node = cut.children[second];
  }
  // Clamped, as rounding may put a number a little outside the rectangle that it was found to be
  // in.
  const float x = clampf((u.x - from.x) / from_size.x, 0.0f, kOneMinusEpsilon);
  const float y = clampf((u.y - from.y) / from_size.y, 0.0f, kOneMinusEpsilon);
  const int32_t region = node - (kGuideRegions - 1);
  return {
      {minf(to.x + to_size.x * x, kOneMinusEpsilon), minf(to.y + to_size.y * y, kOneMinusEpsilon)},
      guide.densities[(size_t)slot * kGuideRegions + region],
      region};
}

SKY_HD int32_t guide_region(const GuideView& guide, Vec2 point) {
  int32_t node = 0;
  while (node < kGuideRegions - 1) {
    const GuideNode& cut = guide.nodes[node];
    node = cut.children[(cut.axis ? point.y : point.x) >= cut.threshold];
  }
  return node - (kGuideRegions - 1);
}

/// Density of guide_warp at a point that something else has chosen.
SKY_HD float guide_density(const GuideView& guide, uint32_t slot, Vec2 point) {
  return guide.densities[(size_t)slot * kGuideRegions + guide_region(guide, point)];
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
