// SPDX-License-Identifier: GPL-3.0-or-later
// Methods of the related work: median cut, harmonics, the filtered chain, and what the renderer
// does with the chain and with resampling. Their sampling is tested with the other samplers' in
// test_samplers.cpp.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "src/diffuse_moments.h"
#include "src/filtered_map.h"
#include "src/harmonics.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"
#include "src/median_cut.h"
#include "tests/render_scenes.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

/// The map's power, the integral of radiance over the sphere, with constant texels.
double power_of(const LatLongImage& image) {
  const std::vector<double> solid_angles = row_solid_angles(image.width, image.height);
  double sum = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) sum += texel(image, x, y).x * solid_angles[y];
  }
  return sum;
}

TEST(MedianCut, PowersOfTwoAreRegionsOfEqualPower) {
  Map map(256, 128);
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 256; ++x) map.set(x, y, 1.0f + testing::value_noise(x, y, 32, 256));
  }
  KdTreeConfig config;
  config.block_count = 64;
  config.split_criterion = SplitCriterion::MEDIAN_CUT;
  config.block_probability = BlockProbability::EXACT;
  const KdTreeSampler sampler(map.view(), config);
  ASSERT_EQ(sampler.block_count(), 64);
  for (const double share : sampler.empirical()) EXPECT_NEAR(share * 64, 1.0, 0.12);
  // Longer sides are cut: no region is a sliver.
  for (const TexelRect& rect : sampler.rects()) {
    const double middle = M_PI * 0.5 * (rect.lo[1] + rect.hi[1]) / 128;
    const double across = 2 * rect.size(0) / 256.0 * std::sin(middle), down = rect.size(1) / 128.0;
    EXPECT_LT(std::max(across / down, down / across), 6.0);
  }
}

TEST(MedianCut, ASunIsCutOutAndBlackStaysWhole) {
  Map map(64, 32, 0.0f);
  map.set(40, 10, 1000.0f);
  KdTreeConfig config;
  config.split_criterion = SplitCriterion::MEDIAN_CUT;
  config.statistics = Statistics::PIXELS;
  config.block_count = 256;
  const KdTreeSampler sampler(map.view(), config);
  // One texel of light: each cut takes a dark part away until the texel alone is left.
  EXPECT_GE(sampler.block_count(), 5);
  EXPECT_LE(sampler.block_count(), 12);
  EXPECT_EQ(KdTreeSampler(Map(64, 32, 0.0f).view(), config).block_count(), 1);
}

TEST(MedianCut, PointLightsHaveTheMapsPower) {
  const Map map = testing::make_outdoor_map(96, 48);
  KdTreeConfig config;
  config.block_count = 128;
  config.split_criterion = SplitCriterion::MEDIAN_CUT;
  const KdTreeSampler sampler(map.view(), config);
  double power = 0, irradiance = 0, expected = 0;
  for (const PointLight& light : make_point_lights(map.view(), sampler.rects())) {
    EXPECT_NEAR(length(light.direction), 1.0f, 1e-5f);
    power += light.power.x;
    irradiance += light.power.x * std::max(light.direction.z, 0.0f);
  }
  EXPECT_NEAR(power / power_of(map.view()), 1.0, 1e-6);
  const std::vector<double> solid_angles = row_solid_angles(96, 48);
  for (int y = 0; y < 24; ++y) {
    for (int x = 0; x < 96; ++x) {
      expected += texel(map.view(), x, y).x * solid_angles[y] * std::cos(M_PI * (y + 0.5) / 48);
    }
  }
  EXPECT_NEAR(irradiance / expected, 1.0, 0.02);
}

TEST(Harmonics, ConstantAndLinearMapsAreExact) {
  const auto constant = harmonic_coefficients(Map(7, 3, 2.0f).view());
  for (const Vec3 n : {Vec3{0, 0, 1}, Vec3{1, 0, 0}, normalize({1, -2, 0.5f})}) {
    EXPECT_NEAR(harmonic_irradiance(constant, n).y, 2 * M_PI, 1e-5);
  }
  // L = 1 + w.a has irradiance pi + (2 pi / 3) n.a.
  const Vec3 a = {0.3f, -0.5f, 0.4f};
  Map map(512, 256);
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 512; ++x) {
      map.set(x, y, 1.0f + dot(a, latlong_direction((x + 0.5f) / 512, (y + 0.5f) / 256)));
    }
  }
  const auto linear = harmonic_coefficients(map.view());
  for (const Vec3 n : {Vec3{0, 0, -1}, Vec3{0, 1, 0}, normalize({-1, 2, 0.5f})}) {
    EXPECT_NEAR(harmonic_irradiance(linear, n).x, M_PI + 2 * M_PI / 3 * dot(n, a), 1e-3);
  }
}

TEST(Harmonics, FollowTheIrradianceOfAMapWithoutSuns) {
  Map map(128, 64);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 128; ++x) {
      map.set(x, y, (y < 32 ? 1.0f : 0.2f) + testing::value_noise(x, y, 16, 128));
    }
  }
  const auto coefficients = harmonic_coefficients(map.view());
  const std::vector<double> solid_angles = row_solid_angles(128, 64);
  for (const Vec3 n : {Vec3{0, 0, 1}, Vec3{1, 0, 0}, Vec3{0, -1, 0}, Vec3{0, 0, -1}}) {
    double exact = 0;
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 128; ++x) {
        const Vec3 w = latlong_direction((x + 0.5f) / 128, (y + 0.5f) / 64);
        exact += texel(map.view(), x, y).x * solid_angles[y] * std::max(dot(n, w), 0.0f);
      }
    }
    EXPECT_NEAR(harmonic_irradiance(coefficients, n).x / exact, 1.0, 0.04);
  }
}

/// Integral of one level over the sphere.
double level_power(const FilteredView& view, int index) {
  const FilteredLevel& level = view.levels[index];
  double sum = 0;
  for (int y = 0; y < level.height; ++y) {
    const FilteredRow row = view.rows[level.first_row + y];
    double mean = 0;
    for (int x = 0; x < row.count; ++x) mean += view.texels[3 * (row.first + x)] / row.count;
    sum += 2 * M_PI * mean *
           (std::cos(M_PI * y / level.height) - std::cos(M_PI * (y + 1) / level.height));
  }
  return sum;
}

TEST(Filtered, EveryLevelHasTheMapsPower) {
  for (const auto& [width, height] :
       {std::pair{256, 128}, {100, 37}, {31, 64}, {3, 2}, {1, 1}, {1, 7}, {64, 1}}) {
    Map map = testing::make_outdoor_map(width, height);
    map.set(width / 3, height / 5, 5000.0f);
    const FilteredMap filtered(map.view());
    const FilteredView view = filtered.view().filtered;
    ASSERT_GE(view.level_count, 1);
    for (int i = 0; i < view.level_count; ++i) {
      EXPECT_NEAR(level_power(view, i) / power_of(map.view()), 1.0, 1e-5)
          << width << 'x' << height << " level " << i + 1;
    }
    EXPECT_EQ(view.levels[view.level_count - 1].height, 1);
  }
}

TEST(Filtered, ConstantMapIsExactAtEveryLevel) {
  const Map map(90, 50, 0.7f);
  const FilteredMap filtered(map.view());
  const FilteredView view = filtered.view().filtered;
  std::mt19937 random(1);
  for (int i = 0; i < 20000; ++i) {
    const auto unit = [&] { return (float)(random() >> 8) * 0x1p-24f; };
    const Vec2 uv = {unit(), unit()};
    const float pdf = std::exp(30.0f * unit() - 15.0f);
    EXPECT_NEAR(filtered_radiance(view, map.view(), uv, pdf).y, 0.7f, 2e-7f);
  }
}

TEST(Filtered, LevelFollowsTheSolidAngleOfASample) {
  const Map map = testing::make_outdoor_map(256, 128);
  FilterConfig config;
  config.samples = 16;
  config.overlap = 1;
  const FilteredMap filtered(map.view(), config);
  const FilteredView view = filtered.view().filtered;
  const Vec2 uv = {0.3f, 0.24f};
  // 1 / (N pdf) of a texel and less: the map itself, to the bit.
  const double texel = (M_PI / 128) * (M_PI / 128);
  const float narrow = (float)(1.001 / (16 * texel));
  EXPECT_EQ(filtered_radiance(view, map.view(), uv, narrow).x,
            lookup_bilinear_uv(map.view(), uv.x, uv.y).x);
  // Of 4^k texels: level k alone.
  for (int k = 1; k <= view.level_count; ++k) {
    const float pdf = (float)(1.0 / (16 * texel * std::pow(4.0, k)));
    const float expected = lookup_filtered_level(view, k - 1, uv.x, uv.y).x;
    EXPECT_NEAR(filtered_radiance(view, map.view(), uv, pdf).x / expected, 1.0, 1e-4);
  }
  // Of the sphere: the mean.
  EXPECT_NEAR(filtered_radiance(view, map.view(), uv, 1e-6f).x / (power_of(map.view()) / 4 / M_PI),
              1.0, 1e-5);
}

/// The largest step of a level's look-up along a path on the sphere, against its largest value.
template <typename Path>
double largest_step(const FilteredView& view, int level, const Path& path) {
  constexpr int kSteps = 4096;
  double step = 0, largest = 0, before = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const Vec2 uv = latlong_uv(path(2 * M_PI * i / kSteps));
    const double value = lookup_filtered_level(view, level, uv.x, uv.y).x;
    if (i > 0) step = std::max(step, std::abs(value - before));
    largest = std::max(largest, value);
    before = value;
  }
  return step / largest;
}

TEST(Filtered, ContinuousAcrossTheSeamAndThePoles) {
  Map map(128, 64, 0.05f);
  // Bright spots on the seam and beside both poles, where a wrong wrap shows.
  for (const auto& [x, y] : {std::pair{0, 30}, {127, 31}, {20, 0}, {90, 1}, {70, 63}, {5, 62}}) {
    map.set(x, y, 100.0f);
  }
  const FilteredMap filtered(map.view());
  const FilteredView view = filtered.view().filtered;
  for (int level = 0; level < view.level_count; ++level) {
    SCOPED_TRACE(level + 1);
    const double texel = M_PI / view.levels[level].height;
    const double allowed = 2.5 * (2 * M_PI / 4096) / texel + 1e-4;  // of a ramp over a texel
    const auto equator = [](double t) {
      return Vec3{(float)std::cos(t), (float)std::sin(t), 0.05f};
    };
    const auto through_poles = [](double t) {
      return normalize({(float)std::sin(t), 0.003f, (float)std::cos(t)});
    };
    EXPECT_LT(largest_step(view, level, equator), allowed);
    EXPECT_LT(largest_step(view, level, through_poles), allowed);
    for (const float v : {0.0f, 1.0f}) {  // the pole is one point
      EXPECT_EQ(lookup_filtered_level(view, level, 0.1f, v).x,
                lookup_filtered_level(view, level, 0.7f, v).x);
    }
  }
}

RenderOptions small_options(int samples) {
  RenderOptions options;
  options.width = 40;
  options.height = 30;
  options.samples = samples;
  options.max_bounces = 0;
  options.pixel_filter = PixelFilter::kBox;
  return options;
}

double mean_green(const std::vector<float>& pixels) {
  double sum = 0;
  for (size_t i = 1; i < pixels.size(); i += 4) sum += pixels[i];
  return sum / (double)(pixels.size() / 4);
}

double rms_difference(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (size_t i = 1; i < a.size(); i += 4) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / (double)(a.size() / 4));
}

EnvironmentInput sky_of(const Map& map) {
  EnvironmentInput in;
  in.texels = share(map.texels);
  in.width = map.width;
  in.height = map.height;
  return in;
}

std::shared_ptr<const FilteredMap> filtered_of(const EnvironmentInput& sky, int samples) {
  FilterConfig config;
  config.samples = samples;
  return std::make_shared<FilteredMap>(LatLongImage{sky.texels.get(), sky.width, sky.height},
                                       config);
}

TEST(Filtered, RendersAConstantMapExactly) {
  EnvironmentInput sky = sky_of(Map(64, 32, 0.7f));
  for (const int bounces : {0, 2}) {
    auto scene = make_spheres_scene(4.0 / 3.0);
    scene->set_environment(sky);
    RenderOptions options = small_options(8);
    options.max_bounces = bounces;
    options.light_sampling = false;
    const std::vector<float> plain = render(scene, options);
    options.sampler = filtered_of(sky, 4);
    options.light_sampling = true;  // there are no light samples
    const std::vector<float> filtered = render(scene, options);
    EXPECT_LT(rms_difference(plain, filtered), 1e-6);
  }
}

/// The bias: samples do not sharpen what the filter has blurred, a narrower filter does.
TEST(Filtered, ConvergesToABlurredAnswer) {
  Map map(128, 64, 0.2f);
  for (int y = 12; y < 20; ++y) {
    for (int x = 0; x < 128; x += 16) {
      for (int i = 0; i < 4; ++i) map.set(x + i, y, 30.0f);
    }
  }
  EnvironmentInput sky = sky_of(map);
  auto scene = std::make_shared<Scene>();
  const int metal = scene->add_material({glossy(1.0f, 0.3f)}, "metal");
  scene->add_instance(scene->add_mesh(make_sphere(128, 64).input("sphere")), identity4(), {metal});
  scene->set_camera(look_at({0, -4, 2.0f}, {0, 0, 0}), perspective(0.45, 4.0 / 3.0));
  scene->set_environment(sky);
  const auto rendered = [&](int samples, std::shared_ptr<const EnvironmentSampler> sampler,
                            uint32_t seed) {
    RenderOptions options = small_options(samples);
    options.sampler = std::move(sampler);
    options.seed = seed;
    return render(scene, options);
  };
  const std::vector<float> reference =
      rendered(1024, std::make_shared<InversionSampler>(map.view()), 1);
  const std::vector<float> few = rendered(1024, filtered_of(sky, 4), 2);
  const std::vector<float> few_again = rendered(1024, filtered_of(sky, 4), 3);
  const std::vector<float> many = rendered(1024, filtered_of(sky, 512), 4);
  const double noise = rms_difference(few, few_again);
  EXPECT_GT(rms_difference(few, reference), 10 * noise);
  EXPECT_LT(rms_difference(many, reference), 0.2 * rms_difference(few, reference));
  // Blurred, not lost.
  EXPECT_NEAR(mean_green(few) / mean_green(reference), 1.0, 0.1);
}

TEST(Filtered, AsksForBsdfSamples) {
  EnvironmentInput sky = sky_of(Map(16, 8, 1.0f));
  auto scene = make_spheres_scene(1.0);
  scene->set_environment(sky);
  RenderOptions options = small_options(1);
  options.sampler = filtered_of(sky, 4);
  options.bsdf_sampling = false;
  RenderSession session(1);
  EXPECT_THROW(session.start(scene, options), std::invalid_argument);
  options.bsdf_sampling = true;
  options.candidates = 4;
  EXPECT_THROW(session.start(scene, options), std::invalid_argument);
}

TEST(Resampling, IsUnbiased) {
  const Map map = testing::make_outdoor_map(64, 32);
  EnvironmentInput sky = sky_of(map);
  sky.sampler = std::make_shared<KdTreeSampler>(map.view());
  auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(sky);
  for (const int bounces : {0, 2}) {
    RenderOptions options = small_options(1024);
    options.max_bounces = bounces;
    const std::vector<float> reference = render(scene, options);
    for (const auto& [candidates, with_bsdf] : {std::pair{2, true}, {6, true}, {6, false}}) {
      SCOPED_TRACE(::testing::Message() << candidates << " candidates, " << with_bsdf);
      RenderOptions resampled = options;
      resampled.samples = 256;
      resampled.seed = 5;
      resampled.candidates = candidates;
      resampled.bsdf_sampling = with_bsdf;
      const std::vector<float> pixels = render(scene, resampled);
      EXPECT_NEAR(mean_green(pixels) / mean_green(reference), 1.0, with_bsdf ? 0.01 : 0.02);
      if (!with_bsdf) continue;  // few light samples find the metals' narrow reflections
      EXPECT_LT(rms_difference(pixels, reference), 0.15 * mean_green(reference));
    }
  }
}

/// What it is for: fewer rays that bring little.
TEST(Resampling, LessNoiseAtFewSamples) {
  const Map map = testing::make_outdoor_map(64, 32);
  EnvironmentInput sky = sky_of(map);
  sky.sampler = std::make_shared<KdTreeSampler>(map.view());
  auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(sky);
  const std::vector<float> reference = render(scene, small_options(1024));
  RenderOptions options = small_options(1);
  options.seed = 9;
  const double plain = rms_difference(render(scene, options), reference);
  options.candidates = 16;
  EXPECT_LT(rms_difference(render(scene, options), reference), 0.8 * plain);
}

}  // namespace
}  // namespace skytree
