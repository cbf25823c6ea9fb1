// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/device_scene.h"

#include <algorithm>
#include <cstring>
#include <set>

#include "src/brdf_kdtree.h"
#include "src/environment_sampler.h"

namespace skytree::cuda {
namespace {

template <class T>
const T* add_array(const ContextPointer& context, const T* host, size_t count,
                   std::vector<Buffer>* arrays) {
  if (!host || count == 0) return nullptr;
  arrays->emplace_back(context, host, count * sizeof(T));
  return arrays->back().as<T>();
}

/// Null when cancelled.
std::unique_ptr<DeviceMesh> make_mesh(const ContextPointer& context, const MeshPart& part,
                                      const std::atomic<bool>& cancel) {
  auto mesh = std::make_unique<DeviceMesh>();
  const Vec3 infinity = {INFINITY, INFINITY, INFINITY};
  mesh->serial = part.serial;
  mesh->view = part.view;
  mesh->bounds = {infinity, -infinity};
  if (part.triangle_count > 0) {
    MeshBvh tree;
    if (!build_mesh_bvh(part.view.positions, part.view.triangles, part.triangle_count, cancel,
                        &tree)) {
      return nullptr;
    }
    mesh->bounds = tree.bounds;
    mesh->bvh.nodes = add_array(context, tree.nodes.data(), tree.nodes.size(), &mesh->arrays);
    mesh->bvh.triangles =
        add_array(context, tree.triangles.data(), tree.triangles.size(), &mesh->arrays);
  }
  MeshView& view = mesh->view;
  auto send = [&](auto& pointer, size_t count) {
    pointer = add_array(context, pointer, count, &mesh->arrays);
  };
  send(view.positions, 3 * part.vertex_count);
  send(view.triangles, 3 * part.triangle_count);
  send(view.corners, 3 * part.triangle_count);
  send(view.corner_normals, 3 * part.corner_count);
  send(view.corner_uvs, 2 * part.corner_count);
  send(view.corner_tangents, 3 * part.corner_count);
  send(view.material_slots, part.triangle_count);
  return mesh;
}

bool same(const std::vector<Bounds>& a, const std::vector<Bounds>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Bounds)) == 0);
}

}  // namespace

bool Mirror::set(const ContextPointer& context, const void* data, size_t bytes) {
  if (bytes == copy_.size() && (bytes == 0 || std::memcmp(data, copy_.data(), bytes) == 0))
    return false;
  copy_.clear();  // first: if sending fails, nothing may be taken for sent
  if (buffer_.bytes() != bytes) {
    buffer_ = Buffer();
    buffer_ = Buffer(context, bytes);
  }
  buffer_.upload(data, bytes);
  const char* begin = static_cast<const char*>(data);
  copy_.assign(begin, begin + bytes);
  return true;
}

bool DeviceScene::update(const SceneParts& parts,
                         const std::shared_ptr<const EnvironmentSampler>& sampler, bool products,
                         const float* filter_table, const std::atomic<bool>& cancel) {
  view_ = parts.view;
  if (!update_meshes(parts, cancel) || !update_instances(parts, cancel) ||
      !update_textures(parts, cancel) || !update_brdfs(parts, cancel) ||
      !update_environment(parts, sampler, products, cancel)) {
    return false;
  }
  instance_materials_.set(context_, *parts.instance_materials);
  materials_.set(context_, *parts.materials);
  closures_.set(context_, *parts.closures);
  albedo_.set(context_, parts.view.tables.dielectric_albedo,
              sizeof(float) * kAlbedoTableSize * kAlbedoTableSize * kAlbedoTableSize);
  filter_table_.set(context_, filter_table, sizeof(float) * kFilterTableSize);
  view_.meshes = mesh_views_.as<MeshView>();
  view_.instances = instances_.as<InstanceView>();
  view_.instance_materials = instance_materials_.as<int32_t>();
  view_.materials = materials_.as<MaterialView>();
  view_.tables = {closures_.as<Closure>(), texture_views_.as<TextureView>(), albedo_.as<float>(),
                  brdf_views_.as<TabulatedBrdfView>()};
  return true;
}

bool DeviceScene::update_meshes(const SceneParts& parts, const std::atomic<bool>& cancel) {
  // What is no longer wanted goes first: the new may need its room.
  std::set<uint64_t> wanted;
  for (const MeshPart& part : parts.meshes) wanted.insert(part.serial);
  meshes_.erase(std::remove_if(meshes_.begin(), meshes_.end(),
                               [&](const auto& mesh) { return wanted.count(mesh->serial) == 0; }),
                meshes_.end());
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;
  std::vector<MeshView> views;
  std::vector<MeshBvhView> trees;
  for (const MeshPart& part : parts.meshes) {
    if (cancel) return false;
    meshes.push_back(context_->share<DeviceMesh>(
        part.serial, cancel, [&] { return make_mesh(context_, part, cancel); }));
    if (!meshes.back()) return false;
    views.push_back(meshes.back()->view);
    trees.push_back(meshes.back()->bvh);
  }
  meshes_ = std::move(meshes);
  mesh_views_.set(context_, views);
  mesh_trees_.set(context_, trees);
  return true;
}

bool DeviceScene::update_instances(const SceneParts& parts, const std::atomic<bool>& cancel) {
  const bool moved = instances_.set(context_, *parts.instances);
  // Bounds of the mesh of each instance; an unusable instance has none and stays out of the tree.
  std::vector<Bounds> bounds;
  const Vec3 infinity = {INFINITY, INFINITY, INFINITY};
  for (size_t i = 0; i < parts.instances->size(); ++i) {
    const bool usable = parts.instance_usable[i];
    bounds.push_back(usable ? meshes_[(*parts.instances)[i].mesh]->bounds
                            : Bounds{infinity, -infinity});
  }
  if (!moved && same(bounds, top_bounds_)) {
    tracer_.meshes = mesh_trees_.as<MeshBvhView>();
    return true;
  }
  TopBvh tree;
  top_bounds_.clear();
  if (!build_top_bvh(*parts.instances, bounds, cancel, &tree)) {
    top_bounds_.push_back({});  // whatever comes next is a change
    return false;
  }
  top_nodes_.set(context_, tree.nodes);
  top_instances_.set(context_, tree.instances);
  top_bounds_ = std::move(bounds);
  tracer_ = {top_nodes_.as<BvhNode>(), top_instances_.as<int32_t>(), mesh_trees_.as<MeshBvhView>()};
  return true;
}

bool DeviceScene::update_textures(const SceneParts& parts, const std::atomic<bool>& cancel) {
  std::vector<std::shared_ptr<const DeviceTexels>> textures;
  std::vector<TextureView> views;
  for (const TexturePart& part : parts.textures) {
    const size_t bytes =
        sizeof(float) * size_t(part.view.width) * part.view.height * part.view.channels;
    textures.push_back(context_->share<DeviceTexels>(part.serial, cancel, [&] {
      auto texels = std::make_unique<DeviceTexels>();
      texels->texels = Buffer(context_, part.view.texels, bytes);
      return texels;
    }));
    if (!textures.back()) return false;
    views.push_back(part.view);
    views.back().texels = textures.back()->texels.as<float>();
  }
  textures_ = std::move(textures);
  texture_views_.set(context_, views);
  return true;
}

bool DeviceScene::update_brdfs(const SceneParts& parts, const std::atomic<bool>& cancel) {
  std::vector<std::shared_ptr<const DeviceBrdf>> brdfs;
  std::vector<TabulatedBrdfView> views;
  for (const std::shared_ptr<const BrdfKdTree>& source : parts.brdfs) {
    const auto key = reinterpret_cast<uintptr_t>(source.get());
    brdfs.push_back(context_->share<DeviceBrdf>(key, cancel, [&] {
      auto brdf = std::make_unique<DeviceBrdf>();
      brdf->source = source;
      TabulatedBrdfView& view = brdf->view = source->view();
      const NdKdTree& tree = source->tree();
      auto send = [&](auto& pointer, size_t count) {
        pointer = add_array(context_, pointer, count, &brdf->arrays);
      };
      send(view.table.values, source->table().nbytes() / sizeof(float));
      send(view.tree.nodes, tree.node_count());
      send(view.tree.slices, size_t(tree.slice_count()));
      send(view.tree.bounds, tree.bounds_count());
      return brdf;
    }));
    if (!brdfs.back()) return false;
    views.push_back(brdfs.back()->view);
  }
  brdfs_ = std::move(brdfs);
  brdf_views_.set(context_, views);
  return true;
}

bool DeviceScene::update_environment(const SceneParts& parts,
                                     const std::shared_ptr<const EnvironmentSampler>& sampler,
                                     bool products, const std::atomic<bool>& cancel) {
  LatLongImage& image = view_.environment.image;
  if (parts.environment_texels) {
    const auto key = reinterpret_cast<uintptr_t>(parts.environment_texels.get());
    if (!image_ || image_->source != parts.environment_texels)
      image_.reset();  // before the new one needs room
    image_ = context_->share<DeviceTexels>(key, cancel, [&] {
      auto texels = std::make_unique<DeviceTexels>();
      texels->texels =
          Buffer(context_, image.texels, sizeof(float) * 3 * size_t(image.width) * image.height);
      texels->source = parts.environment_texels;
      return texels;
    });
    if (!image_) return false;
    image.texels = image_->texels.as<float>();
  } else {
    image_.reset();
    white_.set(context_, image.texels, sizeof(float) * 3);
    image.texels = white_.as<float>();
  }
  if (!sampler) {
    sampler_.reset();
    view_.environment.sampler = EnvSamplerView();
    return true;
  }
  if (!sampler_ || sampler_->source != sampler || sampler_->products != products) {
    sampler_.reset();
  }
  // Addresses are even.
  const auto key = reinterpret_cast<uintptr_t>(sampler.get()) + products;
  sampler_ = context_->share<SharedSampler>(key, cancel, [&] {
    auto shared = std::make_unique<SharedSampler>();
    shared->tables = DeviceSampler(context_, products ? sampler->product_view() : sampler->view());
    shared->source = sampler;
    shared->products = products;
    return shared;
  });
  if (!sampler_) return false;
  view_.environment.sampler = sampler_->tables.view();
  return true;
}

}  // namespace skytree::cuda
