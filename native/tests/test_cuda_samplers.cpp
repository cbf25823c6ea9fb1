// SPDX-License-Identifier: GPL-3.0-or-later
// Samplers on the device against the host: the same bits, because both compile the same headers
// without contraction.
#include <cstring>
#include <functional>
#include <memory>
#include <random>

#include "cuda/device_sampler.h"
#include "cuda/kernel_parameters.h"
#include "cuda/sampler_timing.h"
#include "cuda_test_support.h"
#include "kernel/draw_samples.h"
#include "src/alias_sampler.h"
#include "src/hierarchy_sampler.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"

namespace skytree::cuda {
namespace {

struct TestMap {
  std::string name;
  std::vector<float> texels;
  int width, height;
  LatLongImage view() const { return {texels.data(), width, height}; }
};

TestMap make_map(const std::string& name, int width, int height,
                 const std::function<float(int, int, std::mt19937&)>& texel) {
  TestMap map = {name, {}, width, height};
  std::mt19937 random(7);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float value = texel(x, y, random);
      for (const float channel : {value, 0.5f * value, 0.25f * value})
        map.texels.push_back(channel);
    }
  }
  return map;
}

std::vector<TestMap> test_maps() {
  return {make_map("noise with a sun", 128, 64,
                   [](int x, int y, std::mt19937& r) {
                     return (x == 40 && y == 12 ? 5e4f : 0.0f) + float(r() % 1000) / 500.0f;
                   }),
          make_map("one texel at the pole", 16, 8,
                   [](int x, int y, std::mt19937&) { return x == 0 && y == 0 ? 1.0f : 0.0f; }),
          make_map("1x1", 1, 1, [](int, int, std::mt19937&) { return 3.0f; }),
          make_map("3x2", 3, 2, [](int x, int y, std::mt19937&) { return float(1 + x + 3 * y); }),
          make_map("black", 8, 4, [](int, int, std::mt19937&) { return 0.0f; })};
}

std::vector<std::pair<std::string, std::shared_ptr<const EnvironmentSampler>>> samplers(
    const TestMap& map) {
  KdTreeConfig fitted;
  fitted.block_count = 256;
  KdTreeConfig warped = fitted;
  warped.split_criterion = SplitCriterion::MIN_VARIANCE;
  warped.block_probability = BlockProbability::MIN_VARIANCE;
  KdTreeConfig linear = warped;
  linear.compensation = 1.0;
  warped.block_density = BlockDensity::CONSTANT;
  return {{"kd-tree fitted", std::make_shared<KdTreeSampler>(map.view(), fitted)},
          {"kd-tree warp", std::make_shared<KdTreeSampler>(map.view(), warped)},
          {"kd-tree linear", std::make_shared<KdTreeSampler>(map.view(), linear)},
          {"inversion guided", std::make_shared<InversionSampler>(map.view(), true)},
          {"inversion binary", std::make_shared<InversionSampler>(map.view(), false)},
          {"alias", std::make_shared<AliasSampler>(map.view())},
          {"hierarchy", std::make_shared<HierarchySampler>(map.view())},
          {"uniform", std::make_shared<UniformSampler>()}};
}

/// Random numbers with the ends of [0,1) among them.
std::vector<Vec3> random_numbers(size_t count) {
  std::mt19937 random(1);
  auto number = [&] {
    switch (random() % 16) {
      case 0:
        return 0.0f;
      case 1:
        return kOneMinusEpsilon;
      default:
        return float(random() >> 8) / 16777216.0f;
    }
  };
  std::vector<Vec3> u(count);
  for (Vec3& v : u) v = {number(), number(), number()};
  return u;
}

unsigned blocks_for(size_t count) { return unsigned((count + kThreads - 1) / kThreads); }

TEST_F(CudaTest, SamplersAndDensitiesAreTheHostsToTheLastBit) {
  const ContextPointer context = Context::acquire(0);
  const Stream stream(context);
  const std::vector<Vec3> u = random_numbers(20000);
  const Buffer device_u(context, u.data(), u.size() * sizeof(Vec3));
  const Buffer device_samples(context, u.size() * sizeof(DirectionSample));
  const Buffer device_pdf(context, u.size() * sizeof(float));
  for (const TestMap& map : test_maps()) {
    for (const auto& [name, sampler] : samplers(map)) {
      SCOPED_TRACE(map.name + ", " + name);
      const EnvSamplerView host = sampler->view();
      const DeviceSampler device(context, host);

      launch(*context, stream, "sample_directions", blocks_for(u.size()), kThreads,
             SampleParameters{device.view(), device_u.as<Vec3>(),
                              const_cast<DirectionSample*>(device_samples.as<DirectionSample>()),
                              uint32_t(u.size())});
      stream.synchronize();
      std::vector<DirectionSample> samples(u.size());
      device_samples.download(samples.data(), samples.size() * sizeof(DirectionSample));
      std::vector<Vec3> directions(u.size());
      size_t different = 0;
      for (size_t i = 0; i < u.size(); ++i) {
        const DirectionSample expected = sample_environment(host, u[i]);
        different += std::memcmp(&expected, &samples[i], sizeof expected) != 0;
        // Half of them arbitrary directions: pdf must agree where nothing was sampled, too.
        directions[i] = i % 2 ? expected.direction : sample_uniform_sphere(u[i]).direction;
      }
      EXPECT_EQ(different, 0u) << "of " << u.size() << " samples";

      const Buffer device_directions(context, directions.data(), directions.size() * sizeof(Vec3));
      launch(*context, stream, "evaluate_pdf", blocks_for(u.size()), kThreads,
             PdfParameters{device.view(), device_directions.as<Vec3>(),
                           const_cast<float*>(device_pdf.as<float>()), uint32_t(u.size())});
      stream.synchronize();
      std::vector<float> pdf(u.size());
      device_pdf.download(pdf.data(), pdf.size() * sizeof(float));
      different = 0;
      for (size_t i = 0; i < u.size(); ++i) {
        const float expected = environment_pdf(host, directions[i]);
        different += std::memcmp(&expected, &pdf[i], sizeof expected) != 0;
      }
      EXPECT_EQ(different, 0u) << "of " << u.size() << " densities";
    }
  }
}

TEST_F(CudaTest, TheMicrobenchmarkDrawsWhatItTimes) {
  const TestMap map = test_maps()[0];
  for (const auto& [name, sampler] : samplers(map)) {
    SCOPED_TRACE(name);
    const SamplerTiming timing = time_sampler(0, sampler->view(), 300, 16, 2);
    ASSERT_EQ(timing.seconds.size(), 2u);
    EXPECT_GT(timing.seconds[1], 0.0);
    size_t different = 0;
    for (uint32_t i = 0; i < 300; ++i) {
      different += draw_samples(sampler->view(), i, 16) != timing.sums[i];
    }
    EXPECT_EQ(different, 0u) << "of 300 threads";
  }
}

}  // namespace
}  // namespace skytree::cuda
