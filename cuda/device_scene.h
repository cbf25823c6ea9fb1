// SPDX-License-Identifier: GPL-3.0-or-later
// A scene's copy on a GPU. Meshes, textures, the map and the sampler's tables are sent once and
// shared by all sessions of a context; small tables are sent when their bytes changed.
#pragma once

#include <vector>

#include "cuda/device_sampler.h"
#include "kernel/bvh.h"
#include "src/bvh_builder.h"
#include "src/scene_parts.h"

namespace skytree::cuda {

/// Geometry and tree of one mesh.
struct DeviceMesh {
  uint64_t serial;
  MeshView view;
  MeshBvhView bvh;
  Bounds bounds;
  std::vector<Buffer> arrays;
};

struct DeviceTexels {
  Buffer texels;
  std::shared_ptr<const void>
      source;  // keeps the host's address, which is the key, from being used anew
};

struct SharedSampler {
  DeviceSampler tables;
  std::shared_ptr<const EnvironmentSampler> source;
  bool products;  // whether the tables of product sampling are there
};

/// A tabulated BRDF's arrays, and its view with their addresses.
struct DeviceBrdf {
  TabulatedBrdfView view;
  std::vector<Buffer> arrays;
  std::shared_ptr<const BrdfKdTree> source;
};

/// An array that is sent only when it changed.
class Mirror {
 public:
  /// True if it was sent.
  bool set(const ContextPointer& context, const void* data, size_t bytes);
  template <class T>
  bool set(const ContextPointer& context, const std::vector<T>& data) {
    return set(context, data.data(), data.size() * sizeof(T));
  }
  template <class T>
  const T* as() const {
    return buffer_.as<T>();
  }

 private:
  Buffer buffer_;
  std::vector<char> copy_;
};

class DeviceScene {
 public:
  explicit DeviceScene(ContextPointer context) : context_(std::move(context)) {}

  /// Sends what changed since the last call and builds trees for new meshes; false when cancelled.
  /// Throws Error. Not while a kernel reads the scene.
  bool update(const SceneParts& parts, const std::shared_ptr<const EnvironmentSampler>& sampler,
              bool products, const float* filter_table, const std::atomic<bool>& cancel);

  const SceneView& view() const { return view_; }
  const TracerView& tracer() const { return tracer_; }
  const float* filter_table() const { return filter_table_.as<float>(); }

 private:
  bool update_meshes(const SceneParts& parts, const std::atomic<bool>& cancel);
  bool update_instances(const SceneParts& parts, const std::atomic<bool>& cancel);
  bool update_textures(const SceneParts& parts, const std::atomic<bool>& cancel);
  bool update_brdfs(const SceneParts& parts, const std::atomic<bool>& cancel);
  bool update_environment(const SceneParts& parts,
                          const std::shared_ptr<const EnvironmentSampler>& sampler, bool products,
                          const std::atomic<bool>& cancel);

  ContextPointer context_;
  std::vector<std::shared_ptr<const DeviceMesh>> meshes_;
  std::vector<std::shared_ptr<const DeviceTexels>> textures_;
  std::vector<std::shared_ptr<const DeviceBrdf>> brdfs_;
  std::shared_ptr<const DeviceTexels> image_;
  std::shared_ptr<const SharedSampler> sampler_;
  Mirror mesh_views_, mesh_trees_, instances_, instance_materials_, materials_, closures_;
  Mirror texture_views_, brdf_views_, albedo_, filter_table_, white_, top_nodes_, top_instances_;
  std::vector<Bounds> top_bounds_;  // of the meshes, for which the top level was built
  SceneView view_ = {};
  TracerView tracer_ = {};
};

}  // namespace skytree::cuda
