// SPDX-License-Identifier: GPL-3.0-or-later
// Scenes whose triangles lie in one ray-tracing tree (TreeKind::kFlat).
#include <gtest/gtest.h>

#include "tests/render_scenes.h"

namespace skytree {
namespace {

RenderOptions film(int samples, int max_bounces = 0) {
  RenderOptions options;
  options.width = 64;
  options.height = 48;
  options.samples = samples;
  options.max_bounces = max_bounces;
  return options;
}

EnvironmentInput sky() {
  EnvironmentInput in;
  in.texels = share(make_sky(64, 32));
  in.width = 64;
  in.height = 32;
  return in;
}

/// The spheres, in front of them one instance each of a sheared and a mirrored mesh, and two
/// instances of a mesh with too many triangles to be copied.
std::shared_ptr<Scene> make_mixed_scene(TreeKind kind) {
  auto scene = make_spheres_scene(4.0 / 3.0, kind);
  scene->set_environment(sky());
  const int material = scene->add_material({diffuse(0.3f)}, "grey");
  const Matrix4 sheared = {0.4, 0.2, 0, -1, 0, 0.3, 0.1, -3, 0, 0, 0.5, 0.6, 0, 0, 0, 1};
  const Matrix4 mirrored = {0, -0.5, 0, 1, -0.5, 0, 0, -3, 0, 0, -0.5, 0.6, 0, 0, 0, 1};
  scene->add_instance(scene->add_mesh(make_sphere(24, 12, false).input("sheared")), sheared,
                      {material});
  scene->add_instance(scene->add_mesh(make_sphere(24, 12).input("mirrored")), mirrored, {0});
  const int fine = scene->add_mesh(make_sphere(800, 350).input("fine"));
  for (const double x : {-3.5, 3.5}) scene->add_instance(fine, translation(x, 2, 1), {material});
  return scene;
}

TEST(FlatTrees, ShowWhatInstancesShow) {
  const auto scene = make_mixed_scene(TreeKind::kFlat);
  const std::vector<float> flat = render(scene, film(16, 2), 1);
  EXPECT_EQ(scene->stats().meshes_built, 1u) << "the fine one alone stays a mesh of instances";
  EXPECT_EQ(flat, render(scene, film(16, 2), 3)) << "threads";
  const std::vector<float> instanced = render(make_mixed_scene(TreeKind::kInstanced), film(16, 2));
  // The same random numbers: only rays that graze an edge may end elsewhere.
  size_t far = 0;
  for (size_t i = 0; i < flat.size(); ++i) far += std::fabs(flat[i] - instanced[i]) > 1e-3f;
  EXPECT_LT(far, flat.size() / 200);
}

TEST(FlatTrees, FollowChanges) {
  auto scene = std::make_shared<Scene>(TreeKind::kFlat);
  const int material = scene->add_material({diffuse(0.8f)}, "m");
  const int mesh = scene->add_mesh(make_square(0.5f).input("square"));
  const int instance = scene->add_instance(mesh, translation(-1, 0, 0), {material});
  scene->set_camera(translation(0, 0, 5), orthographic(8, 6));  // looks down
  EnvironmentInput unseen;
  unseen.visible = false;
  scene->set_environment(unseen);
  RenderOptions options = film(4);
  options.film_transparent = true;
  auto covered = [&](double x, double y) {  // whether something is at (x, y)
    const std::vector<float> pixels = render(scene, options);
    return pixels[(size_t((y + 3) * 8) * 64 + size_t((x + 4) * 8)) * 4 + 3] == 1.0f;
  };
  EXPECT_TRUE(covered(-1, 0));
  EXPECT_FALSE(covered(1, 0));
  scene->set_transform(instance, translation(1, 0, 0));
  EXPECT_TRUE(covered(1, 0));
  EXPECT_FALSE(covered(-1, 0));
  const int copy = scene->add_instance(mesh, translation(-1, 0, 0), {material});
  EXPECT_TRUE(covered(-1, 0));
  scene->set_mesh(mesh, make_square(0.25f).input("smaller"));
  EXPECT_TRUE(covered(1, 0));
  EXPECT_FALSE(covered(1.4, 0));
  scene->remove_instance(instance);
  EXPECT_FALSE(covered(1, 0));
  EXPECT_TRUE(covered(-1, 0));
  scene->set_transform(copy, {});  // singular: left out
  EXPECT_FALSE(covered(-1, 0));
  EXPECT_EQ(scene->stats().meshes_built, 0u);
}

TEST(FlatTrees, LargeTiltedPlanesDoNotShadowThemselves) {
  // Vertices far away round far more coarsely than the points near the middle that are shaded.
  const double s = std::sin(0.5), c = std::cos(0.5);
  const Matrix4 tilted = {c, s * s, s * c, 0, 0, c, -s, 0, -s, c * s, c * c, 0, 0, 0, 0, 1};
  MeshData in_place = make_square(1000.0f);
  for (size_t i = 0; i < in_place.positions.size(); i += 3) {
    float* p = &in_place.positions[i];
    const float x = p[0], y = p[1];
    for (int k = 0; k < 3; ++k) p[k] = float(tilted[4 * k] * x + tilted[4 * k + 1] * y);
  }
  auto check = [](TreeKind kind, const MeshData& mesh, const Matrix4& matrix) {
    auto scene = std::make_shared<Scene>(kind);
    const int material = scene->add_material({diffuse(1.0f)}, "white");
    scene->add_instance(scene->add_mesh(mesh.input("plane")), matrix, {material});
    scene->set_camera(look_at({0.3f, -2, 3}, {0, 0, 0}), perspective(0.5, 4.0 / 3.0));
    scene->set_environment({});
    const std::vector<float> pixels = render(scene, film(64));
    for (size_t i = 0; i < pixels.size(); i += 4) ASSERT_NEAR(pixels[i], 1.0f, 0.06f) << i;
  };
  check(TreeKind::kFlat, make_square(1000.0f), tilted);
  check(TreeKind::kInstanced, make_square(1000.0f), tilted);
  check(TreeKind::kInstanced, in_place, identity4());
}

}  // namespace
}  // namespace skytree
