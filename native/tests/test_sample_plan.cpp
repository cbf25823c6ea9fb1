// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>

#include "src/kdtree_sampler.h"
#include "src/sample_plan.h"
#include "tests/render_scenes.h"

namespace skytree {
namespace {

constexpr int kWidth = 32, kHeight = 24, kSamples = 64;

/// A plan whose measured samples are value(x, y, k).
template <class Value>
SamplePlan make_plan(const Value& value) {
  SamplePlan plan(kWidth, kHeight, kSamples);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      for (int k = 0; k < plan.measured(); ++k) {
        const float v = value(x, y, k);
        plan.record(size_t(y) * kWidth + x, {v, v, v});
      }
    }
  }
  plan.share_out();
  return plan;
}

uint32_t samples_of(const SamplePlan& plan, int x, int y) {
  return plan.samples_at(size_t(y) * kWidth + x, kSamples);
}

TEST(SamplePlan, GivesTheNoisyHalfMoreAndAllTogetherTheSameNumber) {
  // Deviations of 0.3 and 0.1 about a mean of 1.
  const SamplePlan plan = make_plan([](int x, int, int k) {
    return 1.0f + (x < kWidth / 2 ? 0.3f : 0.1f) * (k % 2 ? 1.0f : -1.0f);
  });
  double total = 0.0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) total += samples_of(plan, x, y);
  }
  EXPECT_NEAR(total / (kWidth * kHeight), kSamples, 0.1);
  EXPECT_NEAR(samples_of(plan, 4, 10), 96, 1);  // of 128 for two pixels in the ratio 3 to 1
  EXPECT_NEAR(samples_of(plan, 28, 10), 32, 1);
}

TEST(SamplePlan, EveryPixelHasTheMeasuredSamples) {
  const SamplePlan plan = make_plan(
      [](int x, int, int k) { return 1.0f + (x == 3 ? 0.5f : 0.0f) * (k % 2 ? 1.0f : -1.0f); });
  EXPECT_EQ(samples_of(plan, 20, 5), uint32_t(plan.measured()));
  EXPECT_GT(samples_of(plan, 2, 5), uint32_t(kSamples));
}

TEST(SamplePlan, APixelsOwnSamplesHaveNoPartInIt) {
  // One pixel alone is noisy: its neighbours are looked at more closely, it itself is not.
  const SamplePlan plan = make_plan([](int x, int y, int k) {
    return 1.0f + (x == 15 && y == 12 && k == 0 ? 5.0f : 0.1f * float(k % 2));
  });
  const uint32_t elsewhere = samples_of(plan, 3, 3);
  EXPECT_GT(samples_of(plan, 14, 12), 2 * elsewhere);
  EXPECT_NEAR(samples_of(plan, 15, 12), elsewhere, 1);
}

TEST(SamplePlan, NoiselessPicturesAreSampledEvenly) {
  const SamplePlan plan = make_plan([](int, int, int) { return 0.5f; });
  EXPECT_EQ(samples_of(plan, 0, 0), uint32_t(kSamples));
  EXPECT_EQ(samples_of(plan, 31, 23), uint32_t(kSamples));
}

TEST(SamplePlan, SamplesGrowSteadilyToTheirNumber) {
  const SamplePlan plan =
      make_plan([](int x, int, int k) { return 1.0f + 0.01f * float(x) * float(k % 2); });
  for (size_t pixel : {0, 17, 31}) {
    uint32_t before = 0;
    for (int done = 0; done <= kSamples; ++done) {
      const uint32_t now = plan.samples_at(pixel, done);
      EXPECT_GE(now, before);
      if (done <= plan.measured()) {
        EXPECT_EQ(now, uint32_t(done));
      }
      before = now;
    }
  }
}

RenderOptions options_of(bool adaptive, uint32_t seed = 0, int samples = 32) {
  RenderOptions options;
  options.width = 96;
  options.height = 72;
  options.samples = samples;
  options.max_bounces = 0;
  options.seed = seed;
  options.adaptive_sampling = adaptive;
  return options;
}

/// The spheres under a sky with a sun; with a kd-tree of constant blocks it has noise of its own.
std::shared_ptr<Scene> make_lit_spheres() {
  EnvironmentInput environment;
  environment.texels = share(make_sky(256, 128));
  environment.width = 256;
  environment.height = 128;
  environment.sampler =
      std::make_shared<KdTreeSampler>(LatLongImage{environment.texels.get(), 256, 128});
  auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(environment);
  return scene;
}

double mean_of(const std::vector<float>& image) {
  double sum = 0.0;
  for (size_t i = 0; i < image.size(); ++i) sum += i % 4 == 3 ? 0.0 : image[i];
  return sum / (0.75 * double(image.size()));
}

TEST(AdaptiveSampling, LowersTheErrorOfAsManySamples) {
  const auto scene = make_lit_spheres();
  const std::vector<float> reference = render(scene, options_of(false, 9, 768));
  double errors[2] = {0.0, 0.0};
  uint64_t rays[2] = {0, 0};
  for (const bool adaptive : {false, true}) {
    for (uint32_t seed = 0; seed < 4; ++seed) {
      SessionStats stats;
      const std::vector<float> image = render(scene, options_of(adaptive, seed), 0, &stats);
      for (size_t i = 0; i < image.size(); ++i) {
        errors[adaptive] += std::pow(image[i] - reference[i], 2);
      }
      rays[adaptive] += stats.rays;
    }
  }
  EXPECT_LT(errors[1], 0.9 * errors[0]);
  EXPECT_LT(double(rays[1]), 1.35 * double(rays[0]));  // surfaces need more rays than the sky does
}

TEST(AdaptiveSampling, KeepsTheMean) {
  const auto scene = make_lit_spheres();
  double means[2] = {0.0, 0.0};
  for (const bool adaptive : {false, true}) {
    for (uint32_t seed = 0; seed < 24; ++seed) {
      means[adaptive] += mean_of(render(scene, options_of(adaptive, seed))) / 24.0;
    }
  }
  EXPECT_NEAR(means[1] / means[0], 1.0, 1e-3);
}

TEST(AdaptiveSampling, ThreadsChangeNoBit) {
  const auto scene = make_lit_spheres();
  const std::vector<float> one = render(scene, options_of(true), 1);
  EXPECT_EQ(one, render(scene, options_of(true), 2));
  EXPECT_EQ(one, render(scene, options_of(true), 7));
  EXPECT_NE(one, render(scene, options_of(false), 2));
}

TEST(AdaptiveSampling, FewSamplesAreSpreadEvenly) {
  const auto scene = make_lit_spheres();
  const int samples = SamplePlan::kLeastSamples - 1;
  EXPECT_EQ(render(scene, options_of(true, 0, samples)),
            render(scene, options_of(false, 0, samples)));
}

}  // namespace
}  // namespace skytree
