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
SamplePlan make_plan(const Value& value, int samples = kSamples) {
  SamplePlan plan(kWidth, kHeight, samples);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      for (int k = 0; k < plan.measured(); ++k) {
        const float v = value(x, y, k);
        plan.record(size_t(y) * kWidth + x, {{v, v, v}});
      }
    }
  }
  plan.share_out();
  return plan;
}

uint32_t samples_of(const SamplePlan& plan, int x, int y) {
  return plan.samples_at(size_t(y) * kWidth + x, kSamples);
}

/// Of the columns from x0 to x1.
double mean_samples(const SamplePlan& plan, int samples, int x0, int x1) {
  double sum = 0.0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = x0; x < x1; ++x) sum += plan.samples_at(size_t(y) * kWidth + x, samples);
  }
  return sum / (kHeight * (x1 - x0));
}

TEST(SamplePlan, GivesTheNoisyHalfMoreAndAllTogetherTheSameNumber) {
  for (const int samples : {4, 8, kSamples}) {
    // Deviations of 0.3 and 0.1 about a mean of 1.
    const SamplePlan plan = make_plan(
        [](int x, int, int k) {
          return 1.0f + (x < kWidth / 2 ? 0.3f : 0.1f) * (k % 2 ? 1.0f : -1.0f);
        },
        samples);
    EXPECT_NEAR(mean_samples(plan, samples, 0, kWidth) / samples, 1.0, 0.01);
    // Of twice the mean for two pixels in the ratio 9^0.4 to 1, but no fewer than are measured.
    const double share = std::pow(9.0, 0.4) / (1.0 + std::pow(9.0, 0.4));
    const double calm = std::max((1.0 - share) * 2.0, double(plan.measured()) / samples);
    EXPECT_NEAR(mean_samples(plan, samples, 0, 13) / samples, 2.0 - calm, 0.03);
    EXPECT_NEAR(mean_samples(plan, samples, 19, kWidth) / samples, calm, 0.03);
  }
}

TEST(SamplePlan, TwoMeasuredSamplesAreTrustedLessThanSixteen) {
  for (const int samples : {4, kSamples}) {
    const SamplePlan plan = make_plan(
        [](int x, int y, int k) {
          return 1.0f + (x / 6 == 2 && y / 6 == 2 ? 0.5f : 0.0f) * (k % 2 ? 1.0f : -1.0f);
        },
        samples);
    const int limit = (samples == 4 ? 4 : 8) * samples;
    EXPECT_EQ(plan.samples_at(size_t(14) * kWidth + 14, samples), uint32_t(limit));
  }
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
  EXPECT_NEAR(samples_of(plan, 15, 12), elsewhere, 8);  // by chance up or down by a step
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

/// What pays after samples of deviation 1 whose light rays' halves differ by `difference`.
int light_rays_that_pay(int measured_rays, float difference, double later_rays) {
  SamplePlan plan(kWidth, kHeight, kSamples);
  for (size_t pixel = 0; pixel < size_t(kWidth) * kHeight; ++pixel) {
    for (int k = 0; k < plan.measured(); ++k) {
      const float v = k % 2 ? 0.0f : 2.0f, d = k % 4 < 2 ? difference : -difference;
      plan.record(pixel, {{v, v, v}, measured_rays, {d, d, d}});
    }
  }
  plan.share_out();
  return plan.light_rays_that_pay(measured_rays, later_rays);
}

TEST(SamplePlan, TakesAsManyLightRaysAsPay) {
  // All noise is that of the light rays, or none of it.
  for (const int measured_rays : {2, 4}) {
    EXPECT_EQ(light_rays_that_pay(measured_rays, 1.0f, 1.0), 4);
    EXPECT_EQ(light_rays_that_pay(measured_rays, 0.0f, 0.0), 1);
  }
  // A third of it: worth more rays only if the rest of the path is dear.
  EXPECT_EQ(light_rays_that_pay(2, std::sqrt(0.3f), 0.0), 1);
  EXPECT_EQ(light_rays_that_pay(2, std::sqrt(0.3f), 1.0), 2);
  EXPECT_EQ(light_rays_that_pay(2, std::sqrt(0.3f), 20.0), 4);
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

/// The spheres under a sky with a sun; constant blocks have noise of their own.
std::shared_ptr<Scene> make_lit_spheres(BlockDensity density = BlockDensity::CONSTANT) {
  EnvironmentInput environment;
  environment.texels = share(make_sky(256, 128));
  environment.width = 256;
  environment.height = 128;
  KdTreeConfig config;
  config.block_density = density;
  if (density == BlockDensity::LINEAR) {
    config.split_criterion = SplitCriterion::MIN_VARIANCE;
    config.block_probability = BlockProbability::MIN_VARIANCE;
  }
  environment.sampler =
      std::make_shared<KdTreeSampler>(LatLongImage{environment.texels.get(), 256, 128}, config);
  auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(environment);
  return scene;
}

double mean_of(const std::vector<float>& image) {
  double sum = 0.0;
  for (size_t i = 0; i < image.size(); ++i) sum += i % 4 == 3 ? 0.0 : image[i];
  return sum / (0.75 * double(image.size()));
}

/// Sum of squared differences, and of rays, of some seeds.
struct Errors {
  double squared = 0.0, rays = 0.0;
};

Errors errors_of(const std::shared_ptr<Scene>& scene, const std::vector<float>& reference,
                 bool adaptive, int samples, uint32_t seeds) {
  Errors errors;
  for (uint32_t seed = 0; seed < seeds; ++seed) {
    SessionStats stats;
    const std::vector<float> image = render(scene, options_of(adaptive, seed, samples), 0, &stats);
    for (size_t i = 0; i < image.size(); ++i) {
      errors.squared += std::pow(image[i] - reference[i], 2);
    }
    errors.rays += double(stats.rays);
  }
  return errors;
}

TEST(AdaptiveSampling, LowersTheErrorOfAsManySamples) {
  const auto scene = make_lit_spheres();
  const std::vector<float> reference = render(scene, options_of(false, 9, 768));
  for (const int samples : {4, 8, 32}) {
    const uint32_t seeds = 128 / samples;
    const Errors even = errors_of(scene, reference, false, samples, seeds);
    const Errors adaptive = errors_of(scene, reference, true, samples, seeds);
    EXPECT_LT(adaptive.squared, 0.9 * even.squared) << samples;
    EXPECT_LT(adaptive.rays, 1.35 * even.rays);  // surfaces need more rays than the sky does
  }
}

/// Over many seeds: pixels that stopped where their own samples happen to be alike would be seen.
TEST(AdaptiveSampling, KeepsTheMean) {
  const auto scene = make_lit_spheres(BlockDensity::LINEAR);
  const double even = mean_of(render(scene, options_of(false, 77, 1024)));
  for (const int samples : {4, 32}) {
    const uint32_t seeds = 512 / samples;
    double mean = 0.0;
    for (uint32_t seed = 0; seed < seeds; ++seed) {
      mean += mean_of(render(scene, options_of(true, seed, samples))) / seeds;
    }
    EXPECT_NEAR(mean / even, 1.0, 1e-3) << samples;
  }
}

TEST(AdaptiveSampling, ThreadsChangeNoBit) {
  const auto scene = make_lit_spheres();
  for (const int light_rays : {1, 0}) {
    RenderOptions options = options_of(true);
    options.light_rays = light_rays;
    options.max_bounces = 1;
    SessionStats stats;
    const std::vector<float> one = render(scene, options, 1, &stats);
    EXPECT_EQ(stats.light_rays, light_rays ? 1 : 4);  // 2 at first
    EXPECT_EQ(one, render(scene, options, 2));
    EXPECT_EQ(one, render(scene, options, 7));
    options.adaptive_sampling = false;
    EXPECT_NE(one, render(scene, options, 2));
  }
}

/// Gives the scene's balls and ground these materials.
void set_materials(Scene* scene, const Closure& ball, const Closure& ground) {
  for (int material = 0; material < 4; ++material) {
    scene->set_material(material, {material < 3 ? ball : ground});
  }
}

/// Light rays of the last samples, after 4 with `max_bounces` 0 and else 2.
int light_rays_on(const Closure& ball, const Closure& ground, int max_bounces) {
  const auto scene = make_lit_spheres(BlockDensity::LINEAR);
  set_materials(scene.get(), ball, ground);
  RenderOptions options = options_of(true);
  options.light_rays = 0;
  options.max_bounces = max_bounces;
  SessionStats stats;
  render(scene, options, 0, &stats);
  return stats.light_rays;
}

TEST(AdaptiveSampling, TakesAsManyLightRaysAsPay) {
  Closure rough = diffuse(0.5f);
  rough.roughness = 0.5f;  // shaded vertex by vertex, not in lanes
  const Closure shiny = glossy(0.9f, 0.2f);
  for (const int max_bounces : {0, 3}) {
    EXPECT_EQ(light_rays_on(diffuse(0.5f), diffuse(0.5f), max_bounces), 4);
    EXPECT_EQ(light_rays_on(rough, rough, max_bounces), 4);
    EXPECT_LE(light_rays_on(shiny, shiny, max_bounces), 2);
  }
  EXPECT_EQ(light_rays_on(shiny, shiny, 3), 1);
}

/// The samples of before and after a change of the light rays.
TEST(AdaptiveSampling, KeepsTheMeanAsLightRaysChange) {
  const auto scene = make_lit_spheres(BlockDensity::LINEAR);
  set_materials(scene.get(), glossy(0.9f, 0.2f), glossy(0.9f, 0.3f));
  RenderOptions options = options_of(false, 77, 1024);
  options.light_rays = 4;
  const double even = mean_of(render(scene, options));
  double mean = 0.0;
  const uint32_t seeds = 128;
  for (uint32_t seed = 0; seed < seeds; ++seed) {
    options = options_of(true, seed, 16);
    options.light_rays = 0;
    SessionStats stats;
    mean += mean_of(render(scene, options, 0, &stats)) / seeds;
    EXPECT_LT(stats.light_rays, 4);
  }
  EXPECT_NEAR(mean / even, 1.0, 2e-3);  // four standard errors
}

TEST(AdaptiveSampling, FewSamplesAreSpreadEvenly) {
  const auto scene = make_lit_spheres();
  const int samples = SamplePlan::kLeastSamples - 1;
  EXPECT_EQ(render(scene, options_of(true, 0, samples)),
            render(scene, options_of(false, 0, samples)));
}

}  // namespace
}  // namespace skytree
