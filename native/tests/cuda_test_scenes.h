// SPDX-License-Identifier: GPL-3.0-or-later
// Scenes for the CUDA tests: together they use every material, texture mode and kind of instance.
#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "src/brdf_kdtree.h"
#include "src/environment_sampler.h"
#include "src/scene.h"

namespace skytree::cuda {

struct MeshData {
  std::vector<float> positions, normals, uvs;
  std::vector<int32_t> triangles;

  MeshInput input(bool smooth) const {
    MeshInput in;
    in.positions = positions.data();
    in.vertex_count = positions.size() / 3;
    in.triangles = triangles.data();
    in.triangle_count = triangles.size() / 3;
    in.corners = triangles.data();
    in.corner_count = in.vertex_count;
    in.corner_normals = smooth ? normals.data() : nullptr;
    in.corner_uvs = uvs.data();
    return in;
  }
};

/// Unit sphere of 2 * rows * columns triangles; `bump` makes it a potato.
inline MeshData make_sphere(int rows, int columns, float bump = 0.0f) {
  MeshData mesh;
  for (int y = 0; y <= rows; ++y) {
    for (int x = 0; x <= columns; ++x) {
      const double theta = M_PI * (y + 0.02) / (rows + 0.04), phi = 2 * M_PI * x / columns;
      const double n[3] = {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                           std::cos(theta)};
      const double r = 1 + bump * std::sin(7 * n[0]) * std::cos(5 * n[1] + 3 * n[2]);
      for (const double k : n) {
        mesh.positions.push_back(float(r * k));
        mesh.normals.push_back(float(k));
      }
      mesh.uvs.push_back(float(x) / float(columns) * 2.0f);
      mesh.uvs.push_back(1.0f - float(y) / float(rows));
    }
  }
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const int a = y * (columns + 1) + x, b = a + columns + 1;
      for (const int i : {a, b, b + 1, a, b + 1, a + 1}) mesh.triangles.push_back(i);
    }
  }
  return mesh;
}

inline MeshData make_plane(float size) {
  return {{-size, -size, 0, size, -size, 0, size, size, 0, -size, size, 0},
          {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1},
          {0, 0, 1, 0, 1, 1, 0, 1},
          {0, 1, 2, 0, 2, 3}};
}

inline Matrix4 place(double x, double y, double z, double sx, double sy, double sz,
                     double shear = 0) {
  return {sx, shear, 0, x, 0, sy, 0, y, 0, 0, sz, z, 0, 0, 0, 1};
}

/// Looks along +y from (0, -distance, height), slightly down.
inline void set_test_camera(Scene* scene, double distance, double height) {
  const double tilt = std::atan2(height - 0.8, distance), c = std::cos(tilt), s = std::sin(tilt);
  // Columns: right, up, backward, position.
  const Matrix4 camera = {1, 0, 0, 0, 0, s, -c, -distance, 0, c, s, height, 0, 0, 0, 1};
  const double near = 0.1, far = 1000;
  const Matrix4 projection = {2.0,
                              0,
                              0,
                              0,
                              0,
                              3.0,
                              0,
                              0,
                              0,
                              0,
                              -(far + near) / (far - near),
                              -2 * far * near / (far - near),
                              0,
                              0,
                              -1,
                              0};
  scene->set_camera(camera, projection);
}

/// A sky with a sun, and its texels kept alive.
inline EnvironmentInput make_sky(int width, int height,
                                 std::shared_ptr<const EnvironmentSampler> sampler) {
  std::shared_ptr<float> texels(new float[size_t(3) * width * height],
                                std::default_delete<float[]>());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      float* t = texels.get() + 3 * (size_t(y) * width + x);
      const float v = float(y) / float(height);
      const bool sun = std::abs(x - width / 3) < 2 && std::abs(y - height / 4) < 2;
      t[0] = 0.3f + (sun ? 400.0f : 0.0f) + 0.1f * float((x * 7 + y * 3) % 5);
      t[1] = 0.4f + (sun ? 380.0f : 0.0f);
      t[2] = 0.9f - 0.6f * v + (sun ? 300.0f : 0.0f);
    }
  }
  EnvironmentInput input;
  input.texels = texels;
  input.width = width;
  input.height = height;
  input.sampler = std::move(sampler);
  const float a = std::cos(0.7f), b = std::sin(0.7f);
  input.world_to_env = {{{a, b, 0}, {-b, a, 0}, {0, 0, 1}}};
  input.color = {1.0f, 0.95f, 0.9f};
  return input;
}

inline Closure closure(ClosureType type, Vec3 color, float roughness = 0.0f) {
  Closure c;
  c.type = type;
  c.color = color;
  c.roughness = roughness;
  return c;
}

/// Spheres of every material over a ground, mirrored and sheared instances, textures in all modes.
inline std::shared_ptr<Scene> material_scene(EnvironmentInput sky) {
  auto scene = std::make_shared<Scene>();
  const MeshData ball = make_sphere(24, 48), potato = make_sphere(20, 40, 0.2f),
                 plane = make_plane(30);
  const int smooth = scene->add_mesh(ball.input(true));
  const int flat = scene->add_mesh(potato.input(false));
  const int ground = scene->add_mesh(plane.input(false));

  std::vector<float> checker;
  for (int i = 0; i < 8 * 8; ++i) {
    const float value = (i % 8 + i / 8) % 2 ? 0.9f : 0.2f;
    for (const float channel : {value, 0.6f, 1.0f - value}) checker.push_back(channel);
  }
  std::vector<int> textures;
  for (const auto extension : {TextureExtension::kRepeat, TextureExtension::kExtend,
                               TextureExtension::kClip, TextureExtension::kMirror}) {
    TextureInput input;
    input.texels = checker.data();
    input.width = input.height = 8;
    input.extension = extension;
    input.interpolation = extension == TextureExtension::kMirror ? TextureInterpolation::kClosest
                                                                 : TextureInterpolation::kLinear;
    textures.push_back(scene->add_texture(input));
  }

  std::vector<Closure> materials(9);
  materials[0] = closure(ClosureType::kDiffuse, {0.7f, 0.6f, 0.5f});
  materials[1] = closure(ClosureType::kGlossy, {0.9f, 0.8f, 0.6f}, 0.2f);
  materials[2] = closure(ClosureType::kGlossy, {0.9f, 0.9f, 0.9f}, 0.4f);
  materials[2].anisotropy = 0.7f;
  materials[2].rotation = 0.15f;
  materials[3] = closure(ClosureType::kWard, {0.8f, 0.8f, 0.8f});
  materials[3].alpha_x = 0.4f;
  materials[3].alpha_y = 0.02f;
  materials[4] = closure(ClosureType::kPrincipled, {0.2f, 0.5f, 0.8f}, 0.3f);
  materials[5] = closure(ClosureType::kPrincipled, {1.0f, 0.8f, 0.3f}, 0.15f);
  materials[5].metallic = 1.0f;
  static const auto table = std::make_shared<BrdfKdTree>(make_ward_table(0.4f, 0.1f));
  materials[6] = closure(ClosureType::kTabulated, {0.9f, 0.9f, 0.9f});
  materials[6].brdf = scene->add_brdf(table);
  materials[7] = closure(ClosureType::kPrincipled, {0.9f, 0.9f, 0.9f}, 0.8f);
  materials[7].roughness_texture = textures[3];
  materials[7].metallic_texture = textures[2];
  materials[7].metallic = 0.5f;
  std::vector<int> ids;
  for (size_t i = 0; i < 8; ++i) {
    materials[i].color_texture = i >= 4 ? textures[i % 4] : -1;
    ids.push_back(scene->add_material({materials[i]}, "material " + std::to_string(i)));
  }
  Closure lamp = closure(ClosureType::kEmission, {0, 0, 0});
  lamp.emission = {6, 4, 2};
  ids.push_back(scene->add_material({lamp}, "lamp"));
  Closure half = closure(ClosureType::kDiffuse, {0.2f, 0.8f, 0.3f});
  half.weight = 0.5f;
  Closure veil = closure(ClosureType::kTransparent, {1, 1, 1});
  veil.weight = 0.5f;
  ids.push_back(scene->add_material({half, veil}, "veil"));

  scene->add_instance(ground, place(0, 0, 0, 1, 1, 1), {ids[0]});
  for (int i = 0; i < 10; ++i) {
    const double x = -3.6 + 1.8 * (i % 5), y = i < 5 ? 0.0 : 2.4;
    const double mirror = i % 3 == 2 ? -0.8 : 0.8;
    scene->add_instance(i % 2 ? flat : smooth,
                        place(x, y, 0.9, mirror, 0.8, 0.8, i == 4 ? 0.3 : 0.0), {ids[size_t(i)]});
  }
  scene->add_instance(smooth, place(0, 0, 1, 0, 1, 1), {ids[0]});  // singular: left out
  set_test_camera(scene.get(), 11, 3.2);
  scene->set_environment(std::move(sky));
  return scene;
}

/// Many small instances and one mesh of many triangles.
inline std::shared_ptr<Scene> crowded_scene(EnvironmentInput sky) {
  auto scene = std::make_shared<Scene>();
  const MeshData fine = make_sphere(160, 320, 0.25f), small = make_sphere(6, 12),
                 plane = make_plane(40);
  const int big = scene->add_mesh(fine.input(true));
  const int little = scene->add_mesh(small.input(true));
  const int ground = scene->add_mesh(plane.input(false));
  const int grey =
      scene->add_material({closure(ClosureType::kDiffuse, {0.6f, 0.6f, 0.6f})}, "grey");
  scene->add_instance(ground, place(0, 0, 0, 1, 1, 1), {grey});
  scene->add_instance(big, place(0, 3, 1.6, 1.5, 1.5, 1.5, 0.2), {grey});
  for (int i = 0; i < 400; ++i) {
    const double x = -5 + 0.5 * (i % 20), y = -2 + 0.5 * (i / 20), size = 0.1 + 0.02 * (i % 7);
    scene->add_instance(little, place(x, y, size, size, size, -size), {grey});
  }
  set_test_camera(scene.get(), 11, 4);
  scene->set_environment(std::move(sky));
  return scene;
}

}  // namespace skytree::cuda
