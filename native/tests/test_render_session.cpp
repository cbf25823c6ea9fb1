// SPDX-License-Identifier: GPL-3.0-or-later
// The session's life: progress, cancel, errors, what is rebuilt, what leaks.
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <limits>
#include <thread>

#include "tests/render_scenes.h"

namespace skytree {
namespace {

RenderOptions film(int width, int height, int samples) {
  RenderOptions options;
  options.width = width;
  options.height = height;
  options.samples = samples;
  return options;
}

/// A square of n x n bumpy quads.
MeshData make_terrain(int n) {
  MeshData mesh;
  for (int y = 0; y <= n; ++y) {
    for (int x = 0; x <= n; ++x) {
      mesh.positions.insert(
          mesh.positions.end(),
          {float(x) / n, float(y) / n, 0.01f * float(std::sin(0.7 * x) * std::sin(0.9 * y))});
    }
  }
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const int a = y * (n + 1) + x;
      mesh.triangles.insert(mesh.triangles.end(), {a, a + 1, a + n + 2, a, a + n + 2, a + n + 1});
    }
  }
  return mesh;
}

size_t resident_bytes() {
  std::ifstream file("/proc/self/statm");
  size_t pages = 0;
  file >> pages >> pages;
  return pages * size_t(sysconf(_SC_PAGESIZE));
}

TEST(Session, RendersProgressivelyAndStops) {
  const auto scene = make_spheres_scene(1.0);
  RenderSession session(2);
  session.start(scene, film(64, 64, 100));
  EXPECT_TRUE(session.wait(600));
  EXPECT_FALSE(session.running());
  EXPECT_EQ(session.samples_done(), 100);
  EXPECT_EQ(session.error(), "");
  EXPECT_GT(session.stats().rays, 64u * 64u * 100u);
  EXPECT_EQ(session.stats().rejected_samples, 0u);
}

TEST(Session, CancelStopsAndKeepsThePicture) {
  const auto scene = make_spheres_scene(1.0);
  RenderSession session(2);
  session.start(scene, film(64, 64, 1 << 30));
  while (session.samples_done() < 3) std::this_thread::yield();
  std::vector<float> pixels(64 * 64 * 4);
  session.pixels(pixels.data());  // while rendering
  session.cancel();
  EXPECT_FALSE(session.running());
  EXPECT_EQ(session.error(), "");
  const int done = session.samples_done();
  session.pixels(pixels.data());
  EXPECT_GE(done, 3);
  EXPECT_GT(pixels[0], 0.0f);
  session.cancel();  // twice is harmless
  session.start(scene, film(64, 64, 2));
  EXPECT_TRUE(session.wait(600));
  EXPECT_EQ(session.samples_done(), 2);
}

TEST(Session, CancelWhileTheTreeIsBuilt) {
  const auto scene = make_spheres_scene(1.0);
  scene->add_instance(scene->add_mesh(make_terrain(700).input("terrain")), identity4(), {});
  RenderSession session(2);
  session.start(scene, film(64, 64, 1 << 30));
  session.cancel();
  EXPECT_EQ(session.samples_done(), 0);
  // What a cancelled build leaves behind must not keep the next one from working.
  session.start(scene, film(64, 64, 1));
  EXPECT_TRUE(session.wait(600));
  EXPECT_EQ(session.error(), "");
  EXPECT_EQ(session.samples_done(), 1);
  EXPECT_EQ(scene->stats().meshes_built, 3u);
}

TEST(Session, RefusesWhatWouldRace) {
  const auto scene = make_spheres_scene(1.0);
  RenderSession session(1);
  session.start(scene, film(64, 64, 1 << 30));
  EXPECT_THROW(session.start(scene, film(64, 64, 1)), std::runtime_error);
  EXPECT_THROW(scene->set_environment({}), std::runtime_error);
  EXPECT_THROW(scene->add_mesh(make_square(1).input("late")), std::runtime_error);
  EXPECT_THROW(scene->set_transform(0, identity4()), std::runtime_error);
  session.cancel();
  EXPECT_NO_THROW(scene->set_transform(0, identity4()));
}

TEST(Session, RefusesOptionsOutOfRange) {
  const auto scene = make_spheres_scene(1.0);
  RenderSession session(1);
  EXPECT_THROW(session.start(scene, film(0, 10, 1)), std::invalid_argument);
  EXPECT_THROW(session.start(scene, film(10, 10, 0)), std::invalid_argument);
  RenderOptions options = film(10, 10, 1);
  options.filter_width = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(session.start(scene, options), std::invalid_argument);
  options = film(10, 10, 1);
  options.x1 = 11;
  options.y1 = 5;
  EXPECT_THROW(session.start(scene, options), std::invalid_argument);
  EXPECT_THROW(RenderSession(-1), std::invalid_argument);
  EXPECT_NO_THROW(scene->set_environment({}));  // a refused start leaves the scene free
}

TEST(Session, ErrorsOfThreadsAreReported) {
  const auto scene = std::make_shared<Scene>();  // no camera
  RenderSession session(2);
  session.start(scene, film(10, 10, 1));
  EXPECT_TRUE(session.wait(600));
  EXPECT_NE(session.error().find("camera"), std::string::npos);
  scene->set_camera(identity4(), perspective(1, 1));
  session.start(scene, film(10, 10, 1));  // an empty scene shows the environment
  EXPECT_TRUE(session.wait(600));
  EXPECT_EQ(session.error(), "");
  std::vector<float> pixels(400);
  session.pixels(pixels.data());
  EXPECT_FLOAT_EQ(pixels[0], 1.0f);
}

TEST(Scene, RebuildsOnlyWhatChanged) {
  const auto scene = make_spheres_scene(1.0);
  RenderSession session(1);
  auto run = [&] {
    session.start(scene, film(16, 16, 1));
    session.wait(600);
    EXPECT_EQ(session.error(), "");
    return scene->stats();
  };
  const SceneStats first = run();
  EXPECT_EQ(first.meshes_built, 2u);
  EXPECT_EQ(first.top_level_built, 1u);
  scene->set_environment({});
  scene->set_camera(look_at({3, -9, 4}, {0, 0, 0.8f}), perspective(0.7, 1));
  scene->set_material(0, {diffuse(0.1f)});
  SceneStats now = run();
  EXPECT_EQ(now.meshes_built, 2u);
  EXPECT_EQ(now.top_level_built, 1u);
  scene->set_transform(1, translation(0, 3, 1));
  now = run();
  EXPECT_EQ(now.meshes_built, 2u);
  EXPECT_EQ(now.top_level_built, 2u);
  scene->set_mesh(1, make_sphere(16, 8).input("coarse"));
  now = run();
  EXPECT_EQ(now.meshes_built, 3u);
  scene->remove_instance(0);
  now = run();
  EXPECT_EQ(now.meshes_built, 3u);
  EXPECT_EQ(now.top_level_built, 4u);
  EXPECT_THROW(scene->remove_mesh(1), std::invalid_argument);  // in use
  EXPECT_THROW(scene->set_transform(0, identity4()), std::invalid_argument);
}

TEST(Scene, BadGeometryIsLeftOutAndNamed) {
  MeshData mesh = make_square(1.0f);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  mesh.positions.insert(mesh.positions.end(), {nan, 0, 0, 5, 5, 5});
  mesh.triangles.insert(mesh.triangles.end(), {0, 1, 4, 0, 1, 99, -1, 0, 1, 2, 2, 3, 5, 5, 5});
  const auto scene = make_spheres_scene(1.0);
  const int bad = scene->add_mesh(mesh.input("Gate"));
  scene->add_instance(bad, identity4(), {0});
  Matrix4 flat = identity4();
  flat[10] = 0.0;
  scene->add_instance(bad, flat, {0});
  flat[10] = nan;
  scene->add_instance(bad, flat, {0});
  scene->add_instance(scene->add_mesh(MeshInput{}), identity4(), {0});  // empty
  const std::vector<std::string> warnings = scene->warnings();
  ASSERT_EQ(warnings.size(), 3u);
  EXPECT_EQ(warnings[0],
            "mesh \"Gate\": triangles left out: 2 with an index out of range, 1 with a vertex that "
            "is not finite, "
            "2 without area");
  EXPECT_NE(warnings[1].find("singular"), std::string::npos);
  EXPECT_NE(warnings[2].find("not finite"), std::string::npos);
  SessionStats stats;
  for (const float x : render(scene, film(32, 32, 4), 2, &stats)) EXPECT_TRUE(std::isfinite(x));
  EXPECT_EQ(stats.rejected_samples, 0u);
}

TEST(Scene, BadTexelsAreCountedAndTakenAsBlack) {
  std::vector<float> texels(3 * 8 * 4, 1.0f);
  texels[0] = std::numeric_limits<float>::quiet_NaN();
  texels[10] = -1.0f;
  texels[11] = std::numeric_limits<float>::infinity();
  const auto scene = make_spheres_scene(1.0);
  EnvironmentInput in;
  in.texels = share(texels);
  in.width = 8;
  in.height = 4;
  scene->set_environment(in);
  ASSERT_EQ(scene->warnings().size(), 1u);
  EXPECT_NE(scene->warnings()[0].find("3 values"), std::string::npos);
  SessionStats stats;
  render(scene, film(32, 32, 4), 2, &stats);
  EXPECT_EQ(stats.rejected_samples, 0u);
  in.world_to_env.row[0] = {2, 0, 0};
  EXPECT_THROW(scene->set_environment(in), std::invalid_argument);
}

TEST(Session, FiveHundredCyclesLeakNothing) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "the sanitizer keeps freed memory, so the process grows";
#endif
  const auto scene = make_spheres_scene(1.0);
  RenderSession session(2);
  auto cycle = [&](int i) {
    scene->set_transform(1, translation(0.001 * i, 0, 1));
    session.start(scene, film(128, 128, 1 << 20));
    if (i % 2) session.wait(0.001);
    session.cancel();
    ASSERT_EQ(session.error(), "");
  };
  for (int i = 0; i < 50; ++i) cycle(i);
  const size_t before = resident_bytes();
  for (int i = 0; i < 500; ++i) cycle(i);
  const size_t after = resident_bytes();
  // A cycle holds 600 KB of film alone: 500 leaked ones would be 300 MB.
  EXPECT_LT(after, before + (size_t(24) << 20));
}

TEST(Session, DestructionWhileRenderingIsClean) {
  for (int i = 0; i < 20; ++i) {
    const auto scene = make_spheres_scene(1.0);
    RenderSession session(3);
    session.start(scene, film(64, 64, 1 << 20));
  }
}

}  // namespace
}  // namespace skytree
