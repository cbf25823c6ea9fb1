// SPDX-License-Identifier: GPL-3.0-or-later
// Ray traversal for devices that have no ray tracer of their own: two levels of binary trees, one
// over the instances and one over the triangles of each mesh, in one loop with one stack.
//
// Node layout and loop: T. Aila and S. Laine, "Understanding the Efficiency of Ray Traversal on
// GPUs", HPG 2009 (both children's bounds in the parent). Triangle test: T. Moeller and B.
// Trumbore, JGT 2(1), 1997, in the division-free form that Embree uses, so that both find the same
// hits but for rounding at edges. Bounds are widened as in T. Ize, "Robust BVH Ray Traversal", JCGT
// 2(2), 2013.
#pragma once

#include "kernel/scene_view.h"

namespace skytree {

/// 64 bytes, read as four 16-byte words. A child with count > 0 is a leaf: `child` is its first
/// primitive.
struct alignas(16) BvhNode {
  float xy[2][4];  // per child: lower x, upper x, lower y, upper y
  float z[4];      // lower z, upper z of the first child, then of the second
  int32_t child[2];
  int32_t count[2];
};

/// One triangle of a leaf: the vertex and edges that the test reads, in three 16-byte words.
struct alignas(16) BvhTriangle {
  Vec3 p0;
  int32_t index;  // in the mesh
  Vec3 e1;        // p0 - p1
  int32_t unused1;
  Vec3 e2;  // p2 - p0
  int32_t unused2;
};

struct MeshBvhView {
  const BvhNode* nodes;  // root first
  const BvhTriangle* triangles;
};

struct TracerView {
  const BvhNode* top_nodes;      // null: the scene is empty
  const int32_t* top_instances;  // instance numbers in the order of the top level's leaves
  const MeshBvhView* meshes;
};

constexpr int kMaxMeshDepth = 56;
constexpr int kMaxTopDepth = 38;

namespace detail {

constexpr int kBvhStackSize = kMaxMeshDepth + kMaxTopDepth + 2;
constexpr int32_t kLeaveMesh = INT32_MIN;  // on the stack: what lies below belongs to the top level

struct LocalRay {
  Vec3 origin, direction, inverse;
};

SKY_HD float safe_inverse(float x) {
  // Embree's bound: 1/x stays finite, so that no 0 * infinity makes a NaN of a slab distance.
  return 1.0f / (fabsf(x) < 1e-18f ? (x < 0.0f ? -1e-18f : 1e-18f) : x);
}

SKY_HD LocalRay make_local_ray(Vec3 origin, Vec3 direction) {
  return {origin,
          direction,
          {safe_inverse(direction.x), safe_inverse(direction.y), safe_inverse(direction.z)}};
}

/// Where the ray enters child `k`; infinity if it misses.
SKY_HD float enter_child(const BvhNode& node, int k, const LocalRay& ray, float t_min,
                         float t_max) {
  const float x0 = (node.xy[k][0] - ray.origin.x) * ray.inverse.x;
  const float x1 = (node.xy[k][1] - ray.origin.x) * ray.inverse.x;
  const float y0 = (node.xy[k][2] - ray.origin.y) * ray.inverse.y;
  const float y1 = (node.xy[k][3] - ray.origin.y) * ray.inverse.y;
  const float z0 = (node.z[2 * k] - ray.origin.z) * ray.inverse.z;
  const float z1 = (node.z[2 * k + 1] - ray.origin.z) * ray.inverse.z;
  const float enter = fmaxf(fmaxf(fminf(x0, x1), fminf(y0, y1)), fmaxf(fminf(z0, z1), t_min));
  const float leave = fminf(fminf(fmaxf(x0, x1), fmaxf(y0, y1)), fminf(fmaxf(z0, z1), t_max));
  // Each distance carries up to three roundings; 1 + 2 gamma(3) makes up for both ends.
  return enter <= leave * 1.0000004f ? enter : INFINITY;
}

/// Moeller-Trumbore without a division before the hit is certain. Shortens *t_max.
SKY_HD bool hit_triangle(const BvhTriangle& triangle, const LocalRay& ray, float t_min,
                         float* t_max, float* u, float* v) {
  const Vec3 normal = cross(triangle.e2, triangle.e1);
  const Vec3 c = triangle.p0 - ray.origin;
  const Vec3 r = cross(c, ray.direction);
  const float denominator = dot(normal, ray.direction);
  const float sign = denominator < 0.0f ? -1.0f : 1.0f;
  const float scale = fabsf(denominator);
  const float scaled_u = dot(r, triangle.e2) * sign;
  const float scaled_v = dot(r, triangle.e1) * sign;
  const float scaled_t = dot(normal, c) * sign;
  if (!(scaled_u >= 0.0f) || !(scaled_v >= 0.0f) || !(scaled_u + scaled_v <= scale)) return false;
  if (!(scaled_t > t_min * scale) || !(scaled_t <= *t_max * scale) || !(scale > 0.0f)) return false;
  *t_max = scaled_t / scale;
  *u = scaled_u / scale;
  *v = scaled_v / scale;
  return true;
}

}  // namespace detail

/// The nearest hit along the ray, or for `any` whichever comes first (of which only `instance` >= 0
/// counts).
SKY_HD_CALL Hit trace_ray(const TracerView& tracer, const InstanceView* instances, const Ray& ray,
                          bool any) {
  using namespace detail;
  Hit hit = {-1, -1, 0.0f, 0.0f, ray.t_max};
  if (!tracer.top_nodes) return hit;
  const LocalRay world = make_local_ray(ray.origin, ray.direction);
  LocalRay local = world;
  const BvhNode* nodes = tracer.top_nodes;
  const BvhTriangle* triangles = nullptr;
  int32_t instance = -1;  // whose mesh is being traversed; -1: the top level
  int32_t stack[kBvhStackSize];
  int depth = 0;
  // Leaves go on the stack as inner nodes do: node 2n, child k of node n as leaf 2n + k with the
  // sign bit flipped.
  int32_t current = 0;
  for (;;) {
    if (current >= 0) {
      const BvhNode node = nodes[current];  // by value: four 16-byte loads on a GPU
      const float enter0 = enter_child(node, 0, local, ray.t_min, hit.t);
      const float enter1 = enter_child(node, 1, local, ray.t_min, hit.t);
      const bool hit0 = enter0 < INFINITY, hit1 = enter1 < INFINITY;
      const int32_t child0 = node.count[0] > 0 ? ~(2 * current) : node.child[0];
      const int32_t child1 = node.count[1] > 0 ? ~(2 * current + 1) : node.child[1];
      if (hit0 && hit1) {
        const bool swap = enter1 < enter0;
        stack[depth++] = swap ? child0 : child1;
        current = swap ? child1 : child0;
        continue;
      }
      if (hit0 || hit1) {
        current = hit0 ? child0 : child1;
        continue;
      }
    } else if (current != kLeaveMesh) {
      const int32_t slot = ~current;
      const BvhNode& node = nodes[slot >> 1];
      const int32_t first = node.child[slot & 1], count = node.count[slot & 1];
      if (instance < 0) {
        // One instance a leaf: the ray goes down into its mesh.
        instance = tracer.top_instances[first];
        const InstanceView& view = instances[instance];
        local = make_local_ray(transpose_mul(view.normal, ray.origin - view.translation),
                               transpose_mul(view.normal, ray.direction));
        nodes = tracer.meshes[view.mesh].nodes;
        triangles = tracer.meshes[view.mesh].triangles;
        stack[depth++] = kLeaveMesh;
        current = 0;
        continue;
      }
      for (int32_t i = first; i < first + count; ++i) {
        if (hit_triangle(triangles[i], local, ray.t_min, &hit.t, &hit.u, &hit.v)) {
          hit.instance = instance;
          hit.triangle = triangles[i].index;
          if (any) return hit;
        }
      }
    } else {
      instance = -1;
      nodes = tracer.top_nodes;
      local = world;
    }
    if (depth == 0) return hit;
    current = stack[--depth];
  }
}

}  // namespace skytree
