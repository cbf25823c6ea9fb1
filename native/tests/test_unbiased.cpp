// SPDX-License-Identifier: GPL-3.0-or-later
// Every unbiased way to render brings the same light, to 0.1 % of references that are integrals by
// quadrature: every sampler on a plane, every estimator on glossy planes and with several bounces.
#include <gtest/gtest.h>

#include "tests/all_samplers.h"
#include "tests/exact_references.h"

namespace skytree {
namespace {

using testing::IntegratingSphere;
using testing::Rgb;

constexpr double kTolerance = 1e-3;

EnvironmentInput environment_of(std::vector<float> texels, int width, int height) {
  EnvironmentInput in;
  in.texels = share(std::move(texels));
  in.width = width;
  in.height = height;
  in.color = {1.0f, 0.5f, 2.0f};
  const float s = 0.5f, c = std::sqrt(0.75f);  // the bright part of both skies near the zenith
  in.world_to_env = {{{c, 0, s}, {0, 1, 0}, {-s, 0, c}}};
  return in;
}

std::shared_ptr<const KdTreeSampler> best_sampler(const EnvironmentInput& in, double compensation) {
  KdTreeConfig config;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  config.block_density = BlockDensity::LINEAR;
  config.compensation = compensation;
  return std::make_shared<KdTreeSampler>(LatLongImage{in.texels.get(), in.width, in.height},
                                         config);
}

RenderOptions options_of(int samples, int max_bounces = 0) {
  RenderOptions options;
  options.width = 16;
  options.height = 12;
  options.samples = samples;
  options.max_bounces = max_bounces;
  options.pixel_filter = PixelFilter::kBox;
  options.filter_width = 1.0;
  return options;
}

void expect_same(const Rgb& mean, const Rgb& reference) {
  EXPECT_NEAR(mean.r / reference.r, 1.0, kTolerance);
  EXPECT_NEAR(mean.g / reference.g, 1.0, kTolerance);
  EXPECT_NEAR(mean.b / reference.b, 1.0, kTolerance);
}

TEST(Unbiased, EverySampler) {
  const EnvironmentInput environment = environment_of(testing::make_soft_sky(64, 32), 64, 32);
  const auto scene = testing::make_plane_scene({diffuse(0.5f), glossy(0.4f, 0.6f)}, environment);
  const Rgb reference = testing::plane_radiance(scene.get());
  const LatLongImage image = {environment.texels.get(), 64, 32};
  for (const testing::NamedSampler& named : testing::all_samplers(image, 256)) {
    const auto named_so = [&](const char* part) {
      return named.name.find(part) != std::string::npos;
    };
    // Those that choose by a sorted table or an alias table do not stratify their samples.
    RenderOptions options = options_of(named_so("FITTED") || named_so("alias") ? 4096 : 1024);
    options.sampler = named.sampler;
    SCOPED_TRACE(named.name);
    expect_same(testing::mean_rgb(render(scene, options)), reference);
    SCOPED_TRACE("light samples alone");
    // Noisier alone: made to work with BSDF samples, or without knowledge of the light between
    // texels.
    if (named_so("compensated") || named_so("of pixels")) options.samples = 16384;
    options.bsdf_sampling = false;
    expect_same(testing::mean_rgb(render(scene, options)), reference);
  }
}

struct Mode {
  const char* name;
  void (*set)(RenderOptions*);
};

const Mode kModes[] = {{"plain", [](RenderOptions*) {}},
                       {"two light rays", [](RenderOptions* o) { o->light_rays = 2; }},
                       {"four light rays", [](RenderOptions* o) { o->light_rays = 4; }},
                       {"control variate", [](RenderOptions* o) { o->control_variate = true; }},
                       {"product sampling", [](RenderOptions* o) { o->product_sampling = true; }},
                       {"adaptive sampling", [](RenderOptions* o) { o->adaptive_sampling = true; }},
                       {"blue noise", [](RenderOptions* o) { o->blue_noise = true; }},
                       {"multi-jittered", [](RenderOptions* o) { o->multi_jittered = true; }},
                       {"multi-jittered, no power of two, three light rays",
                        [](RenderOptions* o) {
                          o->multi_jittered = true;
                          o->samples = 1000;
                          o->light_rays = 3;
                        }},
                       {"light rays as measured",
                        [](RenderOptions* o) {
                          o->light_rays = 0;
                          o->adaptive_sampling = true;
                        }},
                       {"all of the add-on's", [](RenderOptions* o) {
                          o->light_rays = 0;
                          o->control_variate = o->product_sampling = o->learn_visibility = true;
                          o->adaptive_sampling = true;
                        }}};

/// Noisier than the others: a sun or a narrow lobe is found by chance.
const Mode kLightSamplesAlone = {"light samples alone",
                                 [](RenderOptions* o) { o->bsdf_sampling = false; }};
const Mode kBsdfSamplesAlone = {"BSDF samples alone",
                                [](RenderOptions* o) { o->light_sampling = false; }};
/// Selection undoes the stratification, which costs most where light is hidden.
const Mode kCandidates[] = {{"two candidates", [](RenderOptions* o) { o->candidates = 2; }},
                            {"eight candidates", [](RenderOptions* o) { o->candidates = 8; }}};

std::vector<std::vector<Closure>> materials() {
  Closure ward = glossy(0.8f, 0.0f);
  ward.type = ClosureType::kWard;
  ward.alpha_x = 0.1f;
  ward.alpha_y = 0.3f;
  Closure plastic;
  plastic.type = ClosureType::kPrincipled;
  plastic.roughness = 0.4f;
  return {{diffuse(0.8f)}, {glossy(0.8f, 0.5f)}, {glossy(0.5f, 0.35f), diffuse(0.3f)},
          {plastic},       {glossy(0.8f, 0.2f)}, {glossy(0.8f, 0.5f, 0.7f)},
          {ward}};
}
constexpr size_t kBroadMaterials = 4;

TEST(Unbiased, EveryModeOnPlanesOfEveryMaterial) {
  EnvironmentInput sunny = environment_of(make_sky(128, 64), 128, 64);
  sunny.sampler = best_sampler(sunny, 0.5);
  EnvironmentInput soft = environment_of(testing::make_soft_sky(128, 64), 128, 64);
  soft.sampler = best_sampler(soft, 0.0);
  for (size_t m = 0; m < materials().size(); ++m) {
    std::shared_ptr<Scene> scene;
    Rgb reference;
    const auto enter = [&](const EnvironmentInput& environment) {
      scene = testing::make_plane_scene(materials()[m], environment);
      reference = testing::plane_radiance(scene.get());
    };
    const auto check = [&](const Mode& mode, int samples = 1024) {
      SCOPED_TRACE(::testing::Message() << "material " << m << ", " << mode.name);
      RenderOptions options = options_of(samples);
      mode.set(&options);
      expect_same(testing::mean_rgb(render(scene, options)), reference);
    };
    enter(sunny);
    for (const Mode& mode : kModes) check(mode);
    for (const Mode& mode : kCandidates) check(mode);
    if (m >= kBroadMaterials) continue;
    enter(soft);
    check(kLightSamplesAlone, 4096);
    check(kBsdfSamplesAlone, 4096);
  }
}

TEST(Unbiased, EveryModeInAnIntegratingSphere) {
  EnvironmentInput environment = environment_of(testing::make_soft_sky(128, 64), 128, 64);
  environment.sampler = best_sampler(environment, 0.0);
  const IntegratingSphere sphere(IntegratingSphere::kRows / 2, environment);
  for (const int bounces : {0, 3}) {
    RenderOptions options = options_of(1024, bounces);
    options.width = 24;
    options.height = 18;
    const Rgb reference = testing::mean_rgb(sphere.pixels(options.width, options.height, bounces));
    const auto check = [&](const Mode& mode, int samples = 1024) {
      SCOPED_TRACE(::testing::Message() << bounces << " bounces, " << mode.name);
      RenderOptions changed = options;
      changed.samples = samples;
      mode.set(&changed);
      expect_same(testing::mean_rgb(render(sphere.scene, changed)), reference);
    };
    for (const Mode& mode : kModes) check(mode);
    check(kBsdfSamplesAlone);
    check(kLightSamplesAlone, bounces ? 4096 : 1024);
    for (const Mode& mode : kCandidates) check(mode, 4096);
  }
}

}  // namespace
}  // namespace skytree
