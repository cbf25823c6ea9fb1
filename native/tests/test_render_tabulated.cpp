// SPDX-License-Identifier: GPL-3.0-or-later
// Tabulated BRDFs in the renderer: pictures agree with those of the models that the tables were
// made of, whichever way light is sampled.
#include <gtest/gtest.h>

#include <cmath>

#include "src/brdf_kdtree.h"
#include "tests/render_scenes.h"

namespace skytree {
namespace {

struct Case {
  const char* name;
  ClosureType model;
  float alpha_x, alpha_y;
};

/// A sphere under the sky, of the model or of its table.
std::vector<float> render_sphere(const Case& c, bool tabulated, bool light_sampling,
                                 bool bsdf_sampling, int samples) {
  auto scene = std::make_shared<Scene>();
  Closure closure;
  closure.color = {0.9f, 0.7f, 0.5f};
  closure.rotation = 0.1f;
  if (tabulated) {
    closure.type = ClosureType::kTabulated;
    closure.brdf = scene->add_brdf(std::make_shared<BrdfKdTree>(
        c.model == ClosureType::kWard ? make_ward_table(c.alpha_x, c.alpha_y)
                                      : make_ggx_table(c.alpha_x, c.alpha_y)));
  } else if (c.model == ClosureType::kWard) {
    closure.type = ClosureType::kWard;
    closure.alpha_x = c.alpha_x;
    closure.alpha_y = c.alpha_y;
  } else {
    closure.type = ClosureType::kGlossy;
    closure.roughness = std::sqrt(c.alpha_x);
  }
  const int material = scene->add_material({closure}, "sphere");
  scene->add_instance(scene->add_mesh(make_sphere().input("sphere")), identity4(), {material});
  scene->set_camera(look_at({0, -4, 1}, {0, 0, 0}), perspective(0.6, 1.0));
  EnvironmentInput sky;
  sky.width = 64;
  sky.height = 32;
  std::vector<float> texels = make_sky(64, 32);
  for (float& x : texels) x = std::fmin(x, 20.0f);  // a soft sun, that BSDF sampling finds too
  sky.texels = share(std::move(texels));
  scene->set_environment(std::move(sky));
  RenderOptions options;
  options.width = options.height = 32;
  options.samples = samples;
  options.max_bounces = 0;
  options.light_sampling = light_sampling;
  options.bsdf_sampling = bsdf_sampling;
  return render(scene, options);
}

double mean_of(const std::vector<float>& image) {
  double sum = 0;
  for (size_t i = 0; i < image.size(); ++i) sum += i % 4 < 3 ? image[i] : 0;
  return sum;
}

class TabulatedRender : public testing::TestWithParam<Case> {};

TEST_P(TabulatedRender, AgreesWithTheModelItWasMadeOf) {
  const Case c = GetParam();
  const auto model = render_sphere(c, false, true, true, 512);
  const auto table = render_sphere(c, true, true, true, 512);
  double difference = 0;
  for (size_t i = 0; i < model.size(); ++i) {
    ASSERT_TRUE(std::isfinite(table[i]));
    if (i % 4 < 3) difference += std::fabs(model[i] - table[i]);
  }
  // Of a picture's light: 1 % in all, 3 % by pixel, noise of 512 samples included.
  EXPECT_NEAR(mean_of(table) / mean_of(model), 1.0, 0.01);
  EXPECT_LT(difference / mean_of(model), 0.03);
}

TEST_P(TabulatedRender, LightAndBsdfSamplingAloneHaveTheSameMean) {
  const Case c = GetParam();
  const double both = mean_of(render_sphere(c, true, true, true, 512));
  EXPECT_NEAR(mean_of(render_sphere(c, true, false, true, 2048)) / both, 1.0, 0.01);
  EXPECT_NEAR(mean_of(render_sphere(c, true, true, false, 2048)) / both, 1.0, 0.02);
}

INSTANTIATE_TEST_SUITE_P(All, TabulatedRender,
                         testing::Values(Case{"ward", ClosureType::kWard, 0.15f, 0.15f},
                                         Case{"ward_aniso", ClosureType::kWard, 0.4f, 0.05f},
                                         Case{"ggx", ClosureType::kGlossy, 0.25f, 0.25f}),
                         [](const auto& info) { return info.param.name; });

TEST(TabulatedRender, ABrdfThatTheSceneLacksIsBlackAndNamed) {
  auto scene = std::make_shared<Scene>();
  Closure closure;
  closure.type = ClosureType::kTabulated;
  closure.brdf = 3;
  const int material = scene->add_material({closure}, "brass");
  scene->add_instance(scene->add_mesh(make_sphere().input("sphere")), identity4(), {material});
  scene->set_camera(look_at({0, -4, 0}, {0, 0, 0}), perspective(0.6, 1.0));
  RenderOptions options;
  options.width = options.height = 8;
  options.samples = 4;
  const auto image = render(scene, options);
  EXPECT_EQ(image[4 * (4 * 8 + 4)], 0.0f);
  ASSERT_EQ(scene->warnings().size(), 1u);
  EXPECT_NE(scene->warnings()[0].find("\"brass\" uses BRDF 3"), std::string::npos);
}

}  // namespace
}  // namespace skytree
