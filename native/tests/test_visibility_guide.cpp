// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "src/kdtree_sampler.h"
#include "src/visibility_guide.h"
#include "tests/exact_references.h"

namespace skytree {
namespace {

constexpr int kWidth = 256, kHeight = 128;

std::shared_ptr<const KdTreeSampler> make_sampler(const std::vector<float>& sky, bool linear) {
  KdTreeConfig config;
  config.block_count = 512;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  config.block_density = linear ? BlockDensity::LINEAR : BlockDensity::CONSTANT;
  return std::make_shared<KdTreeSampler>(LatLongImage{sky.data(), kWidth, kHeight}, config);
}

void light(const std::shared_ptr<Scene>& scene,
           const std::vector<float>& sky = make_sky(kWidth, kHeight)) {
  EnvironmentInput environment;
  environment.sampler = make_sampler(sky, true);
  environment.texels = share(sky);
  environment.width = kWidth;
  environment.height = kHeight;
  scene->set_environment(environment);
}

RenderOptions room_options(int samples, uint32_t seed, bool learn) {
  RenderOptions options;
  options.width = 64;
  options.height = 48;
  options.max_bounces = 1;
  options.samples = samples;
  options.seed = seed;
  options.learn_visibility = learn;
  return options;
}

double mean_of(const std::vector<float>& image) {
  double sum = 0;
  for (size_t i = 0; i < image.size(); i += 4) sum += image[i];
  return 4.0 * sum / double(image.size());
}

/// Mean squared error without the worst hundredth: single bright paths would decide it.
double error_of(const std::vector<float>& image, const std::vector<float>& reference) {
  std::vector<double> errors;
  for (size_t i = 0; i < image.size(); i += 4) {
    errors.push_back(std::pow(image[i] - reference[i], 2));
  }
  std::sort(errors.begin(), errors.end());
  const size_t kept = errors.size() * 99 / 100;
  double sum = 0;
  for (size_t i = 0; i < kept; ++i) sum += errors[i];
  return sum / double(kept);
}

class WarpPoint : public ::testing::TestWithParam<bool> {};

TEST_P(WarpPoint, IsWhereTheDirectionCameFrom) {
  const std::vector<float> sky = make_sky(kWidth, kHeight);
  const auto sampler = make_sampler(sky, GetParam());
  const EnvSamplerView view = sampler->view();
  ASSERT_TRUE(has_warp(view));
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform;
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    const Vec3 u = {0.5f, uniform(random), uniform(random)};
    const Vec2 point = warp_point(view, sample_environment(view, u).direction);
    worst = std::max({worst, std::fabs(double(point.x - u.y)), std::fabs(double(point.y - u.z))});
  }
  // Blocks of a few texels are a few thousand float steps of a direction wide.
  EXPECT_LT(worst, 2e-3);
}

INSTANTIATE_TEST_SUITE_P(Densities, WarpPoint, ::testing::Bool());

/// A slot of surfaces that face up, where most of the light comes from.
constexpr uint32_t kSlot = 4, kOtherSlot = 12;

/// A guide that has learnt: kSlot saw light in a tenth of the square only.
struct Learnt {
  std::vector<float> sky = make_sky(kWidth, kHeight);
  std::shared_ptr<const KdTreeSampler> sampler = make_sampler(sky, true);
  VisibilityGuide guide{sampler->view(), identity3(), {0, 0, 0}};

  Learnt() {
    std::mt19937 random(2);
    std::uniform_real_distribution<float> uniform;
    for (int i = 0; i < 20000; ++i) {
      const Vec2 point = {uniform(random), uniform(random)};
      const int32_t region = guide_region(guide.view(), point);
      guide_commit(guide.view(), guide_record(kSlot, region, 0.7f), point.x < 0.1f);
    }
    guide.update();
  }
};

TEST(VisibilityGuide, DrawsWithTheDensityThatItTells) {
  Learnt learnt;
  const GuideView guide = learnt.guide.view();
  ASSERT_TRUE(guide.used[kSlot]);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform;
  constexpr int kSamples = 400000, kCells = 8;
  double counted[kCells][kCells] = {}, expected[kCells][kCells] = {};
  int other_region = 0;
  double in_lit_part = 0;
  for (int i = 0; i < kSamples; ++i) {
    const GuidedPoint drawn = guide_warp(guide, kSlot, {uniform(random), uniform(random)});
    counted[int(drawn.point.y * kCells)][int(drawn.point.x * kCells)] += 1.0 / kSamples;
    other_region += guide_region(guide, drawn.point) != drawn.region;
    in_lit_part += drawn.point.x < 0.1f;
    const Vec2 even = {uniform(random), uniform(random)};
    expected[int(even.y * kCells)][int(even.x * kCells)] +=
        double(guide_density(guide, kSlot, even)) / kSamples;
  }
  for (int y = 0; y < kCells; ++y) {
    for (int x = 0; x < kCells; ++x) {
      EXPECT_NEAR(counted[y][x], expected[y][x], 0.002 + 0.03 * expected[y][x]) << x << ' ' << y;
    }
  }
  EXPECT_LT(other_region, kSamples / 10000);  // rounding at the regions' borders
  EXPECT_GT(in_lit_part, 0.2 * kSamples);     // a tenth before; regions reach across its border
}

TEST(VisibilityGuide, WhatIsHiddenStaysPossible) {
  Learnt learnt;
  const GuideView guide = learnt.guide.view();
  float least = 1.0f;
  std::mt19937 random(6);
  std::uniform_real_distribution<float> uniform;
  for (int i = 0; i < 20000; ++i) {
    least = std::min(least, guide_density(guide, kSlot, {uniform(random), uniform(random)}));
  }
  EXPECT_GT(least, 0.1f);
}

TEST(VisibilityGuide, AnOpenPlaceIsLeftAlone) {
  Learnt learnt;
  const GuideView guide = learnt.guide.view();
  std::mt19937 random(4);
  std::uniform_real_distribution<float> uniform;
  for (int i = 0; i < 20000; ++i) {
    const int32_t region = guide_region(guide, {uniform(random), uniform(random)});
    guide_commit(guide, guide_record(kOtherSlot, region, 0.7f), uniform(random) < 0.8f);
  }
  learnt.guide.update();
  EXPECT_FALSE(guide.used[kOtherSlot]);
  EXPECT_TRUE(guide.used[kSlot]);
}

/// What lies behind a surface is no reason to guide its samples.
TEST(VisibilityGuide, AnOpenPlaceThatFacesAwayFromTheLightIsLeftAlone) {
  Learnt learnt;
  const GuideView guide = learnt.guide.view();
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform;
  for (uint32_t side = 0; side < kGuideSides; ++side) {
    const float axis[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    for (int i = 0; i < 20000; ++i) {
      const Vec2 point = {uniform(random), uniform(random)};
      const Vec3 direction =
          sample_environment(learnt.sampler->view(), {0.5f, point.x, point.y}).direction;
      const float cosine = dot({axis[side][0], axis[side][1], axis[side][2]}, direction);
      const uint32_t record =
          guide_record(16 + side, guide_region(guide, point), std::max(cosine, 0.0f));
      guide_commit(guide, record, cosine > 0.0f);
    }
  }
  learnt.guide.update();
  for (uint32_t side = 0; side < kGuideSides; ++side) EXPECT_FALSE(guide.used[16 + side]) << side;
}

TEST(VisibilityGuide, StaysWithin64Megabytes) {
  EXPECT_LT(Learnt().guide.nbytes(), size_t(64) << 20);
}

TEST(VisibilityGuide, RoomsGetCleanerAndKeepTheirMean) {
  const auto scene = make_room_scene(false);
  light(scene);
  const auto reference = render(scene, room_options(2048, 99, false));
  const auto plain = render(scene, room_options(64, 1, false));
  const auto learnt = render(scene, room_options(64, 1, true));
  EXPECT_LT(error_of(learnt, reference), 0.5 * error_of(plain, reference));
  const auto long_learnt = render(scene, room_options(1024, 7, true));
  EXPECT_NEAR(mean_of(long_learnt) / mean_of(reference), 1.0, 0.01);  // noise of the reference
}

/// Many short renders, as what is learnt early is the least reliable.
TEST(VisibilityGuide, KeepsTheMeanOfAnIntegratingSphere) {
  const std::vector<float> sky = testing::make_soft_sky(kWidth, kHeight);
  EnvironmentInput environment;
  environment.sampler = make_sampler(sky, true);
  environment.texels = share(sky);
  environment.width = kWidth;
  environment.height = kHeight;
  const float s = 0.6f, c = 0.8f;  // the bright part of the sky above the hole
  environment.world_to_env = {{{c, 0, s}, {0, 1, 0}, {-s, 0, c}}};
  const testing::IntegratingSphere sphere(50, environment);
  for (const int bounces : {0, 1}) {
    RenderOptions options = room_options(64, 0, true);
    options.max_bounces = bounces;
    const std::vector<testing::Rgb> reference =
        sphere.pixels(options.width, options.height, bounces);
    double mean = 0, errors[2] = {0, 0};
    constexpr int kRenders = 20;
    for (int i = 0; i < kRenders; ++i) {
      options.seed = 100 + i;
      for (const bool learn : {false, true}) {
        if (!learn && i > 0) continue;
        options.learn_visibility = learn;
        const std::vector<float> image = render(sphere.scene, options);
        if (learn) mean += testing::mean_rgb(image).g / kRenders;
        if (i > 0) continue;
        for (size_t p = 0; p < reference.size(); ++p) {
          errors[learn] += std::pow(image[4 * p + 1] - reference[p].g, 2);
        }
      }
    }
    EXPECT_NEAR(mean / testing::mean_rgb(reference).g, 1.0, 0.001) << bounces;
    EXPECT_LT(errors[1], 0.6 * errors[0]) << "hardly guided, " << bounces;
  }
}

TEST(VisibilityGuide, SameBitsForAnyNumberOfThreads) {
  const auto scene = make_room_scene(false);
  light(scene);
  const RenderOptions options = room_options(24, 5, true);
  const auto learnt = render(scene, options, 1);
  EXPECT_EQ(learnt, render(scene, options, 3));
  EXPECT_NE(learnt, render(scene, room_options(24, 5, false)));
}

TEST(VisibilityGuide, FewSamplesDoNotLearn) {
  const auto scene = make_room_scene(false);
  light(scene);
  EXPECT_EQ(render(scene, room_options(15, 3, true)), render(scene, room_options(15, 3, false)));
  EXPECT_NE(render(scene, room_options(16, 3, true)), render(scene, room_options(16, 3, false)));
}

TEST(VisibilityGuide, OpenScenesKeepTheirBits) {
  const auto scene = make_room_scene(true);
  light(scene);
  EXPECT_EQ(render(scene, room_options(16, 3, true)), render(scene, room_options(16, 3, false)));
}

}  // namespace
}  // namespace skytree
