// SPDX-License-Identifier: GPL-3.0-or-later
// CPU time of a pixel sample of the spheres scene: threads' CPU time over pixels times samples,
// without the building of trees and tables.
#include <benchmark/benchmark.h>

#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"
#include "tests/render_scenes.h"

namespace skytree {
namespace {

constexpr int kMapWidth = 2048, kMapHeight = 1024;

template <class Sampler>
void render_spheres(benchmark::State& state) {
  RenderOptions options;
  options.width = 320;
  options.height = 240;
  options.samples = 16;
  options.max_bounces = int(state.range(0));
  EnvironmentInput environment;
  environment.texels = share(make_sky(kMapWidth, kMapHeight));
  environment.width = kMapWidth;
  environment.height = kMapHeight;
  environment.sampler =
      std::make_shared<Sampler>(LatLongImage{environment.texels.get(), kMapWidth, kMapHeight});
  const auto scene = make_spheres_scene(4.0 / 3.0);
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

BENCHMARK_TEMPLATE(render_spheres, KdTreeSampler)->Arg(0)->Arg(4)->UseManualTime();
BENCHMARK_TEMPLATE(render_spheres, InversionSampler)->Arg(0)->Arg(4)->UseManualTime();

}  // namespace
}  // namespace skytree
