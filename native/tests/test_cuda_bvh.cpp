// SPDX-License-Identifier: GPL-3.0-or-later
// kernel/bvh.h against Embree, on the host and on the device: a million rays a scene.
#include <cstring>
#include <random>

#include "cuda/device_scene.h"
#include "cuda/kernel_parameters.h"
#include "cuda_host_reference.h"
#include "cuda_test_scenes.h"
#include "cuda_test_support.h"

namespace skytree::cuda {
namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr size_t kRays = 1 << 16;  // the build that looks for bad accesses, not for rare hits
#else
constexpr size_t kRays = 1 << 20;
#endif

/// Rays as a path tracer has them: from a camera outside, and from surfaces in all directions.
std::vector<Ray> make_rays(size_t count) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  std::vector<Ray> rays(count);
  for (size_t i = 0; i < count; ++i) {
    const Vec3 target = {-5 + 10 * uniform(random), -3 + 8 * uniform(random),
                         2.5f * uniform(random)};
    Vec3 origin = {0, -11, 4};
    if (i % 2) origin = {-6 + 12 * uniform(random), -4 + 10 * uniform(random), 3 * uniform(random)};
    Vec3 direction = normalize(target - origin);
    if (i % 64 == 5) direction = {0, 0, i % 128 == 5 ? 1.0f : -1.0f};  // zeros in the slab test
    rays[i] = {origin, 0.0f, direction, i % 3 ? INFINITY : 8.0f};
  }
  return rays;
}

std::vector<Hit> trace_embree(RTCScene tree, const std::vector<Ray>& rays) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  std::vector<Hit> hits(rays.size());
  alignas(32) int valid[8];
  RTCRayHit8 packet = {};
  for (size_t first = 0; first < rays.size(); first += 8) {
    for (size_t lane = 0; lane < 8; ++lane) {
      const Ray& ray = rays[std::min(first + lane, rays.size() - 1)];
      valid[lane] = -1;
      packet.ray.org_x[lane] = ray.origin.x;
      packet.ray.org_y[lane] = ray.origin.y;
      packet.ray.org_z[lane] = ray.origin.z;
      packet.ray.dir_x[lane] = ray.direction.x;
      packet.ray.dir_y[lane] = ray.direction.y;
      packet.ray.dir_z[lane] = ray.direction.z;
      packet.ray.tnear[lane] = ray.t_min;
      packet.ray.tfar[lane] = ray.t_max;
      packet.ray.mask[lane] = ~0u;
      packet.hit.geomID[lane] = packet.hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
    }
    embree().Intersect8(valid, tree, &context, &packet);
    for (size_t lane = 0; lane < 8 && first + lane < rays.size(); ++lane) {
      const bool hit = packet.hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID;
      hits[first + lane] = {hit ? int32_t(packet.hit.instID[0][lane]) : -1,
                            int32_t(packet.hit.primID[lane]), packet.hit.u[lane],
                            packet.hit.v[lane], packet.ray.tfar[lane]};
    }
  }
  return hits;
}

/// Where the two differ at all, it must be what rounding explains.
void compare(const std::vector<Hit>& ours, const std::vector<Hit>& embrees) {
  size_t missed = 0, other_triangle = 0, far = 0, hits = 0;
  for (size_t i = 0; i < ours.size(); ++i) {
    const Hit &a = ours[i], &b = embrees[i];
    hits += b.instance >= 0;
    if ((a.instance < 0) != (b.instance < 0)) {
      ++missed;
    } else if (a.instance >= 0) {
      // At an edge either neighbour is right; the distance decides whether it was one.
      if (a.instance != b.instance || a.triangle != b.triangle) ++other_triangle;
      if (std::fabs(a.t - b.t) > 2e-5f * (1.0f + b.t)) ++far;
    }
  }
  EXPECT_GT(hits, ours.size() / 4);
  // Neither tracer is watertight: a ray through an edge may slip between two triangles in one of
  // them.
  EXPECT_LE(missed, ours.size() / 100000) << "of " << ours.size();
  EXPECT_LE(far, ours.size() / 100000) << "of " << ours.size();
  EXPECT_LE(other_triangle, ours.size() / 10000) << "of " << ours.size();
  std::printf(
      "%zu rays, %zu hits: %zu missed by one tracer, %zu another triangle, %zu at another "
      "distance\n",
      ours.size(), hits, missed, other_triangle, far);
}

std::shared_ptr<Scene> make_scene(bool crowded) {
  return crowded ? crowded_scene(make_sky(16, 8, nullptr))
                 : material_scene(make_sky(16, 8, nullptr));
}

class Bvh : public testing::TestWithParam<bool> {};

TEST_P(Bvh, OnTheHostFindsEmbreesHits) {
  const std::shared_ptr<Scene> scene = make_scene(GetParam());
  const std::atomic<bool> cancel{false};
  scene->begin_use();
  ASSERT_TRUE(scene->commit(cancel));
  const SceneParts parts = scene->parts(64, 64);
  const HostTrees trees(parts);
  const std::vector<Ray> rays = make_rays(kRays);
  std::vector<Hit> hits(rays.size());
  size_t wrong_any = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    hits[i] = trace_ray(trees.view, parts.instances->data(), rays[i], false);
    const Hit any = trace_ray(trees.view, parts.instances->data(), rays[i], true);
    wrong_any += (any.instance < 0) != (hits[i].instance < 0);
  }
  EXPECT_EQ(wrong_any, 0u);
  compare(hits, trace_embree(scene->tree(), rays));
  scene->end_use();
}

TEST(BvhEdgeCases, EmptySceneAndSingleTriangle) {
  const Ray ray = {{0.2f, 0.2f, 1}, 0.0f, {0, 0, -1}, INFINITY};
  EXPECT_EQ(trace_ray({}, nullptr, ray, false).instance, -1);

  const std::atomic<bool> cancel{false};
  const float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const int32_t triangle[] = {0, 1, 2};
  MeshBvh mesh;
  ASSERT_TRUE(build_mesh_bvh(positions, triangle, 1, cancel, &mesh));
  const std::vector<InstanceView> instances = {{identity3(), {0, 0, 0}, identity3(), 0, 0, 0}};
  TopBvh top;
  ASSERT_TRUE(build_top_bvh(instances, {mesh.bounds}, cancel, &top));
  const MeshBvhView view = {mesh.nodes.data(), mesh.triangles.data()};
  const TracerView tracer = {top.nodes.data(), top.instances.data(), &view};
  const Hit hit = trace_ray(tracer, instances.data(), ray, false);
  EXPECT_EQ(hit.instance, 0);
  EXPECT_EQ(hit.triangle, 0);
  EXPECT_FLOAT_EQ(hit.t, 1.0f);
  EXPECT_FLOAT_EQ(hit.u, 0.2f);
  const Ray beyond = {{0.2f, 0.2f, 1}, 0.0f, {0, 0, -1}, 0.5f};
  EXPECT_EQ(trace_ray(tracer, instances.data(), beyond, false).instance, -1);
}

TEST(BvhEdgeCases, CoincidentTrianglesStayWithinTheStack) {
  // All centroids alike: no plane separates them, and the builder must still end in time.
  std::vector<float> positions;
  std::vector<int32_t> triangles;
  for (int i = 0; i < 5000; ++i) {
    for (const float x : {0, 0, 0, 1, 0, 0, 0, 1, 0}) positions.push_back(x);
    for (int k = 0; k < 3; ++k) triangles.push_back(3 * i + k);
  }
  const std::atomic<bool> cancel{false};
  MeshBvh mesh;
  ASSERT_TRUE(build_mesh_bvh(positions.data(), triangles.data(), 5000, cancel, &mesh));
  EXPECT_EQ(mesh.triangles.size(), 5000u);
}

TEST(BvhEdgeCases, BuildingIsCancellable) {
  const MeshData sphere = make_sphere(200, 400);
  const std::atomic<bool> cancel{true};
  MeshBvh mesh;
  EXPECT_FALSE(build_mesh_bvh(sphere.positions.data(), sphere.triangles.data(),
                              sphere.triangles.size() / 3, cancel, &mesh));
}

class CudaBvh : public CudaTest, public testing::WithParamInterface<bool> {};

TEST_P(CudaBvh, OnTheDeviceIsTheHostsToTheLastBit) {
  const std::shared_ptr<Scene> scene = make_scene(GetParam());
  const std::atomic<bool> cancel{false};
  scene->begin_use();
  ASSERT_TRUE(scene->commit(cancel, false));
  const SceneParts parts = scene->parts(64, 64);
  const HostTrees trees(parts);
  const std::vector<Ray> rays = make_rays(kRays);

  const ContextPointer context = Context::acquire(0);
  const Stream stream(context);
  DeviceScene device(context);
  const std::vector<float> filter(kFilterTableSize);
  ASSERT_TRUE(device.update(parts, nullptr, false, filter.data(), cancel));
  const Buffer device_rays(context, rays.data(), rays.size() * sizeof(Ray));
  const Buffer device_hits(context, rays.size() * sizeof(Hit));
  launch(*context, stream, "trace_rays", unsigned(rays.size() / kThreads), kThreads,
         TraceParameters{device.tracer(), device.view().instances, device_rays.as<Ray>(),
                         device_hits.writable<Hit>(), uint32_t(rays.size()), false});
  stream.synchronize();
  std::vector<Hit> hits(rays.size());
  device_hits.download(hits.data(), hits.size() * sizeof(Hit));
  size_t different = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    const Hit host = trace_ray(trees.view, parts.instances->data(), rays[i], false);
    // Equal distances at an edge may be settled by the order in the tree, which threads of the
    // builder decide.
    const bool same = std::memcmp(&host, &hits[i], sizeof host) == 0;
    different += !same && !(host.instance >= 0 && host.t == hits[i].t);
  }
  EXPECT_EQ(different, 0u);
  scene->end_use();
}

INSTANTIATE_TEST_SUITE_P(Scenes, Bvh, testing::Bool(),
                         [](const auto& info) { return info.param ? "crowded" : "materials"; });
INSTANTIATE_TEST_SUITE_P(Scenes, CudaBvh, testing::Bool(),
                         [](const auto& info) { return info.param ? "crowded" : "materials"; });

}  // namespace
}  // namespace skytree::cuda
