// SPDX-License-Identifier: GPL-3.0-or-later
// One triangle mesh: a checked copy of the caller's arrays and the ray-tracing tree over it.
#pragma once

#include <string>
#include <vector>

#include "kernel/geometry.h"
#include "src/embree_api.h"
#include "src/scene_parts.h"

namespace skytree {

/// Borrowed arrays, laid out as in MeshView; optional ones may be null.
struct MeshInput {
  const float* positions = nullptr;
  size_t vertex_count = 0;
  const int32_t* triangles = nullptr;
  size_t triangle_count = 0;
  const int32_t* corners = nullptr;
  size_t corner_count = 0;  // rows of the corner arrays
  const float* corner_normals = nullptr;
  const float* corner_uvs = nullptr;
  const float* corner_tangents = nullptr;
  const int32_t* material_slots = nullptr;
  std::string name;
};

class Mesh {
 public:
  /// Copies what can be rendered. Triangles with an index out of range, a vertex that is not finite
  /// or no area are left out and counted in `warning`; normals that are not finite become flat
  /// shading's.
  explicit Mesh(const MeshInput& input);

  MeshView view() const;
  bool empty() const { return triangles_.empty(); }
  const std::string& name() const { return name_; }
  const std::string& warning() const { return warning_; }  // empty: none
  uint64_t serial() const { return serial_; }
  size_t vertex_count() const { return positions_.size() / 3; }
  size_t triangle_count() const { return triangles_.size() / 3; }
  size_t corner_count() const { return corner_count_; }
  size_t nbytes() const;

  /// Builds the tree if it does not exist; false when cancelled. Throws std::runtime_error.
  bool build(const std::atomic<bool>& cancel);
  RTCScene tree() const { return tree_.get(); }

  /// The vertices in world space, by the arithmetic of make_surface; for new_geometry.
  std::vector<float> placed(const InstanceView& instance) const;
  /// The triangles as part of a tree. Borrows this mesh's arrays, and `placed` in place of its
  /// vertices unless that is empty. Throws std::runtime_error.
  EmbreeGeometry new_geometry(const std::vector<float>& placed) const;

 private:
  const uint64_t serial_ = next_serial();
  std::string name_, warning_;
  std::vector<float> positions_, corner_normals_, corner_uvs_, corner_tangents_;
  std::vector<int32_t> triangles_, corners_, material_slots_;
  size_t corner_count_ = 0;
  Vec3 lower_, upper_;
  EmbreeScene tree_;
};

}  // namespace skytree
