// SPDX-License-Identifier: GPL-3.0-or-later
// CPU time of a pixel sample of the spheres scene, and of one of many objects: threads' CPU time
// over pixels times samples, without the building of trees and tables. "best" is what the preset of
// that name renders with, at bounces 0 but for learnt visibility; the others leave every estimator
// off.
#include <benchmark/benchmark.h>

#include <cmath>

#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"
#include "tests/render_scenes.h"

namespace skytree {
namespace {

constexpr int kMapWidth = 2048, kMapHeight = 1024;

void time_renders(benchmark::State& state, const std::shared_ptr<Scene>& scene,
                  RenderOptions options,
                  std::shared_ptr<const EnvironmentSampler> make(const LatLongImage&)) {
  options.width = 320;
  options.height = 240;
  options.samples = 16;
  EnvironmentInput environment;
  environment.texels = share(make_sky(kMapWidth, kMapHeight));
  environment.width = kMapWidth;
  environment.height = kMapHeight;
  environment.sampler = make(LatLongImage{environment.texels.get(), kMapWidth, kMapHeight});
  scene->set_environment(environment);
  double seconds = 0.0, rays = 0.0;
  for (auto _ : state) {
    SessionStats stats;
    benchmark::DoNotOptimize(render(scene, options, 1, &stats));
    state.SetIterationTime(stats.cpu_seconds);
    seconds += stats.cpu_seconds;
    rays += double(stats.rays);
  }
  const double samples =
      double(options.width) * options.height * options.samples * state.iterations();
  state.counters["us_per_pixel_sample"] = 1e6 * seconds / samples;
  state.counters["rays_per_pixel_sample"] = rays / samples;
}

void render_spheres(benchmark::State& state, const RenderOptions& options,
                    std::shared_ptr<const EnvironmentSampler> make(const LatLongImage&)) {
  time_renders(state, make_spheres_scene(4.0 / 3.0), options, make);
}

/// The spheres and 300 small ones, each a mesh of its own, whose boxes overlap.
void render_objects(benchmark::State& state, TreeKind kind, const RenderOptions& options,
                    std::shared_ptr<const EnvironmentSampler> make(const LatLongImage&)) {
  const auto scene = make_spheres_scene(4.0 / 3.0, kind);
  for (int i = 0; i < 300; ++i) {
    const double x = std::fmod(i * 0.618034, 1.0), y = std::fmod(i * 0.754878, 1.0);
    scene->add_instance(scene->add_mesh(make_sphere(32, 16).input("small")),
                        translation(8 * x - 4, 8 * y - 4, 0.5), {0});
  }
  time_renders(state, scene, options, make);
}

/// A closed room with a window.
void render_room(benchmark::State& state, const RenderOptions& options,
                 std::shared_ptr<const EnvironmentSampler> make(const LatLongImage&)) {
  time_renders(state, make_room_scene(false), options, make);
}

RenderOptions bounces(int count) {
  RenderOptions options;
  options.max_bounces = count;
  return options;
}

RenderOptions best() {
  RenderOptions options = bounces(0);
  options.light_rays = 2;
  options.control_variate = true;
  return options;
}

RenderOptions learning() {
  RenderOptions options = best();
  options.learn_visibility = true;
  return options;
}

template <class Sampler>
std::shared_ptr<const EnvironmentSampler> plain(const LatLongImage& image) {
  return std::make_shared<Sampler>(image);
}

std::shared_ptr<const EnvironmentSampler> compensated(const LatLongImage& image) {
  KdTreeConfig config;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  config.compensation = 1.0;
  return std::make_shared<KdTreeSampler>(image, config);
}

std::shared_ptr<const EnvironmentSampler> linear(const LatLongImage& image) {
  KdTreeConfig config;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  config.block_density = BlockDensity::LINEAR;
  config.compensation = 1.0;
  return std::make_shared<KdTreeSampler>(image, config);
}

BENCHMARK_CAPTURE(render_spheres, best, best(), compensated)->UseManualTime();
BENCHMARK_CAPTURE(render_room, best, best(), linear)->UseManualTime();
BENCHMARK_CAPTURE(render_room, learning, learning(), linear)->UseManualTime();
BENCHMARK_CAPTURE(render_objects, flat, TreeKind::kFlat, best(), compensated)->UseManualTime();
BENCHMARK_CAPTURE(render_objects, instanced, TreeKind::kInstanced, best(), compensated)
    ->UseManualTime();
BENCHMARK_CAPTURE(render_spheres, kdtree, bounces(0), plain<KdTreeSampler>)->UseManualTime();
BENCHMARK_CAPTURE(render_spheres, kdtree_bounces, bounces(4), plain<KdTreeSampler>)
    ->UseManualTime();
BENCHMARK_CAPTURE(render_spheres, inversion, bounces(0), plain<InversionSampler>)->UseManualTime();
BENCHMARK_CAPTURE(render_spheres, inversion_bounces, bounces(4), plain<InversionSampler>)
    ->UseManualTime();

}  // namespace
}  // namespace skytree
