// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/scene_parts.h"

#include <atomic>

#include "src/scene.h"

namespace skytree {

uint64_t next_serial() {
  static std::atomic<uint64_t> last{0};
  return ++last;
}

SceneParts Scene::parts(int width, int height) const {
  SceneParts parts = {};
  parts.view = view(width, height);
  for (const auto& [id, mesh] : meshes_) {
    parts.meshes.push_back({mesh->serial(), mesh->view(), mesh->vertex_count(),
                            mesh->triangle_count(), mesh->corner_count()});
  }
  size_t row = 0;
  for (const auto& [id, texture] : textures_) {
    parts.textures.push_back({texture.serial, texture_views_[row++]});
  }
  for (const auto& [id, brdf] : brdfs_) parts.brdfs.push_back(brdf);
  for (const auto& [id, instance] : instances_) {
    parts.instance_usable.push_back(is_usable(instance));
  }
  parts.instances = &instance_views_;
  parts.instance_materials = &instance_materials_;
  parts.materials = &material_views_;
  parts.closures = &closures_;
  parts.environment_texels = environment_.texels;
  parts.sampler = environment_.sampler;
  return parts;
}

}  // namespace skytree
