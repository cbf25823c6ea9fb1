// SPDX-License-Identifier: GPL-3.0-or-later
// Scenes and maps that the render tests and the render benchmark share.
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "src/render_session.h"

namespace skytree {

inline Matrix4 identity4() { return {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}; }

inline Matrix4 translation(double x, double y, double z) {
  return {1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z, 0, 0, 0, 1};
}

/// Looks from `eye` to `target`, up is +Z.
inline Matrix4 look_at(Vec3 eye, Vec3 target) {
  const Vec3 z = normalize(eye - target);
  const Vec3 x = normalize(cross({0, 0, 1}, z));
  const Vec3 y = cross(z, x);
  return {x.x, y.x, z.x, eye.x, x.y, y.y, z.y, eye.y, x.z, y.z, z.z, eye.z, 0, 0, 0, 1};
}

inline Matrix4 perspective(double field_of_view, double aspect, double near = 0.1,
                           double far = 1000.0) {
  const double w = std::tan(0.5 * field_of_view), h = w / aspect;
  return {1 / w,
          0,
          0,
          0,
          0,
          1 / h,
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
}

inline Matrix4 orthographic(double width, double height, double near = 0.1, double far = 1000.0) {
  return {2 / width,
          0,
          0,
          0,
          0,
          2 / height,
          0,
          0,
          0,
          0,
          -2 / (far - near),
          -(far + near) / (far - near),
          0,
          0,
          0,
          1};
}

struct MeshData {
  std::vector<float> positions, normals;
  std::vector<int32_t> triangles, corners;

  MeshInput input(const char* name) const {
    MeshInput in;
    in.positions = positions.data();
    in.vertex_count = positions.size() / 3;
    in.triangles = triangles.data();
    in.triangle_count = triangles.size() / 3;
    if (!normals.empty()) {
      in.corners = corners.data();
      in.corner_normals = normals.data();
      in.corner_count = normals.size() / 3;
    }
    in.name = name;
    return in;
  }
};

/// Unit sphere, smooth, its poles on the z axis.
inline MeshData make_sphere(int columns = 64, int rows = 32, bool smooth = true) {
  MeshData mesh;
  for (int i = 0; i <= rows; ++i) {
    for (int k = 0; k < columns; ++k) {
      const double theta = M_PI * i / rows, phi = 2.0 * M_PI * k / columns;
      mesh.positions.insert(mesh.positions.end(),
                            {float(std::sin(theta) * std::cos(phi)),
                             float(std::sin(theta) * std::sin(phi)), float(std::cos(theta))});
    }
  }
  for (int i = 0; i < rows; ++i) {
    for (int k = 0; k < columns; ++k) {
      const int a = i * columns + k, b = i * columns + (k + 1) % columns;
      const int c = a + columns, d = b + columns;
      if (i + 1 < rows) mesh.triangles.insert(mesh.triangles.end(), {a, c, d});
      if (i > 0) mesh.triangles.insert(mesh.triangles.end(), {a, d, b});
    }
  }
  if (smooth) {
    mesh.normals = mesh.positions;
    mesh.corners = mesh.triangles;
  }
  return mesh;
}

/// Square in the plane z = 0, edge 2 * half.
inline MeshData make_square(float half) {
  MeshData mesh;
  mesh.positions = {-half, -half, 0, half, -half, 0, half, half, 0, -half, half, 0};
  mesh.triangles = {0, 1, 2, 0, 2, 3};
  return mesh;
}

inline Closure diffuse(float albedo) {
  Closure closure;
  closure.color = {albedo, albedo, albedo};
  return closure;
}

inline Closure glossy(float color, float roughness, float anisotropy = 0.0f) {
  Closure closure;
  closure.type = ClosureType::kGlossy;
  closure.color = {color, color, color};
  closure.roughness = roughness;
  closure.anisotropy = anisotropy;
  return closure;
}

/// A room of 6 x 6 x 3 with one window of 1.2 x 1 in the wall at x = 3, and a ball in it; open: the
/// floor alone.
inline std::shared_ptr<Scene> make_room_scene(bool open, double aspect = 4.0 / 3.0) {
  auto scene = std::make_shared<Scene>();
  const int white = scene->add_material({diffuse(0.7f)}, "white");
  const int square = scene->add_mesh(make_square(1.0f).input("square"));
  auto wall = [&](Matrix4 m) { scene->add_instance(square, m, {white}); };
  wall({3, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
  if (!open) {
    wall({3, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1, 3, 0, 0, 0, 1});
    wall({0, 0, 1, -3, 0, 3, 0, 0, 1.5, 0, 0, 1.5, 0, 0, 0, 1});
    wall({3, 0, 0, 0, 0, 0, 1, 3, 0, 1.5, 0, 1.5, 0, 0, 0, 1});
    wall({3, 0, 0, 0, 0, 0, 1, -3, 0, 1.5, 0, 1.5, 0, 0, 0, 1});
    // around the window
    auto strip = [&](double y, double z, double hy, double hz) {
      wall({0, 0, 1, 3, 0, hy, 0, y, hz, 0, 0, z, 0, 0, 0, 1});
    };
    strip(0, 0.5, 3, 0.5);
    strip(0, 2.5, 3, 0.5);
    strip(-1.8, 1.5, 1.2, 0.5);
    strip(1.8, 1.5, 1.2, 0.5);
  }
  const int sphere = scene->add_mesh(make_sphere().input("sphere"));
  scene->add_instance(sphere, {0.6, 0, 0, 0, 0, 0.6, 0, 0.8, 0, 0, 0.6, 0.6, 0, 0, 0, 1}, {white});
  scene->set_camera(look_at({2.5f, -2.5f, 1.6f}, {-1.0f, 0.5f, 0.9f}), perspective(1.2, aspect));
  return scene;
}

/// Ground and three spheres: diffuse, sharp metal, rough metal.
inline std::shared_ptr<Scene> make_spheres_scene(double aspect,
                                                 TreeKind kind = TreeKind::kInstanced) {
  auto scene = std::make_shared<Scene>(kind);
  const int materials[3] = {scene->add_material({diffuse(0.8f)}, "white"),
                            scene->add_material({glossy(0.9f, 0.2f)}, "metal"),
                            scene->add_material({glossy(0.7f, 0.5f)}, "rough")};
  const int ground = scene->add_material({diffuse(0.5f)}, "ground");
  scene->add_instance(scene->add_mesh(make_square(200.0f).input("ground")), identity4(), {ground});
  const int sphere = scene->add_mesh(make_sphere().input("sphere"));
  for (int i = 0; i < 3; ++i) {
    scene->add_instance(sphere, translation(2.2 * (i - 1), 0, 1), {materials[i]});
  }
  scene->set_camera(look_at({0, -9, 4}, {0, 0, 0.8f}), perspective(0.7, aspect));
  return scene;
}

/// Blue sky over dark ground with a small sun, RGB.
inline std::vector<float> make_sky(int width, int height) {
  std::vector<float> texels(size_t(width) * height * 3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double theta = M_PI * (y + 0.5) / height, phi = 2.0 * M_PI * (x + 0.5) / width;
      const double dx = std::sin(theta) * std::cos(phi), dz = std::cos(theta);
      const double sun = 2000.0 * std::exp(-((1.0 - 0.6 * dx - 0.8 * dz) / 0.001));
      const double sky =
          dz > 0 ? 0.3 + 0.5 * dz + 0.1 * std::sin(9 * phi) * std::sin(7 * theta) : 0.1;
      float* texel = &texels[(size_t(y) * width + x) * 3];
      texel[0] = float(0.6 * sky + sun);
      texel[1] = float(0.8 * sky + 0.9 * sun);
      texel[2] = float(sky + 0.7 * sun);
    }
  }
  return texels;
}

inline std::shared_ptr<const float> share(std::vector<float> texels) {
  auto owner = std::make_shared<std::vector<float>>(std::move(texels));
  return std::shared_ptr<const float>(owner, owner->data());
}

/// Renders to the end and returns RGBA, bottom row first. Throws what the session reports.
inline std::vector<float> render(const std::shared_ptr<Scene>& scene, const RenderOptions& options,
                                 int threads = 0, SessionStats* stats = nullptr) {
  RenderSession session(threads);
  session.start(scene, options);
  session.wait(1e6);
  if (!session.error().empty()) throw std::runtime_error(session.error());
  std::vector<float> pixels(size_t(session.region_width()) * session.region_height() * 4);
  session.pixels(pixels.data());
  if (stats) *stats = session.stats();
  return pixels;
}

}  // namespace skytree
