// SPDX-License-Identifier: GPL-3.0-or-later
// Trees for kernel/bvh.h, built by Embree's builder (binned surface area heuristic, many threads)
// and flattened.
#pragma once

#include <atomic>
#include <vector>

#include "kernel/bvh.h"

namespace skytree {

struct Bounds {
  Vec3 lower, upper;
};

struct MeshBvh {
  std::vector<BvhNode> nodes;
  std::vector<BvhTriangle> triangles;
  Bounds bounds;
};

struct TopBvh {
  std::vector<BvhNode> nodes;
  std::vector<int32_t> instances;
};

/// Tree over the triangles (T,3) of positions (V,3); at least one triangle. False when cancelled.
/// Throws std::runtime_error when Embree cannot build it.
bool build_mesh_bvh(const float* positions, const int32_t* triangles, size_t triangle_count,
                    const std::atomic<bool>& cancel, MeshBvh* tree);

/// Tree over instances; bounds[i] are those of instance i's mesh, in the mesh's own space.
/// Instances without bounds (lower > upper) are left out. No nodes if nothing is left.
bool build_top_bvh(const std::vector<InstanceView>& instances, const std::vector<Bounds>& bounds,
                   const std::atomic<bool>& cancel, TopBvh* tree);

}  // namespace skytree
