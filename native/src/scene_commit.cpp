// SPDX-License-Identifier: GPL-3.0-or-later
// From the parts of a scene to ray-tracing trees and the flat tables that the kernel reads.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>

#include "src/albedo_table.h"
#include "src/brdf_kdtree.h"
#include "src/diffuse_moments.h"
#include "src/environment_sampler.h"
#include "src/scene.h"

namespace skytree {
namespace {

double determinant3(const Matrix4& m) {
  return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
         m[2] * (m[4] * m[9] - m[5] * m[8]);
}

InstanceView make_instance_view(const Matrix4& m) {
  InstanceView view = {};
  auto row = [](double x, double y, double z) { return Vec3{float(x), float(y), float(z)}; };
  view.linear = {{row(m[0], m[1], m[2]), row(m[4], m[5], m[6]), row(m[8], m[9], m[10])}};
  view.translation = row(m[3], m[7], m[11]);
  // The inverse transpose is the cofactor matrix over the determinant.
  const double d = determinant3(m);
  view.normal = {{row((m[5] * m[10] - m[6] * m[9]) / d, (m[6] * m[8] - m[4] * m[10]) / d,
                      (m[4] * m[9] - m[5] * m[8]) / d),
                  row((m[2] * m[9] - m[1] * m[10]) / d, (m[0] * m[10] - m[2] * m[8]) / d,
                      (m[1] * m[8] - m[0] * m[9]) / d),
                  row((m[1] * m[6] - m[2] * m[5]) / d, (m[2] * m[4] - m[0] * m[6]) / d,
                      (m[0] * m[5] - m[1] * m[4]) / d)}};
  return view;
}

bool is_identity(const InstanceView& view) {
  float difference = max_abs_component(view.translation);
  for (int i = 0; i < 3; ++i) {
    difference += max_abs_component(view.linear.row[i] - identity3().row[i]);
  }
  return difference == 0.0f;
}

/// Triangles that a flat tree may hold more often than the meshes do: 40 MB, half a second's build.
constexpr size_t kMostCopies = 1 << 19;

}  // namespace

std::string transform_problem(const Matrix4& m) {
  for (const double x : m) {
    if (!std::isfinite(x)) return "its matrix has an entry that is not finite";
  }
  double scale = 0.0;
  for (int column = 0; column < 3; ++column) {
    scale = std::fmax(scale, std::sqrt(m[column] * m[column] + m[4 + column] * m[4 + column] +
                                       m[8 + column] * m[8 + column]));
  }
  // Flatter than this, the inverse that rays need is beyond float.
  if (!(std::fabs(determinant3(m)) > 1e-12 * scale * scale * scale) || !(scale > 1e-18)) {
    return "its matrix is singular (a scale of zero?)";
  }
  return "";
}

bool Scene::is_usable(const Instance& instance) const {
  return transform_problem(instance.matrix).empty() && !meshes_.at(instance.mesh)->empty();
}

bool Scene::commit(const std::atomic<bool>& cancel, bool trees) {
  std::unique_lock<std::timed_mutex> lock(commit_mutex_, std::defer_lock);
  while (!lock.try_lock_for(std::chrono::milliseconds(5))) {
    if (cancel) return false;
  }
  if (!tables_committed_) {
    if (tables_changed_) fill_tables();
    place_instances();
    measure_environment();
    tables_committed_ = true;
  }
  if (trees && !trees_committed_) trees_committed_ = build_trees(cancel);
  return !trees || trees_committed_;
}

/// Whether the instances of each mesh that has any go into one tree as triangles. Those whose
/// copies need least memory come first, until kMostCopies is reached.
std::map<int, bool> Scene::choose_flat() const {
  std::map<int, size_t> uses;
  for (const auto& [id, instance] : instances_) {
    if (is_usable(instance)) ++uses[instance.mesh];
  }
  std::vector<std::pair<size_t, int>> order;  // copied triangles, mesh
  for (const auto& [mesh, count] : uses) {
    order.push_back({(count - 1) * meshes_.at(mesh)->triangle_count(), mesh});
  }
  std::sort(order.begin(), order.end());
  std::map<int, bool> flat;
  size_t copies = 0;
  for (const auto& [more, mesh] : order) {
    copies += more;
    flat[mesh] = tree_kind_ == TreeKind::kFlat && copies <= kMostCopies;
  }
  return flat;
}

void Scene::make_geometry(bool flat, Instance* instance) const {
  const EmbreeApi& api = embree();
  const Mesh& mesh = *meshes_.at(instance->mesh);
  if (flat) {
    const InstanceView view = make_instance_view(instance->matrix);
    if (!is_identity(view)) instance->placed = mesh.placed(view);
    instance->geometry = mesh.new_geometry(instance->placed);
    return;
  }
  instance->geometry.reset(api.NewGeometry(api.device, RTC_GEOMETRY_TYPE_INSTANCE));
  api.SetGeometryInstancedScene(instance->geometry.get(), mesh.tree());
  float matrix[12];
  for (int i = 0; i < 12; ++i) matrix[i] = float(instance->matrix[i]);
  api.SetGeometryTransform(instance->geometry.get(), 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, matrix);
  api.CommitGeometry(instance->geometry.get());
}

bool Scene::build_trees(const std::atomic<bool>& cancel) {
  const EmbreeApi& api = embree();
  const std::map<int, bool> flat = choose_flat();
  for (const auto& [id, is_flat] : flat) {
    Mesh& mesh = *meshes_.at(id);
    if (is_flat || mesh.tree()) continue;
    if (!mesh.build(cancel)) return false;
    ++stats_.meshes_built;
  }

  for (auto& [id, instance] : instances_) {
    const bool usable = is_usable(instance);
    const bool is_flat = usable && flat.at(instance.mesh);
    if (!instance.changed && is_flat == instance.flat) continue;
    if (cancel) return false;
    top_level_changed_ = true;
    instance.geometry.reset();
    instance.placed = {};
    if (usable) make_geometry(is_flat, &instance);
    instance.usable = usable;
    instance.flat = is_flat;
    instance.changed = false;
  }
  if (top_level_changed_ || !top_level_) {
    // Attached anew each time: it costs microseconds an instance, and a half-built tree after a
    // cancelled commit never stays behind.
    top_level_changed_ = true;
    EmbreeScene top_level = new_embree_scene();
    unsigned index = 0;
    for (auto& [id, instance] : instances_) {
      if (instance.usable) api.AttachGeometryByID(top_level.get(), instance.geometry.get(), index);
      ++index;
    }
    check_embree("placing the instances");
    if (!commit_embree_scene(top_level.get(), cancel)) return false;
    top_level_ = std::move(top_level);
    top_level_changed_ = false;
    ++stats_.top_level_built;
  }
  return true;
}

void Scene::place_instances() {
  size_t row = 0;
  for (auto& [id, instance] : instances_) {
    InstanceView& view = instance_views_[row++];
    const InstanceView fresh = make_instance_view(instance.matrix);
    view.linear = fresh.linear;
    view.translation = fresh.translation;
    view.normal = fresh.normal;
  }
}

void Scene::fill_tables() {
  table_warnings_.clear();
  std::map<int, int> mesh_rows, material_rows, texture_rows, brdf_rows;
  mesh_views_.clear();
  for (const auto& [id, mesh] : meshes_) {
    mesh_rows[id] = int(mesh_views_.size());
    mesh_views_.push_back(mesh->view());
  }
  texture_views_.clear();
  for (const auto& [id, texture] : textures_) {
    texture_rows[id] = int(texture_views_.size());
    const TextureInput& in = texture.input;
    texture_views_.push_back({in.texels, in.width, in.height, in.channels, in.extension,
                              in.interpolation, in.u_row, in.v_row});
  }
  brdf_views_.clear();
  for (const auto& [id, brdf] : brdfs_) {
    brdf_rows[id] = int(brdf_views_.size());
    brdf_views_.push_back(brdf->view());
  }
  material_views_.clear();
  closures_.clear();
  has_emission_ = has_transparency_ = has_principled_ = false;
  for (const auto& [id, material] : materials_) {
    material_rows[id] = int(material_views_.size());
    material_views_.push_back({int32_t(closures_.size()), int32_t(material.closures.size())});
    for (Closure closure : material.closures) {
      for (int32_t* texture :
           {&closure.color_texture, &closure.roughness_texture, &closure.metallic_texture,
            &closure.normal_texture, &closure.emission_texture}) {
        if (*texture < 0) continue;
        const auto found = texture_rows.find(*texture);
        if (found == texture_rows.end()) {
          table_warnings_.push_back("material \"" + material.name + "\" uses texture " +
                                    std::to_string(*texture) +
                                    ", which the scene does not have; its plain value is used");
        }
        *texture = found == texture_rows.end() ? -1 : found->second;
      }
      if (closure.type == ClosureType::kTabulated) {
        const auto found = brdf_rows.find(closure.brdf);
        if (found == brdf_rows.end()) {
          table_warnings_.push_back("material \"" + material.name + "\" uses BRDF " +
                                    std::to_string(closure.brdf) +
                                    ", which the scene does not have; it is rendered black");
        }
        closure.brdf = found == brdf_rows.end() ? -1 : found->second;
      }
      has_transparency_ |= closure.type == ClosureType::kTransparent;
      has_principled_ |= closure.type == ClosureType::kPrincipled;
      has_emission_ |= max_component(closure.emission) > 0.0f;
      closures_.push_back(closure);
    }
  }
  instance_views_.clear();
  instance_materials_.clear();
  for (const auto& [id, instance] : instances_) {
    InstanceView view = {};
    view.mesh = mesh_rows.at(instance.mesh);
    view.first_material = int32_t(instance_materials_.size());
    view.slot_count = int32_t(instance.materials.size());
    instance_views_.push_back(view);
    for (const int material : instance.materials) {
      const auto found = material_rows.find(material);
      if (found == material_rows.end() && material >= 0) {
        table_warnings_.push_back("instance " + std::to_string(id) + " uses material " +
                                  std::to_string(material) +
                                  ", which the scene does not have; it is rendered black");
      }
      instance_materials_.push_back(found == material_rows.end() ? -1 : found->second);
    }
  }
  tables_changed_ = false;
}

/// A map without texels is constant 1.
static LatLongImage image_of(const EnvironmentInput& environment) {
  static const float kWhite[3] = {1, 1, 1};
  if (!environment.texels) return {kWhite, 1, 1};
  return {environment.texels.get(), environment.width, environment.height};
}

void Scene::measure_environment() {
  if (moments_known_ && moments_of_ == environment_.texels) return;
  moments_ = diffuse_moments(image_of(environment_));
  if (!is_finite(moments_)) moments_ = {};
  moments_of_ = environment_.texels;
  moments_known_ = true;
}

SceneView Scene::view(int width, int height) const {
  if (!has_camera_) throw std::runtime_error("the scene has no camera; call set_camera first");
  static const float kNoAlbedo[kAlbedoTableSize * kAlbedoTableSize * kAlbedoTableSize] = {};
  SceneView view = {};
  view.meshes = mesh_views_.data();
  view.instances = instance_views_.data();
  view.instance_materials = instance_materials_.data();
  view.materials = material_views_.data();
  view.tables = {closures_.data(), texture_views_.data(),
                 has_principled_ ? dielectric_albedo_table() : kNoAlbedo, brdf_views_.data()};
  view.environment.image = image_of(environment_);
  if (environment_.sampler) view.environment.sampler = environment_.sampler->view();
  view.environment.world_to_env = environment_.world_to_env;
  view.environment.color = environment_.color;
  view.environment.visible = environment_.visible;
  view.environment.moments = moments_;
  view.camera = camera_;
  view.camera.width = float(width);
  view.camera.height = float(height);
  view.has_emission = has_emission_;
  view.has_transparency = has_transparency_;
  return view;
}

}  // namespace skytree
