// SPDX-License-Identifier: GPL-3.0-or-later
// Two scenes whose pictures are known by quadrature, without anything that draws samples.
#pragma once

#include <functional>

#include "kernel/material.h"
#include "tests/render_scenes.h"

namespace skytree::testing {

struct Rgb {
  double r = 0, g = 0, b = 0;

  void add(Vec3 v, double weight) {
    r += v.x * weight;
    g += v.y * weight;
    b += v.z * weight;
  }
};

inline Rgb mean_rgb(const std::vector<float>& pixels) {
  Rgb mean;
  for (size_t i = 0; i < pixels.size(); i += 4) {
    mean.add({pixels[i], pixels[i + 1], pixels[i + 2]}, 4.0 / double(pixels.size()));
  }
  return mean;
}

inline Rgb combine(double a, const Rgb& x, double b, const Rgb& y) {
  return {a * x.r + b * y.r, a * x.g + b * y.g, a * x.b + b * y.b};
}

/// The limit of `rule(n)`, a midpoint rule of n steps whose error falls as 1 / n^2, by Richardson's
/// extrapolation; n grows until half of it would have done.
inline Rgb converged(int steps, const std::function<Rgb(int)>& rule) {
  Rgb coarse = rule(steps), limit;
  for (int refinement = 0; refinement < 4; ++refinement) {
    steps *= 2;
    const Rgb fine = rule(steps);
    const Rgb before = limit;
    limit = combine(4.0 / 3.0, fine, -1.0 / 3.0, coarse);
    const Rgb change = combine(1.0, limit, -1.0, before);
    if (std::fabs(change.r) + std::fabs(change.g) + std::fabs(change.b) <
        1e-4 * (limit.r + limit.g + limit.b)) {
      return limit;
    }
    coarse = fine;
  }
  throw std::runtime_error("a reference does not converge");
}

/// The tables of a scene, as a render uses them.
class CommittedScene {
 public:
  explicit CommittedScene(Scene* scene, int width = 4, int height = 3) : scene_(scene) {
    scene_->begin_use();
    scene_->commit(never_);
    view = scene_->view(width, height);
  }
  ~CommittedScene() { scene_->end_use(); }

  SceneView view;

 private:
  Scene* scene_;
  std::atomic<bool> never_{false};
};

inline Vec3 map_radiance(const EnvironmentView& environment, Vec3 world) {
  return environment.color * lookup_bilinear(environment.image, environment.world_to_env * world);
}

/// Of the plane below: triangle and place of a hit, and where that is.
constexpr Hit kPlaneHit = {0, 0, 0.3f, 0.3f, 1.0f};
constexpr Vec3 kPlanePoint = {10.0f, -20.0f, 0.0f};

/// A part of a plane, so small that all of its picture is one integral: that of the map's radiance
/// times the material's reflectance. (The tangents of anisotropic materials turn from place to
/// place.)
inline std::shared_ptr<Scene> make_plane_scene(const std::vector<Closure>& material,
                                               const EnvironmentInput& environment) {
  auto scene = std::make_shared<Scene>();
  scene->add_instance(scene->add_mesh(make_square(50.0f).input("plane")), identity4(),
                      {scene->add_material(material, "plane")});
  scene->set_camera(look_at(kPlanePoint + Vec3{1.0f, -2.0f, 2.5f}, kPlanePoint),
                    orthographic(0.04, 0.03));
  scene->set_environment(environment);
  return scene;
}

/// By the midpoint rule in each texel's part of the sphere.
inline Rgb plane_radiance(Scene* scene) {
  const CommittedScene committed(scene);
  const SceneView& view = committed.view;
  const Vec3 to_eye = -camera_ray(view.camera, 2.0f, 1.5f).direction;
  const InstanceView& instance = view.instances[0];
  const MeshView& mesh = view.meshes[instance.mesh];
  const Surface surface = make_surface(mesh, instance, view.instance_materials, kPlaneHit, to_eye);
  Shading shading;
  evaluate_material(view.tables, view.materials[surface.material], mesh, instance, kPlaneHit,
                    surface, to_eye, &shading);
  const LatLongImage& image = view.environment.image;
  return converged(2, [&](int steps) {
    Rgb sum;
    const int rows = image.height * steps, columns = image.width * steps;
    for (int y = 0; y < rows; ++y) {
      const double solid_angle =
          (std::cos(M_PI * y / rows) - std::cos(M_PI * (y + 1) / rows)) * 2.0 * M_PI / columns;
      for (int x = 0; x < columns; ++x) {
        const float u = (x + 0.5f) / columns, v = (y + 0.5f) / rows;
        const Vec3 world = transpose_mul(view.environment.world_to_env, latlong_direction(u, v));
        const BsdfValue bsdf = eval_bsdf(shading, surface, to_eye, world);
        if (!(max_component(bsdf.f) > 0.0f)) continue;
        sum.add(bsdf.f * view.environment.color * lookup_bilinear_uv(image, u, v), solid_angle);
      }
    }
    return sum;
  });
}

/// The inside of a white ball with a hole around its upper pole, seen from its middle. As in
/// every integrating sphere each place sees all parts of the sphere as large as they are: what the
/// hole lets in is an integral over its cap without cosines, and bounced light is even.
struct IntegratingSphere {
  static constexpr int kColumns = 512, kRows = 256;  // facets this small are a sphere to 1e-4
  static constexpr float kAlbedo = 0.5f;

  /// The hole takes so many of the rows.
  IntegratingSphere(int open_rows, const EnvironmentInput& environment)
      : hole_height(1.0 - std::cos(M_PI * open_rows / kRows)) {
    MeshData mesh = make_sphere(kColumns, kRows, false);
    const size_t open_triangles = size_t(kColumns) * (2 * open_rows - 1);
    mesh.triangles.erase(mesh.triangles.begin(), mesh.triangles.begin() + 3 * open_triangles);
    scene->add_instance(scene->add_mesh(mesh.input("sphere")), identity4(),
                        {scene->add_material({diffuse(kAlbedo)}, "white")});
    scene->set_camera(look_at({0, 0, 0}, {0.2f, 0.4f, -1.0f}), perspective(1.0, 4.0 / 3.0, 0.01));
    scene->set_environment(environment);
  }

  /// What falls on a place through the hole, as irradiance, by the midpoint rule.
  static Rgb light_through_hole(const EnvironmentView& environment, Vec3 place, double hole_height,
                                int steps) {
    Rgb sum;
    for (int i = 0; i < steps; ++i) {
      for (int k = 0; k < 2 * steps; ++k) {
        const Vec3 hole = on_sphere(1.0 - hole_height * (i + 0.5) / steps, (k + 0.5) / (2 * steps));
        sum.add(map_radiance(environment, normalize(hole - place)),
                0.25 * hole_height / steps * 2.0 * M_PI / (2 * steps));
      }
    }
    return sum;
  }

  /// The picture's pixels after so many bounces.
  std::vector<Rgb> pixels(int width, int height, int bounces) const {
    const CommittedScene committed(scene.get(), width, height);
    const EnvironmentView& environment = committed.view.environment;
    const double wall_height = 2.0 - hole_height;
    const Rgb all = converged(6, [&](int steps) {
      Rgb sum;  // the wall's irradiance through the hole, as a mean over the whole sphere
      for (int i = 0; i < steps; ++i) {
        for (int k = 0; k < 2 * steps; ++k) {
          const Vec3 place =
              on_sphere(-1.0 + wall_height * (i + 0.5) / steps, (k + 0.25) / (2 * steps));
          const Rgb e = light_through_hole(environment, place, hole_height, steps);
          sum.add({float(e.r), float(e.g), float(e.b)}, wall_height / 2.0 / (2 * steps * steps));
        }
      }
      return sum;
    });
    double bounced = 0.0, power = kAlbedo;
    for (int bounce = 0; bounce < bounces; ++bounce) {
      bounced += power;
      power *= kAlbedo * wall_height / 2.0;
    }
    std::vector<Rgb> result;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const Vec3 place = camera_ray(committed.view.camera, x + 0.5f, y + 0.5f).direction;
        const Rgb direct = light_through_hole(environment, place, hole_height, 24);
        const double white = kAlbedo / M_PI;
        result.push_back({white * (direct.r + bounced * all.r),
                          white * (direct.g + bounced * all.g),
                          white * (direct.b + bounced * all.b)});
      }
    }
    return result;
  }

  std::shared_ptr<Scene> scene = std::make_shared<Scene>();

 private:
  static Vec3 on_sphere(double z, double turn) {
    const double r = std::sqrt(1.0 - z * z), angle = 2.0 * M_PI * turn;
    return {float(r * std::cos(angle)), float(r * std::sin(angle)), float(z)};
  }

  double hole_height;
};

inline Rgb mean_rgb(const std::vector<Rgb>& pixels) {
  Rgb mean;
  for (const Rgb& p : pixels) {
    mean.r += p.r / double(pixels.size());
    mean.g += p.g / double(pixels.size());
    mean.b += p.b / double(pixels.size());
  }
  return mean;
}

/// Smooth, brightest near (0.6, 0, 0.8), of differing colours: samplers that know nothing of the
/// map get along with it.
inline std::vector<float> make_soft_sky(int width, int height) {
  std::vector<float> texels;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Vec3 d = latlong_direction((x + 0.5f) / width, (y + 0.5f) / height);
      const float glow = 4.0f * std::exp((0.6f * d.x + 0.8f * d.z - 1.0f) / 0.1f);
      texels.insert(texels.end(), {1.0f + 0.5f * d.x + glow, 1.0f + 0.5f * d.y + 0.9f * glow,
                                   1.0f - 0.5f * d.z + 0.7f * glow});
    }
  }
  return texels;
}

}  // namespace skytree::testing
