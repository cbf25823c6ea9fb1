// SPDX-License-Identifier: GPL-3.0-or-later
// The changes a scene takes, and their checks; scene_commit.cpp builds from them.
#include "src/scene.h"

#include <cfloat>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "src/brdf_kdtree.h"
#include "src/camera_setup.h"
#include "src/environment_image.h"

namespace skytree {
namespace {

template <class Map>
auto& find(Map& map, int id, const char* what) {
  const auto found = map.find(id);
  if (found == map.end()) {
    throw std::invalid_argument(std::string("the scene has no ") + what + " " + std::to_string(id));
  }
  return found->second;
}

int lobe_count(const std::vector<Closure>& closures) {
  int count = 0;
  for (const Closure& closure : closures) {
    if (closure.type == ClosureType::kPrincipled) {
      count += 3;
    } else if (closure.type != ClosureType::kEmission &&
               closure.type != ClosureType::kTransparent) {
      count += 1;
    }
  }
  return count;
}

void check_closures(const std::vector<Closure>& closures, const std::string& name) {
  if (lobe_count(closures) > kMaxLobes) {
    throw std::invalid_argument("material \"" + name + "\" mixes more than " +
                                std::to_string(kMaxLobes) +
                                " lobes; a Principled counts three. Simplify the node tree");
  }
}

}  // namespace

void Scene::require_idle() const {
  if (users_.load() != 0) {
    throw std::runtime_error(
        "the scene is being rendered and may not be changed; cancel the session first");
  }
}

void Scene::begin_use() {
  // Without a lock, which a session that builds may hold for long: nobody builds while there are no
  // users.
  if (users_++ == 0) tables_committed_ = trees_committed_ = false;
}

int Scene::add_mesh(const MeshInput& input) {
  require_idle();
  meshes_[next_mesh_] = std::make_unique<Mesh>(input);
  tables_changed_ = true;
  return next_mesh_++;
}

void Scene::set_mesh(int mesh, const MeshInput& input) {
  require_idle();
  find(meshes_, mesh, "mesh") = std::make_unique<Mesh>(input);
  tables_changed_ = true;
  for (auto& [id, instance] : instances_) instance.changed |= instance.mesh == mesh;
}

void Scene::remove_mesh(int mesh) {
  require_idle();
  find(meshes_, mesh, "mesh");
  for (const auto& [id, instance] : instances_) {
    if (instance.mesh == mesh) {
      throw std::invalid_argument("mesh " + std::to_string(mesh) + " is still used by instance " +
                                  std::to_string(id) + "; remove the instance first");
    }
  }
  meshes_.erase(mesh);
  tables_changed_ = true;
}

int Scene::add_instance(int mesh, const Matrix4& object_to_world, std::vector<int> materials) {
  require_idle();
  find(meshes_, mesh, "mesh");
  Instance& instance = instances_[next_instance_];
  instance.mesh = mesh;
  instance.matrix = object_to_world;
  instance.materials = std::move(materials);
  tables_changed_ = true;
  return next_instance_++;
}

void Scene::set_transform(int instance, const Matrix4& object_to_world) {
  require_idle();
  Instance& changed = find(instances_, instance, "instance");
  changed.matrix = object_to_world;
  changed.changed = true;
}

void Scene::set_instance_materials(int instance, std::vector<int> materials) {
  require_idle();
  find(instances_, instance, "instance").materials = std::move(materials);
  tables_changed_ = true;
}

void Scene::remove_instance(int instance) {
  require_idle();
  find(instances_, instance, "instance");
  instances_.erase(instance);
  tables_changed_ = true;
  top_level_changed_ = true;
}

int Scene::add_material(std::vector<Closure> closures, std::string name) {
  require_idle();
  check_closures(closures, name);
  materials_[next_material_] = {std::move(closures), std::move(name)};
  tables_changed_ = true;
  return next_material_++;
}

void Scene::set_material(int material, std::vector<Closure> closures) {
  require_idle();
  Material& changed = find(materials_, material, "material");
  check_closures(closures, changed.name);
  changed.closures = std::move(closures);
  tables_changed_ = true;
}

void Scene::remove_material(int material) {
  require_idle();
  find(materials_, material, "material");
  materials_.erase(material);
  tables_changed_ = true;
}

int Scene::add_texture(const TextureInput& input) {
  require_idle();
  if (input.width < 1 || input.height < 1 || (input.channels != 3 && input.channels != 4)) {
    throw std::invalid_argument(
        "texture: an array (H,W,3) or (H,W,4) with at least one texel is needed");
  }
  Texture& texture = textures_[next_texture_];
  texture.input = input;
  texture.texels.assign(input.texels,
                        input.texels + size_t(input.width) * input.height * input.channels);
  for (float& x : texture.texels) x = std::isfinite(x) ? x : 0.0f;
  texture.input.texels = texture.texels.data();
  tables_changed_ = true;
  return next_texture_++;
}

void Scene::remove_texture(int texture) {
  require_idle();
  find(textures_, texture, "texture");
  textures_.erase(texture);
  tables_changed_ = true;
}

int Scene::add_brdf(std::shared_ptr<const BrdfKdTree> brdf) {
  require_idle();
  if (!brdf) throw std::invalid_argument("add_brdf: a tabulated BRDF is needed");
  brdfs_[next_brdf_] = std::move(brdf);
  tables_changed_ = true;
  return next_brdf_++;
}

void Scene::remove_brdf(int brdf) {
  require_idle();
  find(brdfs_, brdf, "brdf");
  brdfs_.erase(brdf);
  tables_changed_ = true;
}

void Scene::set_camera(const Matrix4& camera_to_world, const Matrix4& projection) {
  require_idle();
  camera_ = make_camera(camera_to_world, projection);
  has_camera_ = true;
}

void Scene::set_environment(EnvironmentInput input) {
  require_idle();
  if (input.texels && (input.width < 1 || input.height < 1)) {
    throw std::invalid_argument("environment: the image has no texels");
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      const float product = dot(input.world_to_env.row[i], input.world_to_env.row[j]);
      if (!(std::fabs(product - (i == j ? 1.0f : 0.0f)) < 1e-3f)) {
        throw std::invalid_argument(
            "environment: world_to_env is not a rotation; leave out scale and shear");
      }
    }
  }
  const Vec3 c = input.color;
  if (!std::isfinite(c.x + c.y + c.z) || c.x < 0 || c.y < 0 || c.z < 0) {
    throw std::invalid_argument("environment: color must be finite and not negative");
  }
  environment_warning_.clear();
  if (input.texels && input.texels != environment_.texels) {
    const size_t count = size_t(input.width) * input.height * 3;
    const float* texels = input.texels.get();
    size_t bad = 0;
    for (size_t i = 0; i < count; ++i) bad += !(texels[i] >= 0.0f && texels[i] <= FLT_MAX);
    if (bad) {
      std::shared_ptr<float> clean(new float[count], std::default_delete<float[]>());
      for (size_t i = 0; i < count; ++i) {
        clean.get()[i] = usable_radiance(texels[i]);
      }
      input.texels = std::move(clean);
      environment_warning_ = "environment: " + std::to_string(bad) +
                             " values are negative, infinite or not a number; they are taken as 0";
    }
  }
  environment_ = std::move(input);
  ++stats_.environments_set;
}

std::vector<std::string> Scene::warnings() const {
  std::vector<std::string> all;
  for (const auto& [id, mesh] : meshes_) {
    if (!mesh->warning().empty()) all.push_back(mesh->warning());
  }
  for (const auto& [id, instance] : instances_) {
    std::string problem = transform_problem(instance.matrix);
    if (!problem.empty()) {
      all.push_back("instance " + std::to_string(id) + " of mesh \"" +
                    meshes_.at(instance.mesh)->name() + "\" is left out: " + problem);
    }
  }
  if (!environment_warning_.empty()) all.push_back(environment_warning_);
  all.insert(all.end(), table_warnings_.begin(), table_warnings_.end());
  return all;
}

SceneStats Scene::stats() const {
  SceneStats stats = stats_;
  for (const auto& [id, mesh] : meshes_) {
    stats.nbytes += mesh->nbytes();
    stats.triangles += mesh->triangle_count();
  }
  for (const auto& [id, texture] : textures_) stats.nbytes += sizeof(float) * texture.texels.size();
  for (const auto& [id, brdf] : brdfs_)
    stats.nbytes += brdf->table().nbytes() + brdf->tree().nbytes();
  for (const auto& [id, instance] : instances_) {
    stats.nbytes += sizeof(float) * instance.placed.size();
  }
  stats.instances = instances_.size();
  return stats;
}

}  // namespace skytree
