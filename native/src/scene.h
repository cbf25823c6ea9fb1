// SPDX-License-Identifier: GPL-3.0-or-later
// A scene that is changed piece by piece; only what changed is built again.
#pragma once

#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "kernel/scene_view.h"
#include "src/camera_setup.h"
#include "src/mesh.h"
#include "src/scene_parts.h"

namespace skytree {

class BrdfKdTree;
class EnvironmentSampler;

struct TextureInput {
  const float* texels = nullptr;  // (H,W,channels) linear, row 0 at the top
  int width = 0, height = 0, channels = 3;
  TextureInterpolation interpolation = TextureInterpolation::kLinear;
  TextureExtension extension = TextureExtension::kRepeat;
  Vec3 u_row = {1, 0, 0}, v_row = {0, 1, 0};  // affine transform of the surface's (u,v,1)
};

struct EnvironmentInput {
  std::shared_ptr<const float>
      texels;  // (H,W,3) radiance; null: constant 1, so that `color` alone counts
  int width = 0, height = 0;
  std::shared_ptr<const EnvironmentSampler> sampler;  // null: uniform over the sphere
  Mat3 world_to_env = identity3();                    // rotation
  Vec3 color = {1, 1, 1};
  bool visible = true;
};

/// Why an instance with this matrix cannot be rendered; empty if it can.
std::string transform_problem(const Matrix4& object_to_world);

/// How often things were built, for tests and status lines.
struct SceneStats {
  size_t meshes_built = 0, top_level_built = 0, environments_set = 0;
  size_t triangles = 0, instances = 0, nbytes = 0;
};

/// How the ray-tracing trees hold the objects of a scene.
enum class TreeKind {
  kInstanced,  // a tree for each mesh, and one over their instances: what moves costs little
  kFlat,       // one tree over all triangles, where copies stay few: rays cost less
};

/// Every setter throws std::runtime_error while a session renders the scene, std::invalid_argument
/// for an unknown id. Geometry that cannot be rendered does not throw: it is left out and named in
/// warnings().
class Scene {
 public:
  /// The kind changes costs alone, and how hits are rounded.
  explicit Scene(TreeKind kind = TreeKind::kInstanced) : tree_kind_(kind) {}

  int add_mesh(const MeshInput& input);
  void set_mesh(int mesh, const MeshInput& input);
  void remove_mesh(int mesh);

  int add_instance(int mesh, const Matrix4& object_to_world, std::vector<int> materials);
  void set_transform(int instance, const Matrix4& object_to_world);
  void set_instance_materials(int instance, std::vector<int> materials);
  void remove_instance(int instance);

  int add_material(std::vector<Closure> closures, std::string name);
  void set_material(int material, std::vector<Closure> closures);
  void remove_material(int material);

  int add_texture(const TextureInput& input);
  void remove_texture(int texture);

  /// For closures of type kTabulated, whose `brdf` is the number that this returns.
  int add_brdf(std::shared_ptr<const BrdfKdTree> brdf);
  void remove_brdf(int brdf);

  void set_camera(const Matrix4& camera_to_world, const Matrix4& projection);
  void set_environment(EnvironmentInput input);

  /// Null: uniform over the sphere.
  const EnvironmentSampler* sampler() const { return environment_.sampler.get(); }
  std::vector<std::string> warnings() const;
  SceneStats stats() const;

  /// Builds what changed and fills the tables behind view(); false when cancelled. For a session's
  /// thread, between begin_use and end_use; of several sessions the first one builds. Without
  /// `trees`, for a device that has its own, only the tables.
  bool commit(const std::atomic<bool>& cancel, bool trees = true);
  /// Valid until the next change. `width` and `height` of the film, pixels.
  SceneView view(int width, int height) const;
  /// The same with sizes and identities, for a device that mirrors the scene.
  SceneParts parts(int width, int height) const;
  RTCScene tree() const { return top_level_.get(); }

  /// Until as many end_use() have come, every change throws.
  void begin_use();
  void end_use() { --users_; }

 private:
  struct Instance {
    int mesh;
    Matrix4 matrix;
    std::vector<int> materials;
    bool changed = true;
    bool usable = false;
    bool flat = false;          // geometry holds triangles in world space
    std::vector<float> placed;  // their vertices; empty where they are the mesh's own
    EmbreeGeometry geometry;
  };
  struct Material {
    std::vector<Closure> closures;
    std::string name;
  };
  struct Texture {
    TextureInput input;
    std::vector<float> texels;
    uint64_t serial = next_serial();
  };

  void require_idle() const;
  bool is_usable(const Instance& instance) const;
  void measure_environment();
  bool build_trees(const std::atomic<bool>& cancel);
  std::map<int, bool> choose_flat() const;
  void make_geometry(bool flat, Instance* instance) const;
  void fill_tables();
  void place_instances();

  const TreeKind tree_kind_;
  std::map<int, std::unique_ptr<Mesh>> meshes_;
  std::map<int, Instance> instances_;
  std::map<int, Material> materials_;
  std::map<int, Texture> textures_;
  std::map<int, std::shared_ptr<const BrdfKdTree>> brdfs_;
  int next_mesh_ = 0, next_instance_ = 0, next_material_ = 0, next_texture_ = 0, next_brdf_ = 0;
  bool has_camera_ = false;
  CameraView camera_ = {};
  EnvironmentInput environment_;
  std::string environment_warning_;
  DiffuseMoments moments_ = {};  // of what moments_of_ holds
  std::shared_ptr<const float> moments_of_;
  bool moments_known_ = false;
  std::vector<std::string> table_warnings_;

  EmbreeScene top_level_;
  bool top_level_changed_ = true, tables_changed_ = true;
  std::vector<MeshView> mesh_views_;
  std::vector<InstanceView> instance_views_;
  std::vector<int32_t> instance_materials_;
  std::vector<MaterialView> material_views_;
  std::vector<Closure> closures_;
  std::vector<TextureView> texture_views_;
  std::vector<TabulatedBrdfView> brdf_views_;
  bool has_emission_ = false, has_transparency_ = false, has_principled_ = false;

  SceneStats stats_;
  std::atomic<int> users_{0};
  std::timed_mutex commit_mutex_;
  bool tables_committed_ = false, trees_committed_ = false;  // since the first of the present users
};

}  // namespace skytree
