// SPDX-License-Identifier: GPL-3.0-or-later
// Whole samples (block or texel, point, direction and pdf), densities and builds of every sampler
// with 1024 blocks, on maps from 1k to 8k. Times are CPU times of one thread, those of builds of
// all cores together beside the time on the clock; read ratios within one run.
#include <benchmark/benchmark.h>

#include <map>
#include <memory>
#include <random>

#include "src/alias_sampler.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

enum Method {
  KDTREE_FITTED,
  KDTREE_MIN_VARIANCE,
  KDTREE_LINEAR,
  INVERSION_BINARY,
  INVERSION_GUIDED,
  ALIAS,
  UNIFORM
};
constexpr const char* kNames[] = {"kdtree_fitted",    "kdtree_min_variance", "kdtree_linear",
                                  "inversion_binary", "inversion_guided",    "alias",
                                  "uniform"};

const Map& map_of_width(int width) {
  static std::map<int, std::unique_ptr<Map>> maps;
  auto& map = maps[width];
  if (!map) map = std::make_unique<Map>(testing::make_outdoor_map(width, width / 2));
  return *map;
}

KdTreeConfig config_of(SplitCriterion criterion, BlockProbability probability,
                       BlockDensity density = BlockDensity::CONSTANT) {
  KdTreeConfig config;
  config.block_density = density;
  config.split_criterion = criterion;
  config.block_probability = probability;
  return config;
}

std::unique_ptr<EnvironmentSampler> make_sampler(Method method, const LatLongImage& image) {
  switch (method) {
    case KDTREE_FITTED:
      return std::make_unique<KdTreeSampler>(image);
    case KDTREE_MIN_VARIANCE:
      return std::make_unique<KdTreeSampler>(
          image, config_of(SplitCriterion::MIN_VARIANCE, BlockProbability::MIN_VARIANCE));
    case KDTREE_LINEAR:
      return std::make_unique<KdTreeSampler>(
          image, config_of(SplitCriterion::MIN_VARIANCE, BlockProbability::MIN_VARIANCE,
                           BlockDensity::LINEAR));
    case INVERSION_BINARY:
      return std::make_unique<InversionSampler>(image, false);
    case INVERSION_GUIDED:
      return std::make_unique<InversionSampler>(image, true);
    case ALIAS:
      return std::make_unique<AliasSampler>(image);
    default:
      return std::make_unique<UniformSampler>();
  }
}

/// Independent numbers, more than the caches near the core hold, so that no call sequence is
/// learnt.
const std::vector<Vec3>& random_numbers() {
  static const std::vector<Vec3> numbers = [] {
    std::mt19937 generator(1);
    std::vector<Vec3> result(1 << 20);
    const auto next = [&] { return (float)(generator() >> 8) * 0x1p-24f; };
    for (Vec3& u : result) u = {next(), next(), next()};
    return result;
  }();
  return numbers;
}

void sample(benchmark::State& state, Method method, int width) {
  const auto sampler = make_sampler(method, map_of_width(width).view());
  const EnvSamplerView view = sampler->view();
  const std::vector<Vec3>& numbers = random_numbers();
  size_t i = 0;
  constexpr size_t kBatch = 4096;
  for (auto _ : state) {
    Vec3 sum = {0, 0, 0};
    float pdf = 0;
    for (size_t k = 0; k < kBatch; ++k) {
      const DirectionSample s = sample_environment(view, numbers[i + k]);
      sum += s.direction;
      pdf += s.pdf;
    }
    benchmark::DoNotOptimize(sum);
    benchmark::DoNotOptimize(pdf);
    i = (i + kBatch) & (numbers.size() - 1);
  }
  state.SetItemsProcessed((int64_t)state.iterations() * kBatch);
  state.counters["ns"] =
      benchmark::Counter((double)state.iterations() * kBatch * 1e-9,
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.counters["table_bytes"] = (double)sampler->nbytes();
}

/// Directions of the sampler itself and uniform ones in turn: what a renderer asks for.
void density(benchmark::State& state, Method method, int width) {
  const auto sampler = make_sampler(method, map_of_width(width).view());
  const EnvSamplerView view = sampler->view();
  const std::vector<Vec3>& numbers = random_numbers();
  std::vector<Vec3> directions(1 << 18);
  for (size_t i = 0; i < directions.size(); ++i) {
    directions[i] = i % 2 ? sample_environment(view, numbers[i]).direction
                          : sample_uniform_sphere(numbers[i]).direction;
  }
  size_t i = 0;
  constexpr size_t kBatch = 4096;
  for (auto _ : state) {
    float pdf = 0;
    for (size_t k = 0; k < kBatch; ++k) pdf += environment_pdf(view, directions[i + k]);
    benchmark::DoNotOptimize(pdf);
    i = (i + kBatch) & (directions.size() - 1);
  }
  state.counters["ns"] =
      benchmark::Counter((double)state.iterations() * kBatch * 1e-9,
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

template <typename Make>
void register_build(const std::string& name, int width, Make make) {
  benchmark::RegisterBenchmark(("build/" + name + "/" + std::to_string(width)).c_str(),
                               [=](benchmark::State& state) {
                                 const LatLongImage image = map_of_width(width).view();
                                 for (auto _ : state) benchmark::DoNotOptimize(make(image));
                               })
      ->MeasureProcessCPUTime()
      ->UseRealTime()
      ->Unit(benchmark::kMillisecond);
}

const bool registered = [] {
  for (int width : {1024, 2048, 4096, 8192}) {
    for (Method method : {KDTREE_FITTED, KDTREE_MIN_VARIANCE, KDTREE_LINEAR, INVERSION_BINARY,
                          INVERSION_GUIDED, ALIAS, UNIFORM}) {
      const std::string suffix = std::string(kNames[method]) + "/" + std::to_string(width);
      benchmark::RegisterBenchmark(("sample/" + suffix).c_str(), sample, method, width);
      benchmark::RegisterBenchmark(("pdf/" + suffix).c_str(), density, method, width);
    }
    const struct {
      const char* name;
      SplitCriterion criterion;
      BlockProbability probability;
    } trees[] = {
        {"kdtree_range_fitted", SplitCriterion::RANGE, BlockProbability::FITTED},
        {"kdtree_variance_fitted", SplitCriterion::VARIANCE, BlockProbability::FITTED},
        {"kdtree_sse_fitted", SplitCriterion::SSE, BlockProbability::FITTED},
        {"kdtree_min_variance", SplitCriterion::MIN_VARIANCE, BlockProbability::MIN_VARIANCE},
    };
    for (const auto& tree : trees) {
      const KdTreeConfig config = config_of(tree.criterion, tree.probability);
      register_build(tree.name, width, [config](const LatLongImage& image) {
        return std::make_unique<KdTreeSampler>(image, config);
      });
    }
    for (Method method : {KDTREE_LINEAR, INVERSION_BINARY, INVERSION_GUIDED, ALIAS}) {
      register_build(kNames[method], width,
                     [method](const LatLongImage& image) { return make_sampler(method, image); });
    }
  }
  return true;
}();

}  // namespace
}  // namespace skytree
