// SPDX-License-Identifier: GPL-3.0-or-later
// Whole renders: energy, agreement of the samplers, determinism, cameras, transforms.
#include <gtest/gtest.h>

#include <algorithm>

#include "src/alias_sampler.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"
#include "tests/cuda_host_reference.h"
#include "tests/render_scenes.h"

namespace skytree {
namespace {

RenderOptions small(int samples, int max_bounces = 0) {
  RenderOptions options;
  options.width = 40;
  options.height = 30;
  options.samples = samples;
  options.max_bounces = max_bounces;
  options.pixel_filter = PixelFilter::kBox;
  return options;
}

struct Mean {
  double r = 0, g = 0, b = 0, a = 0;
};
Mean mean_of(const std::vector<float>& pixels) {
  Mean m;
  const double n = double(pixels.size() / 4);
  for (size_t i = 0; i < pixels.size(); i += 4) {
    m.r += pixels[i] / n;
    m.g += pixels[i + 1] / n;
    m.b += pixels[i + 2] / n;
    m.a += pixels[i + 3] / n;
  }
  return m;
}

EnvironmentInput sky(int width = 128, const char* sampler = "kdtree") {
  EnvironmentInput in;
  in.texels = share(make_sky(width, width / 2));
  in.width = width;
  in.height = width / 2;
  const LatLongImage image = {in.texels.get(), in.width, in.height};
  const std::string name = sampler;
  if (name == "kdtree") in.sampler = std::make_shared<KdTreeSampler>(image);
  if (name == "inversion") in.sampler = std::make_shared<InversionSampler>(image);
  if (name == "alias") in.sampler = std::make_shared<AliasSampler>(image);
  if (name == "uniform") in.sampler = std::make_shared<UniformSampler>();
  return in;
}

/// One unit sphere that fills the view, of one material, under a constant environment.
std::shared_ptr<Scene> furnace(const Closure& closure) {
  auto scene = std::make_shared<Scene>();
  const int material = scene->add_material({closure}, "furnace");
  scene->add_instance(scene->add_mesh(make_sphere(256, 128).input("sphere")), identity4(),
                      {material});
  scene->set_camera(look_at({0, -4, 0.5f}, {0, 0, 0}), perspective(0.2, 4.0 / 3.0));
  scene->set_environment({});
  return scene;
}

TEST(Furnace, WhiteDiffuseSphereIsOne) {
  // Convex: no bounce is lost, so every pixel is 1 but for the facets' terminator.
  const Mean m = mean_of(render(furnace(diffuse(1.0f)), small(256)));
  EXPECT_NEAR(m.r, 1.0, 2e-3);
  EXPECT_NEAR(m.a, 1.0, 1e-9);
}

TEST(Furnace, ClosedRoomWithEmissionReachesItsSum) {
  // Inside a closed sphere that emits 1 and reflects half: 1 + 1/2 + 1/4 + ... = 2.
  auto scene = std::make_shared<Scene>();
  Closure emission;
  emission.type = ClosureType::kEmission;
  emission.emission = {1, 1, 1};
  const int material = scene->add_material({diffuse(0.5f), emission}, "room");
  scene->add_instance(scene->add_mesh(make_sphere(64, 32, false).input("room")), identity4(),
                      {material});
  scene->set_camera(look_at({0, -0.5f, 0}, {0, 0, 0}), perspective(1.0, 4.0 / 3.0, 0.01));
  const Mean m = mean_of(render(scene, small(64, 40)));
  EXPECT_NEAR(m.r, 2.0, 0.01);
  // Two vertices of the path: what the eye sees and one bounce, as max_bounces 0 gives it.
  EXPECT_NEAR(mean_of(render(scene, small(64, 0))).r, 1.5, 0.01);
}

TEST(Furnace, GlossyAndWardNeverGain) {
  for (const float roughness : {0.1f, 0.4f, 0.9f}) {
    EXPECT_LE(mean_of(render(furnace(glossy(1.0f, roughness)), small(64))).r, 1.002) << roughness;
  }
  EXPECT_GT(mean_of(render(furnace(glossy(1.0f, 0.1f)), small(64))).r, 0.98);
  for (const float alpha : {0.05f, 0.3f}) {
    Closure ward;
    ward.type = ClosureType::kWard;
    ward.color = {1, 1, 1};
    ward.alpha_x = alpha;
    ward.alpha_y = 0.3f * alpha;
    const double r = mean_of(render(furnace(ward), small(64))).r;
    EXPECT_LE(r, 1.002) << alpha;
    EXPECT_GT(r, 0.6) << alpha;
  }
}

TEST(Furnace, WhitePrincipledKeepsItsEnergy) {
  Closure principled;
  principled.type = ClosureType::kPrincipled;
  principled.color = {1, 1, 1};
  for (const float roughness : {0.2f, 0.5f, 0.9f}) {
    principled.roughness = roughness;
    // The diffuse layer gets what the coat's albedo table leaves: nothing lost but the table's own
    // error.
    EXPECT_NEAR(mean_of(render(furnace(principled), small(256))).r, 1.0, 0.01) << roughness;
  }
}

TEST(Samplers, AgreeWithinNoise) {
  const auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(sky(128, "inversion"));
  const Mean reference = mean_of(render(scene, small(1024)));
  ASSERT_GT(reference.g, 0.1);
  for (const char* name : {"kdtree", "alias"}) {
    scene->set_environment(sky(128, name));
    // The sun in the glossy spheres: the mean of so many samples still has a deviation of 0.2 %.
    const Mean m = mean_of(render(scene, small(1024)));
    EXPECT_NEAR(m.r / reference.r, 1.0, 0.007) << name;
    EXPECT_NEAR(m.b / reference.b, 1.0, 0.007) << name;
  }
  scene->set_environment(sky(128, "uniform"));
  EXPECT_NEAR(mean_of(render(scene, small(2048))).r / reference.r, 1.0, 0.02);
}

TEST(Samplers, ASunWithBlueBelowZeroIsSampledAsItIsShown) {
  // Out of the primaries' gamut: shown as (2000, 900, 0), so the samplers must know it as that.
  const int width = 128, height = 64;
  std::vector<float> pictures[2];
  for (const bool below : {false, true}) {
    std::vector<float> texels = make_sky(width, height);
    const float sun[] = {2000.0f, 900.0f, below ? -0.01f : 0.0f};
    std::copy(sun, sun + 3, texels.begin() + 3 * (20 * width + 30));
    EnvironmentInput in;
    in.texels = share(std::move(texels));
    in.width = width;
    in.height = height;
    KdTreeConfig config;
    config.split_criterion = SplitCriterion::MIN_VARIANCE;
    config.block_probability = BlockProbability::MIN_VARIANCE;
    config.compensation = 1.0;
    in.sampler =
        std::make_shared<KdTreeSampler>(LatLongImage{in.texels.get(), width, height}, config);
    auto scene = furnace(diffuse(0.5f));
    scene->set_environment(std::move(in));
    RenderOptions options = small(4);
    options.control_variate = true;
    pictures[below] = render(scene, options);
  }
  EXPECT_EQ(pictures[0], pictures[1]);
}

TEST(Samplers, LightAloneAndBsdfAloneAgreeWithBoth) {
  const auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(sky());
  RenderOptions options = small(512, 2);
  const Mean both = mean_of(render(scene, options));
  options.bsdf_sampling = false;
  EXPECT_NEAR(mean_of(render(scene, options)).r / both.r, 1.0, 0.01);
  options.bsdf_sampling = true;
  options.light_sampling = false;
  options.samples = 4096;
  EXPECT_NEAR(mean_of(render(scene, options)).r / both.r, 1.0, 0.03);
}

TEST(Irradiance, OneTexelSunOnAPlane) {
  // Analytic: radiosity of a Lambertian plane = albedo/pi * integral of L cos over the interpolated
  // texel.
  constexpr int w = 64, h = 32, column = 20, row = 9;
  std::vector<float> texels(size_t(w) * h * 3, 0.0f);
  for (int k = 0; k < 3; ++k) texels[(size_t(row) * w + column) * 3 + k] = 100.0f;
  const LatLongImage image = {texels.data(), w, h};
  double irradiance = 0.0;
  constexpr int kSteps = 400;
  for (int i = 0; i < kSteps; ++i) {
    for (int k = 0; k < kSteps; ++k) {
      const float u = (column - 1 + 3.0f * (k + 0.5f) / kSteps) / w;
      const float v = (row - 1 + 3.0f * (i + 0.5f) / kSteps) / h;
      const double area =
          3.0 / kSteps / w * 2 * M_PI * 3.0 / kSteps / h * M_PI * std::sin(v * M_PI);
      irradiance += lookup_bilinear_uv(image, u, v).x * std::max(0.0, std::cos(v * M_PI)) * area;
    }
  }
  auto scene = std::make_shared<Scene>();
  const int material = scene->add_material({diffuse(0.8f)}, "plane");
  scene->add_instance(scene->add_mesh(make_square(10.0f).input("plane")), identity4(), {material});
  scene->set_camera(look_at({0, -2, 5}, {0, 0, 0}), perspective(0.5, 4.0 / 3.0));
  EnvironmentInput in;
  in.texels = share(texels);
  in.width = w;
  in.height = h;
  for (const int turn : {0, 1}) {
    in.sampler = std::make_shared<KdTreeSampler>(image);
    // A turn about z leaves the irradiance of a horizontal plane alone.
    const float angle = 0.9f * float(turn);
    in.world_to_env = {
        {{std::cos(angle), -std::sin(angle), 0}, {std::sin(angle), std::cos(angle), 0}, {0, 0, 1}}};
    scene->set_environment(in);
    EXPECT_NEAR(mean_of(render(scene, small(256))).r, 0.8 / M_PI * irradiance, 0.005 * irradiance);
  }
}

/// sky() with the sampler that all estimators work with, turned.
static EnvironmentInput turned_sky() {
  EnvironmentInput environment = sky();
  KdTreeConfig config;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  environment.sampler = std::make_shared<KdTreeSampler>(
      LatLongImage{environment.texels.get(), environment.width, environment.height}, config);
  const float s = std::sqrt(0.5f);
  environment.world_to_env = {{{s, 0, -s}, {0, 1, 0}, {s, 0, s}}};
  return environment;
}

TEST(Estimators, KeepTheMean) {
  // Lambert alone, with GGX, and on the ground in shadows: what the lanes and the variate take.
  auto scene = std::make_shared<Scene>();
  Closure plastic;
  plastic.type = ClosureType::kPrincipled;
  plastic.roughness = 0.6f;
  const int white = scene->add_material({diffuse(0.8f)}, "white");
  scene->add_instance(scene->add_mesh(make_square(50.0f).input("ground")), identity4(), {white});
  const int sphere = scene->add_mesh(make_sphere().input("sphere"));
  scene->add_instance(sphere, translation(-1.1, 0, 1), {white});
  scene->add_instance(sphere, translation(1.1, 0, 1), {scene->add_material({plastic}, "plastic")});
  scene->set_camera(look_at({0, -7, 4}, {0, 0, 0.6f}), perspective(0.7, 4.0 / 3.0));
  EnvironmentInput environment = turned_sky();
  environment.color = {1.0f, 0.5f, 2.0f};
  scene->set_environment(environment);
  for (const int bounces : {0, 2}) {
    RenderOptions options = small(1024, bounces);
    const Mean plain = mean_of(render(scene, options));
    for (const bool bsdf_sampling : {true, false}) {
      options.bsdf_sampling = bsdf_sampling;
      options.light_rays = bsdf_sampling ? 2 : 3;
      options.control_variate = true;
      options.product_sampling = true;
      const Mean best = mean_of(render(scene, options));
      EXPECT_NEAR(best.r / plain.r, 1.0, 0.001) << bounces << bsdf_sampling;
      EXPECT_NEAR(best.b / plain.b, 1.0, 0.001) << bounces << bsdf_sampling;
    }
  }
}

/// Its mean is test_unbiased.cpp's.
TEST(Estimators, ProductSamplingVariesLess) {
  // Isotropic, anisotropic and beside a diffuse lobe: in lanes; Ward: by itself.
  Closure ward = glossy(0.8f, 0.0f);
  ward.type = ClosureType::kWard;
  ward.alpha_x = 0.1f;
  ward.alpha_y = 0.3f;
  Closure layer = glossy(0.5f, 0.35f), base = diffuse(0.3f);
  const std::vector<std::vector<Closure>> materials = {{glossy(0.8f, 0.2f)},
                                                       {glossy(0.8f, 0.5f)},
                                                       {glossy(0.8f, 0.5f, 0.7f)},
                                                       {ward},
                                                       {layer, base}};
  for (size_t m = 0; m < materials.size(); ++m) {
    SCOPED_TRACE(m);
    auto scene = std::make_shared<Scene>();
    const int material = scene->add_material(materials[m], "ball");
    scene->add_instance(scene->add_mesh(make_sphere().input("ball")), identity4(), {material});
    scene->set_camera(look_at({0, -4, 2}, {0, 0, 0}), perspective(0.4, 4.0 / 3.0));
    scene->set_environment(turned_sky());
    RenderOptions options = small(1024, 0);
    options.control_variate = true;
    options.product_sampling = true;
    const std::vector<float> reference = render(scene, options);
    double errors[2] = {0, 0};
    options.samples = 8;
    options.seed = 5;
    for (const bool product : {false, true}) {
      options.product_sampling = product;
      const std::vector<float> image = render(scene, options);
      for (size_t i = 0; i < image.size(); ++i) {
        errors[product] += std::pow(double(image[i]) - reference[i], 2);
      }
    }
    std::printf("material %zu: squared error %.2f of that without\n", m, errors[1] / errors[0]);
    EXPECT_LT(errors[1], 0.9 * errors[0]);
  }
}

TEST(Estimators, NoLightNoNoise) {
  // Inside a sphere the control variate alone would be noise around 0.
  auto scene = std::make_shared<Scene>();
  const int white = scene->add_material({diffuse(0.8f)}, "white");
  scene->add_instance(scene->add_mesh(make_sphere().input("room")), identity4(), {white});
  scene->set_camera(look_at({0, -0.5f, 0}, {0, 0, 0.1f}), perspective(1.0, 1.0, 0.01));
  scene->set_environment(sky());
  RenderOptions options = small(4, 0);
  options.control_variate = true;
  options.light_rays = 2;
  const Mean mean = mean_of(render(scene, options));
  EXPECT_EQ(mean.r, 0.0);
}

TEST(Determinism, MultiJitteredToo) {
  const auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(turned_sky());
  for (const int samples : {12, 16}) {
    RenderOptions options = small(samples, 3);
    const std::vector<float> sobol = render(scene, options);
    options.multi_jittered = true;
    options.light_rays = 2;
    const std::vector<float> one = render(scene, options, 1);
    EXPECT_EQ(one, render(scene, options, 5));
    EXPECT_NE(one, sobol);
    // Vertex by vertex, as devices shade, the points are the same; hits differ in their last bits.
    const std::vector<float> alone = cuda::render_on_host(scene.get(), options);
    size_t off = 0;
    for (size_t i = 0; i < one.size(); ++i) {
      off += std::fabs(one[i] - alone[i]) > 1e-3f * (0.1f + std::fabs(one[i]));
    }
    EXPECT_LE(off, one.size() / 100);
    // Where the number of samples is not known it is Sobol'.
    for (const int reason : {0, 1, 2}) {
      RenderOptions other = options;
      if (reason == 0) other.adaptive_sampling = true;
      if (reason == 1) other.blue_noise = true;
      if (reason == 2) other.first_sample = 1;
      const std::vector<float> asked = render(scene, other);
      other.multi_jittered = false;
      EXPECT_EQ(asked, render(scene, other)) << reason;
    }
  }
}

static void bits_depend_on_pixel_sample_and_seed_only(bool blue_noise, bool estimators) {
  const auto scene = make_spheres_scene(4.0 / 3.0);
  scene->set_environment(estimators ? turned_sky() : sky());
  RenderOptions options = small(24, 3);
  options.light_rays = estimators ? 2 : 1;
  options.control_variate = estimators;
  options.product_sampling = estimators;
  options.width = 70;  // not a multiple of the tile
  options.height = 53;
  options.pixel_filter = PixelFilter::kBlackmanHarris;
  options.blue_noise = blue_noise;
  const std::vector<float> whole = render(scene, options, 1);
  EXPECT_EQ(whole, render(scene, options, 5)) << "threads";

  RenderOptions region = options;
  region.x0 = 13;
  region.y0 = 21;
  region.x1 = 50;
  region.y1 = 38;
  const std::vector<float> part = render(scene, region, 2);
  for (int y = region.y0; y < region.y1; ++y) {
    for (int x = region.x0; x < region.x1; ++x) {
      for (int k = 0; k < 4; ++k) {
        ASSERT_EQ(part[(size_t(y - region.y0) * (region.x1 - region.x0) + x - region.x0) * 4 + k],
                  whole[(size_t(y) * options.width + x) * 4 + k])
            << x << "," << y;
      }
    }
  }

  RenderOptions head = options, tail = options;
  head.samples = 7;
  tail.samples = 17;
  tail.first_sample = 7;
  const std::vector<float> a = render(scene, head), b = render(scene, tail);
  for (size_t i = 0; i < whole.size(); ++i) {
    ASSERT_NEAR((7 * a[i] + 17 * b[i]) / 24, whole[i], 1e-5f * (1 + std::fabs(whole[i])));
  }
  RenderOptions other = options;
  other.seed = 1;
  EXPECT_NE(whole, render(scene, other));
}

TEST(Determinism, BitsDependOnPixelSampleAndSeedOnly) {
  bits_depend_on_pixel_sample_and_seed_only(false, false);
  bits_depend_on_pixel_sample_and_seed_only(false, true);
}
TEST(Determinism, WithBlueNoiseToo) { bits_depend_on_pixel_sample_and_seed_only(true, true); }

TEST(Camera, OrthographicAndShiftSeeWhatTheyShould) {
  // A small emitting square at a known place: its centroid on the film is where the projection puts
  // it.
  auto scene = std::make_shared<Scene>();
  Closure emission;
  emission.type = ClosureType::kEmission;
  emission.emission = {1, 1, 1};
  const int material = scene->add_material({emission}, "lamp");
  scene->add_instance(scene->add_mesh(make_square(0.2f).input("lamp")), translation(1.0, 0.5, 0),
                      {material});
  EnvironmentInput black;
  black.color = {0, 0, 0};
  scene->set_environment(black);
  RenderOptions options = small(16);
  options.width = 80;
  options.height = 60;
  auto centroid = [&] {
    const std::vector<float> pixels = render(scene, options);
    double sum = 0, x = 0, y = 0;
    for (int j = 0; j < options.height; ++j) {
      for (int i = 0; i < options.width; ++i) {
        const double v = pixels[(size_t(j) * options.width + i) * 4];
        sum += v;
        x += v * (i + 0.5);
        y += v * (j + 0.5);
      }
    }
    EXPECT_GT(sum, 1.0);
    return std::make_pair(x / sum, y / sum);
  };
  const Matrix4 above = translation(0, 0, 5);  // looks down -z, x right, y up
  scene->set_camera(above, orthographic(8, 6));
  EXPECT_NEAR(centroid().first, 40 + 10 * 1.0, 0.1);
  EXPECT_NEAR(centroid().second, 30 + 10 * 0.5, 0.1);
  Matrix4 shifted = orthographic(8, 6);
  shifted[3] -= 0.25;  // moves the picture by a quarter of half the width
  scene->set_camera(above, shifted);
  EXPECT_NEAR(centroid().first, 40 + 10 * 1.0 - 0.25 * 40, 0.1);
  Matrix4 lens = perspective(2 * std::atan(0.8), 4.0 / 3.0);
  scene->set_camera(above, lens);
  EXPECT_NEAR(centroid().first, 40 + 40 * (1.0 / 5.0) / 0.8, 0.1);
  lens[2] += 0.3;  // shift of a perspective camera: z enters before the division
  scene->set_camera(above, lens);
  EXPECT_NEAR(centroid().first, 40 + 40 * (1.0 / 5.0) / 0.8 - 0.3 * 40, 0.1);
  EXPECT_THROW(scene->set_camera(above, Matrix4{}), std::invalid_argument);
}

TEST(Instances, MirroredAndShearedEqualTheirMeshInPlace) {
  const Matrix4 matrices[] = {{-1, 0, 0, 0.2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1},
                              {1, 0.5, 0, 0, 0, 1, 0.3, 0, 0, 0, 0.7, 0.1, 0, 0, 0, 1}};
  for (const Matrix4& m : matrices) {
    const MeshData sphere = make_sphere(48, 24, false);
    MeshData placed = sphere;
    for (size_t i = 0; i < sphere.positions.size(); i += 3) {
      const float* p = &sphere.positions[i];
      for (int row = 0; row < 3; ++row) {
        placed.positions[i + row] = float(m[4 * row] * p[0] + m[4 * row + 1] * p[1] +
                                          m[4 * row + 2] * p[2] + m[4 * row + 3]);
      }
    }
    std::vector<float> images[2];
    for (const int in_place : {0, 1}) {
      auto scene = std::make_shared<Scene>();
      const int material = scene->add_material({diffuse(0.8f)}, "m");
      const int mesh = scene->add_mesh((in_place ? placed : sphere).input("sphere"));
      scene->add_instance(mesh, in_place ? identity4() : m, {material});
      scene->set_camera(look_at({0, -5, 1}, {0, 0, 0}), perspective(0.6, 4.0 / 3.0));
      scene->set_environment(sky());
      images[in_place] = render(scene, small(64, 1));
    }
    double difference = 0.0;
    for (size_t i = 0; i < images[0].size(); ++i) {
      difference += std::fabs(images[0][i] - images[1][i]) / double(images[0].size());
    }
    EXPECT_LT(difference, 0.003);
  }
}

TEST(Transparency, HalfTransparentSheetDimsShadowAndView) {
  // A sheet with transparency 1/2 and no reflection over a white plane, constant light: the light
  // passes it on the way in (where it covers the sky as seen from below: nearly everywhere) and on
  // the way to the eye.
  auto scene = std::make_shared<Scene>();
  Closure clear;
  clear.type = ClosureType::kTransparent;
  clear.color = {0.5f, 0.5f, 0.5f};
  const int sheet = scene->add_material({clear}, "sheet");
  const int white = scene->add_material({diffuse(1.0f)}, "white");
  const int square = scene->add_mesh(make_square(500.0f).input("square"));
  scene->add_instance(square, identity4(), {white});
  scene->add_instance(square, translation(0, 0, 1), {sheet});
  scene->set_camera(look_at({0, -1, 4}, {0, 0, 0}), perspective(0.3, 4.0 / 3.0));
  scene->set_environment({});
  EXPECT_NEAR(mean_of(render(scene, small(64))).r, 0.25, 0.003);
}

TEST(Film, TransparentBackgroundHasNoAlpha) {
  const auto scene = furnace(diffuse(0.5f));
  scene->set_camera(look_at({0, -4, 0}, {0, 0, 0}), perspective(1.2, 4.0 / 3.0));
  RenderOptions options = small(32);
  options.film_transparent = true;
  const std::vector<float> pixels = render(scene, options);
  EXPECT_EQ(pixels[3], 0.0f);
  EXPECT_EQ(pixels[0], 0.0f);
  const size_t center = (size_t(15) * 40 + 20) * 4;
  EXPECT_EQ(pixels[center + 3], 1.0f);
  EXPECT_NEAR(pixels[center], 0.5f, 0.02f);
}

TEST(Texture, NormalMapTiltsTheSurface) {
  // A plane under a sky that is bright in the half x > 0: tilting its normal towards +u must
  // brighten it, towards -u darken it, also where the instance is mirrored or the picture laid on
  // mirrored; strength 0 changes nothing.
  std::vector<float> half(16 * 8 * 3, 0.0f);
  for (int y = 0; y < 8; ++y) {
    for (int x = 4; x < 12; ++x) {  // u = 0.5 - phi / 2 pi: the middle columns look along +x
      for (int k = 0; k < 3; ++k) half[(y * 16 + x) * 3 + k] = 1.0f;
    }
  }
  auto brightness = [&](float red, float strength, float u_sign, const Matrix4& matrix, Vec3 eye) {
    auto scene = std::make_shared<Scene>();
    const float texel[3] = {red, 0.5f, 0.8f};
    TextureInput map;
    map.texels = texel;
    map.width = map.height = 1;
    Closure closure = diffuse(0.8f);
    closure.normal_texture = scene->add_texture(map);
    closure.normal_strength = strength;
    const int material = scene->add_material({closure}, "tilted");
    MeshData square = make_square(50.0f);
    const float s = 1.0f * u_sign;
    const float uvs[] = {0, 0, s, 0, s, 1, 0, 1};
    MeshInput in = square.input("plane");
    in.corners = square.triangles.data();
    in.corner_uvs = uvs;
    in.corner_count = 4;
    scene->add_instance(scene->add_mesh(in), matrix, {material});
    scene->set_camera(look_at(eye, {0, 0, 0}), perspective(0.3, 4.0 / 3.0));
    EnvironmentInput environment;
    environment.texels = share(half);
    environment.width = 16;
    environment.height = 8;
    scene->set_environment(environment);
    return mean_of(render(scene, small(128))).r;
  };
  const Vec3 above = {0, -1, 5}, below = {0, -1, -5};
  Matrix4 mirrored = identity4();
  mirrored[0] = -1.0;
  const double flat = brightness(0.5f, 1, 1, identity4(), above);
  EXPECT_NEAR(brightness(0.9f, 0, 1, identity4(), above), flat, 0.005);
  EXPECT_GT(brightness(0.9f, 1, 1, identity4(), above), flat + 0.05);
  EXPECT_LT(brightness(0.1f, 1, 1, identity4(), above), flat - 0.05);
  EXPECT_LT(brightness(0.9f, 1, -1, identity4(), above), flat - 0.05);
  EXPECT_LT(brightness(0.9f, 1, 1, mirrored, above), flat - 0.05);
  // From behind the bump is seen inside out.
  EXPECT_LT(brightness(0.9f, 1, 1, identity4(), below), flat - 0.05);
}

TEST(Texture, CheckerFollowsUvAndExtension) {
  const float texels[] = {1, 0, 0, 0, 1, 0,
                          0, 0, 1, 1, 1, 1};  // top row red, green; bottom row blue, white
  TextureView view = {
      texels,    2,        2, 3, TextureExtension::kRepeat, TextureInterpolation::kClosest,
      {1, 0, 0}, {0, 1, 0}};
  EXPECT_EQ(sample_texture(view, {0.25f, 0.25f}).z, 1.0f);  // v = 0 is the bottom
  EXPECT_EQ(sample_texture(view, {0.25f, 0.75f}).x, 1.0f);
  EXPECT_EQ(sample_texture(view, {1.25f, -0.25f}).x, 1.0f);
  view.extension = TextureExtension::kMirror;
  EXPECT_EQ(sample_texture(view, {1.25f, 0.75f}).y, 1.0f);
  view.extension = TextureExtension::kExtend;
  EXPECT_EQ(sample_texture(view, {5.0f, 0.75f}).y, 1.0f);
  view.extension = TextureExtension::kClip;
  EXPECT_EQ(max_component(sample_texture(view, {1.5f, 0.5f})), 0.0f);
  view.interpolation = TextureInterpolation::kLinear;
  view.extension = TextureExtension::kRepeat;
  const Vec3 middle = sample_texture(view, {0.5f, 0.5f});
  EXPECT_NEAR(middle.x, 0.5f, 1e-6f);
  EXPECT_NEAR(middle.y, 0.5f, 1e-6f);
}

}  // namespace
}  // namespace skytree
