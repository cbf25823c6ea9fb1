// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/bvh_builder.h"

#include <cmath>
#include <memory>
#include <stdexcept>

#include "src/embree_api.h"

namespace skytree {
namespace {

/// A node as Embree's callbacks build it, in Embree's own per-thread memory.
struct BuildNode {
  BuildNode* children[2];
  Bounds bounds[2];
  unsigned first, count;  // of a leaf: into the order array; count 0: inner node
};

struct BuildState {
  const std::atomic<bool>* cancel;
  std::vector<unsigned>* order;  // primitives, leaf after leaf
  std::atomic<unsigned> next{0};
};

Bounds empty_bounds() {
  return {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

void extend(Bounds* bounds, Vec3 p) {
  bounds->lower = {std::fmin(bounds->lower.x, p.x), std::fmin(bounds->lower.y, p.y),
                   std::fmin(bounds->lower.z, p.z)};
  bounds->upper = {std::fmax(bounds->upper.x, p.x), std::fmax(bounds->upper.y, p.y),
                   std::fmax(bounds->upper.z, p.z)};
}

void* create_node(RTCThreadLocalAllocator allocator, unsigned, void*) {
  return new (embree().ThreadLocalAlloc(allocator, sizeof(BuildNode), 16)) BuildNode{};
}

void set_children(void* node, void** children, unsigned count, void*) {
  for (unsigned k = 0; k < count; ++k) {
    static_cast<BuildNode*>(node)->children[k] = static_cast<BuildNode*>(children[k]);
  }
}

void set_bounds(void* node, const RTCBounds** bounds, unsigned count, void*) {
  for (unsigned k = 0; k < count; ++k) {
    const RTCBounds& b = *bounds[k];
    static_cast<BuildNode*>(node)->bounds[k] = {{b.lower_x, b.lower_y, b.lower_z},
                                                {b.upper_x, b.upper_y, b.upper_z}};
  }
}

void* create_leaf(RTCThreadLocalAllocator allocator, const RTCBuildPrimitive* primitives,
                  size_t count, void* user) {
  BuildState& state = *static_cast<BuildState*>(user);
  auto* leaf = static_cast<BuildNode*>(create_node(allocator, 2, user));
  // Leaves are made by many threads; `flatten` lays them out again in the order of the tree.
  leaf->first = state.next.fetch_add(unsigned(count));
  leaf->count = unsigned(count);
  for (size_t i = 0; i < count; ++i) (*state.order)[leaf->first + i] = primitives[i].primID;
  return leaf;
}

bool go_on(void* user, double) { return !static_cast<BuildState*>(user)->cancel->load(); }

RTCBuildPrimitive make_primitive(const Bounds& b, size_t index) {
  return {b.lower.x, b.lower.y, b.lower.z, 0, b.upper.x, b.upper.y, b.upper.z, unsigned(index)};
}

struct Flattener {
  const std::vector<unsigned>& build_order;
  std::vector<BvhNode>* nodes;
  std::vector<unsigned> order;  // primitives in the final order
  int deepest = 0;

  void set_child(int32_t node, int k, const BuildNode* child, const Bounds& bounds, int depth) {
    {
      BvhNode& target = (*nodes)[node];
      target.xy[k][0] = bounds.lower.x;
      target.xy[k][1] = bounds.upper.x;
      target.xy[k][2] = bounds.lower.y;
      target.xy[k][3] = bounds.upper.y;
      target.z[2 * k] = bounds.lower.z;
      target.z[2 * k + 1] = bounds.upper.z;
    }
    int32_t index = int32_t(order.size()), count = 0;
    if (child && child->count > 0) {
      count = int32_t(child->count);
      order.insert(order.end(), build_order.begin() + child->first,
                   build_order.begin() + child->first + child->count);
    } else if (child) {
      index = add_inner(child, depth + 1);
    }
    (*nodes)[node].child[k] = index;
    (*nodes)[node].count[k] = count;
  }

  int32_t add_inner(const BuildNode* node, int depth) {
    deepest = std::max(deepest, depth);
    const int32_t index = int32_t(nodes->size());
    nodes->push_back({});
    for (int k = 0; k < 2; ++k) set_child(index, k, node->children[k], node->bounds[k], depth);
    return index;
  }
};

/// Builds over `primitives`; the result is in `nodes` and the returned order of primitives. Empty
/// when cancelled.
std::vector<unsigned> build(std::vector<RTCBuildPrimitive> primitives, const Bounds& bounds,
                            unsigned max_leaf, int max_depth, const std::atomic<bool>& cancel,
                            std::vector<BvhNode>* nodes) {
  const EmbreeApi& api = embree();
  const size_t count = primitives.size();
  std::vector<unsigned> build_order(count);
  BuildState state;
  state.cancel = &cancel;
  state.order = &build_order;
  const std::unique_ptr<RTCBVHTy, decltype(api.ReleaseBVH)> bvh(api.NewBVH(api.device),
                                                                api.ReleaseBVH);
  RTCBuildArguments arguments = rtcDefaultBuildArguments();
  arguments.byteSize = sizeof arguments;
  arguments.buildQuality = RTC_BUILD_QUALITY_MEDIUM;
  arguments.maxBranchingFactor = 2;
  arguments.maxDepth = unsigned(max_depth);
  arguments.sahBlockSize = 1;
  arguments.minLeafSize = 1;
  arguments.maxLeafSize = max_leaf;
  arguments.bvh = bvh.get();
  arguments.primitives = primitives.data();
  arguments.primitiveCount = count;
  arguments.primitiveArrayCapacity = count;
  arguments.createNode = create_node;
  arguments.setNodeChildren = set_children;
  arguments.setNodeBounds = set_bounds;
  arguments.createLeaf = create_leaf;
  arguments.buildProgress = go_on;
  arguments.userPtr = &state;
  const auto* root = static_cast<const BuildNode*>(api.BuildBVH(&arguments));
  if (cancel.load()) {
    api.GetDeviceError(api.device);  // "cancelled" is no news to the caller
    return {};
  }
  check_embree("building a tree for the GPU");
  if (!root) throw std::runtime_error("building a tree for the GPU: Embree returned none");

  nodes->clear();
  nodes->reserve(count / 2 + 1);
  Flattener flattener = {build_order, nodes, {}};
  flattener.order.reserve(count);
  if (root->count > 0) {  // all in one leaf: traversal wants a node above it
    nodes->push_back({});
    flattener.set_child(0, 0, root, bounds, 1);
    // Slab tests take minima and maxima, so lower > upper would be hit; a box at infinity never is.
    const Vec3 infinity = {INFINITY, INFINITY, INFINITY};
    flattener.set_child(0, 1, nullptr, {infinity, infinity}, 1);
  } else {
    flattener.add_inner(root, 1);
  }
  if (flattener.deepest > max_depth) {
    throw std::runtime_error("building a tree for the GPU: it became deeper than traversal allows");
  }
  return std::move(flattener.order);
}

Vec3 vertex(const float* positions, int32_t index) { return load3(positions, index); }

}  // namespace

bool build_mesh_bvh(const float* positions, const int32_t* triangles, size_t triangle_count,
                    const std::atomic<bool>& cancel, MeshBvh* tree) {
  std::vector<RTCBuildPrimitive> primitives(triangle_count);
  tree->bounds = empty_bounds();
  for (size_t t = 0; t < triangle_count; ++t) {
    Bounds bounds = empty_bounds();
    for (int k = 0; k < 3; ++k) extend(&bounds, vertex(positions, triangles[3 * t + k]));
    extend(&tree->bounds, bounds.lower);
    extend(&tree->bounds, bounds.upper);
    primitives[t] = make_primitive(bounds, t);
  }
  const std::vector<unsigned> order =
      build(std::move(primitives), tree->bounds, 4, kMaxMeshDepth, cancel, &tree->nodes);
  if (order.empty()) return false;
  tree->triangles.resize(order.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const int32_t* index = triangles + 3 * size_t(order[i]);
    const Vec3 p0 = vertex(positions, index[0]);
    tree->triangles[i] = {p0,
                          int32_t(order[i]),
                          p0 - vertex(positions, index[1]),
                          0,
                          vertex(positions, index[2]) - p0,
                          0};
  }
  return true;
}

bool build_top_bvh(const std::vector<InstanceView>& instances,
                   const std::vector<Bounds>& mesh_bounds, const std::atomic<bool>& cancel,
                   TopBvh* tree) {
  tree->nodes.clear();
  tree->instances.clear();
  std::vector<RTCBuildPrimitive> primitives;
  Bounds all = empty_bounds();
  for (size_t i = 0; i < instances.size(); ++i) {
    const InstanceView& instance = instances[i];
    const Bounds& box = mesh_bounds[i];
    if (box.lower.x > box.upper.x) continue;
    Bounds bounds = empty_bounds();
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 p = {corner & 1 ? box.upper.x : box.lower.x,
                      corner & 2 ? box.upper.y : box.lower.y,
                      corner & 4 ? box.upper.z : box.lower.z};
      const Vec3 world = instance.linear * p + instance.translation;
      // What the transform and, on the way back, the ray's own transform may round away.
      const float slack =
          1e-6f * (max_abs_component(world) + max_abs_component(instance.translation));
      extend(&bounds, world - Vec3{slack, slack, slack});
      extend(&bounds, world + Vec3{slack, slack, slack});
    }
    extend(&all, bounds.lower);
    extend(&all, bounds.upper);
    primitives.push_back(make_primitive(bounds, i));
  }
  if (primitives.empty()) return true;
  const std::vector<unsigned> order =
      build(std::move(primitives), all, 1, kMaxTopDepth, cancel, &tree->nodes);
  tree->instances.assign(order.begin(), order.end());
  return !order.empty();
}

}  // namespace skytree
