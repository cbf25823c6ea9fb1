// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/mesh.h"

#include <cmath>
#include <cstring>

namespace skytree {
namespace {

/// Embree reads 16 bytes at each vertex: a shared buffer must be readable 4 bytes beyond its last.
std::vector<float> vertex_array(size_t vertex_count) {
  std::vector<float> array;
  array.reserve(3 * vertex_count + 1);
  return array;
}

// Of a sum: a single test for the whole vector, and a NaN or an infinity in any component survives
// addition.
bool is_finite3(const float* p) {
  return std::isfinite(std::fabs(p[0]) + std::fabs(p[1]) + std::fabs(p[2]));
}

/// Twice the area is the length of the cross product; in double, as small triangles far away
/// underflow in float.
bool has_area(const float* a, const float* b, const float* c) {
  const double x1 = double(b[0]) - a[0], y1 = double(b[1]) - a[1], z1 = double(b[2]) - a[2];
  const double x2 = double(c[0]) - a[0], y2 = double(c[1]) - a[1], z2 = double(c[2]) - a[2];
  const double x = y1 * z2 - z1 * y2, y = z1 * x2 - x1 * z2, z = x1 * y2 - y1 * x2;
  return x * x + y * y + z * z > 0.0;
}

std::string describe(const std::string& name, size_t out_of_range, size_t not_finite,
                     size_t degenerate) {
  std::string text;
  auto add = [&](size_t count, const char* what) {
    if (count) text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + what;
  };
  add(out_of_range, "with an index out of range");
  add(not_finite, "with a vertex that is not finite");
  add(degenerate, "without area");
  return "mesh \"" + name + "\": triangles left out: " + text;
}

template <class T>
std::vector<T> copy_array(const T* data, size_t count) {
  return data ? std::vector<T>(data, data + count) : std::vector<T>();
}

}  // namespace

Mesh::Mesh(const MeshInput& input)
    : name_(input.name), positions_(vertex_array(input.vertex_count)) {
  positions_.assign(input.positions, input.positions + 3 * input.vertex_count);
  const bool has_corner_data = input.corner_normals || input.corner_uvs || input.corner_tangents;
  auto in_range = [](const int32_t* index, size_t count) {
    return size_t(uint32_t(index[0])) < count && size_t(uint32_t(index[1])) < count &&
           size_t(uint32_t(index[2])) < count;
  };
  size_t out_of_range = 0, not_finite = 0, degenerate = 0;
  std::vector<int32_t> kept;  // only filled once a triangle was left out
  for (size_t t = 0; t < input.triangle_count; ++t) {
    const int32_t* index = input.triangles + 3 * t;
    const int32_t implied[3] = {int32_t(3 * t), int32_t(3 * t + 1), int32_t(3 * t + 2)};
    const int32_t* corner = input.corners ? input.corners + 3 * t : implied;
    size_t* fault = nullptr;
    if (!in_range(index, input.vertex_count) ||
        (has_corner_data && !in_range(corner, input.corner_count))) {
      fault = &out_of_range;
    } else {
      const float* a = input.positions + 3 * size_t(index[0]);
      const float* b = input.positions + 3 * size_t(index[1]);
      const float* c = input.positions + 3 * size_t(index[2]);
      if (!is_finite3(a) || !is_finite3(b) || !is_finite3(c)) {
        fault = &not_finite;
      } else if (!has_area(a, b, c)) {
        fault = &degenerate;
      }
    }
    const size_t dropped = out_of_range + not_finite + degenerate;
    if (fault) {
      if (dropped == 0) {
        for (size_t k = 0; k < t; ++k) kept.push_back(int32_t(k));
      }
      ++*fault;
    } else if (dropped != 0) {
      kept.push_back(int32_t(t));
    }
  }

  const size_t dropped = out_of_range + not_finite + degenerate;
  if (dropped == 0) {
    triangles_ = copy_array(input.triangles, 3 * input.triangle_count);
    if (has_corner_data) corners_ = copy_array(input.corners, 3 * input.triangle_count);
    material_slots_ = copy_array(input.material_slots, input.triangle_count);
  } else {
    warning_ = describe(name_, out_of_range, not_finite, degenerate);
    for (const int32_t t : kept) {
      for (int k = 0; k < 3; ++k) {
        triangles_.push_back(input.triangles[3 * size_t(t) + k]);
        if (has_corner_data)
          corners_.push_back(input.corners ? input.corners[3 * size_t(t) + k] : 3 * t + k);
      }
      if (input.material_slots) material_slots_.push_back(input.material_slots[t]);
    }
  }
  corner_count_ = input.corner_count;
  corner_normals_ = copy_array(input.corner_normals, 3 * input.corner_count);
  corner_uvs_ = copy_array(input.corner_uvs, 2 * input.corner_count);
  corner_tangents_ = copy_array(input.corner_tangents, 3 * input.corner_count);
  // A zero normal falls back to the flat one where it is used.
  for (size_t i = 0; i + 2 < corner_normals_.size(); i += 3) {
    if (!is_finite3(&corner_normals_[i]))
      corner_normals_[i] = corner_normals_[i + 1] = corner_normals_[i + 2] = 0.0f;
  }
  for (float& x : corner_uvs_) x = std::isfinite(x) ? x : 0.0f;
  for (float& x : corner_tangents_) x = std::isfinite(x) ? x : 0.0f;

  lower_ = {INFINITY, INFINITY, INFINITY};
  upper_ = -lower_;
  for (size_t i = 0; i + 2 < positions_.size(); i += 3) {
    const Vec3 p = {positions_[i], positions_[i + 1], positions_[i + 2]};
    if (!is_finite3(&positions_[i])) continue;
    lower_ = {std::fmin(lower_.x, p.x), std::fmin(lower_.y, p.y), std::fmin(lower_.z, p.z)};
    upper_ = {std::fmax(upper_.x, p.x), std::fmax(upper_.y, p.y), std::fmax(upper_.z, p.z)};
  }
}

MeshView Mesh::view() const {
  auto pointer = [](const auto& array) { return array.empty() ? nullptr : array.data(); };
  MeshView view;
  view.positions = positions_.data();
  view.triangles = triangles_.data();
  view.corners = pointer(corners_);
  view.corner_normals = pointer(corner_normals_);
  view.corner_uvs = pointer(corner_uvs_);
  view.corner_tangents = pointer(corner_tangents_);
  view.material_slots = pointer(material_slots_);
  const Vec3 size = upper_ - lower_;
  auto inverse = [](float x) { return x > 0.0f ? 1.0f / x : 0.0f; };
  view.center = (lower_ + upper_) * 0.5f;
  view.inverse_size = {inverse(size.x), inverse(size.y), inverse(size.z)};
  return view;
}

size_t Mesh::nbytes() const {
  return sizeof(float) * (positions_.size() + corner_normals_.size() + corner_uvs_.size() +
                          corner_tangents_.size()) +
         sizeof(int32_t) * (triangles_.size() + corners_.size() + material_slots_.size());
}

bool Mesh::build(const std::atomic<bool>& cancel) {
  if (tree_ || empty()) return true;
  const EmbreeApi& api = embree();
  EmbreeScene tree = new_embree_scene();
  api.AttachGeometryByID(tree.get(), new_geometry({}).get(), 0);
  if (!commit_embree_scene(tree.get(), cancel)) return false;
  tree_ = std::move(tree);
  return true;
}

std::vector<float> Mesh::placed(const InstanceView& instance) const {
  std::vector<float> placed = vertex_array(vertex_count());
  placed.resize(positions_.size());
  for (size_t i = 0; i + 2 < positions_.size(); i += 3) {
    const Vec3 p = place(instance, {positions_[i], positions_[i + 1], positions_[i + 2]});
    placed[i] = p.x;
    placed[i + 1] = p.y;
    placed[i + 2] = p.z;
  }
  return placed;
}

EmbreeGeometry Mesh::new_geometry(const std::vector<float>& placed) const {
  const EmbreeApi& api = embree();
  EmbreeGeometry geometry(api.NewGeometry(api.device, RTC_GEOMETRY_TYPE_TRIANGLE));
  api.SetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                              placed.empty() ? positions_.data() : placed.data(), 0,
                              3 * sizeof(float), vertex_count());
  api.SetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              triangles_.data(), 0, 3 * sizeof(int32_t), triangle_count());
  api.CommitGeometry(geometry.get());
  check_embree(("mesh \"" + name_ + "\"").c_str());
  return geometry;
}

}  // namespace skytree
