// SPDX-License-Identifier: GPL-3.0-or-later
// A committed scene with the sizes of its arrays and the identity of its parts: what a device needs
// that keeps copies and sends only what changed.
#pragma once

#include <memory>
#include <vector>

#include "kernel/scene_view.h"

namespace skytree {

class BrdfKdTree;
class EnvironmentSampler;

/// A number that no other object of this process has had; equal numbers mean equal contents.
uint64_t next_serial();

struct MeshPart {
  uint64_t serial;
  MeshView view;
  size_t vertex_count, triangle_count, corner_count;
};

struct TexturePart {
  uint64_t serial;
  TextureView view;
};

/// Borrowed from a Scene; valid until its next change.
struct SceneParts {
  SceneView view;
  std::vector<MeshPart> meshes;
  std::vector<TexturePart> textures;
  std::vector<std::shared_ptr<const BrdfKdTree>> brdfs;
  const std::vector<InstanceView>* instances;
  std::vector<bool> instance_usable;  // false: its matrix or mesh cannot be rendered
  const std::vector<int32_t>* instance_materials;
  const std::vector<MaterialView>* materials;
  const std::vector<Closure>* closures;
  std::shared_ptr<const float> environment_texels;    // null: view.environment.image is one texel
  std::shared_ptr<const EnvironmentSampler> sampler;  // null: uniform
};

}  // namespace skytree
