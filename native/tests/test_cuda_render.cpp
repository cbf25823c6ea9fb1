// SPDX-License-Identifier: GPL-3.0-or-later
// Images rendered on the device: against the same headers on the host (equal bits), against the
// CPU's own renderer (rounding of the tracer apart), and through changes, cancelling and several
// views.
#include <cstring>
#include <thread>

#include "cuda/renderer.h"
#include "cuda_host_reference.h"
#include "cuda_test_scenes.h"
#include "cuda_test_support.h"
#include "src/alias_sampler.h"
#include "src/filtered_map.h"
#include "src/hierarchy_sampler.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"

namespace skytree::cuda {
namespace {

using Samplers = std::vector<std::pair<std::string, std::shared_ptr<const EnvironmentSampler>>>;

Samplers make_samplers(const EnvironmentInput& sky) {
  const LatLongImage image = {sky.texels.get(), sky.width, sky.height};
  KdTreeConfig fitted, warped;
  fitted.block_count = warped.block_count = 128;
  warped.split_criterion = SplitCriterion::MIN_VARIANCE;
  warped.block_probability = BlockProbability::MIN_VARIANCE;
  return {{"kd-tree fitted", std::make_shared<KdTreeSampler>(image, fitted)},
          {"kd-tree warp", std::make_shared<KdTreeSampler>(image, warped)},
          {"inversion", std::make_shared<InversionSampler>(image, true)},
          {"inversion binary", std::make_shared<InversionSampler>(image, false)},
          {"alias", std::make_shared<AliasSampler>(image)},
          {"hierarchy", std::make_shared<HierarchySampler>(image)},
          {"filtered", std::make_shared<FilteredMap>(image)},
          {"uniform", nullptr}};
}

RenderOptions small_options() {
  RenderOptions options;
  options.width = 60;
  options.height = 40;
  options.samples = 4;
  options.seed = 3;
  return options;
}

struct Rendered {
  std::vector<float> pixels;
  std::string error, warning;
  SessionStats stats;
};

Rendered render(RenderSession* session, const std::shared_ptr<Scene>& scene,
                const RenderOptions& options) {
  session->start(scene, options);
  EXPECT_TRUE(session->wait(300));
  Rendered result;
  result.pixels.resize(4 * size_t(session->region_width()) * session->region_height());
  session->pixels(result.pixels.data());
  result.error = session->error();
  result.warning = session->warning();
  result.stats = session->stats();
  EXPECT_EQ(result.error, "");
  EXPECT_EQ(session->samples_done(), options.samples);
  return result;
}

Rendered render_on_gpu(const std::shared_ptr<Scene>& scene, const RenderOptions& options) {
  RenderSession session(1, make_renderer(0));
  Rendered result = render(&session, scene, options);
  EXPECT_EQ(result.warning, "");
  EXPECT_GT(result.stats.rays, 0u);
  return result;
}

size_t different_pixels(const std::vector<float>& a, const std::vector<float>& b) {
  EXPECT_EQ(a.size(), b.size());
  size_t different = 0;
  for (size_t i = 0; i + 3 < a.size(); i += 4) {
    different += std::memcmp(&a[i], &b[i], 4 * sizeof(float)) != 0;
  }
  return different;
}

TEST_F(CudaTest, ImagesAreTheHostKernelsToTheLastBit) {
  const EnvironmentInput sky = make_sky(64, 32, nullptr);
  const std::shared_ptr<Scene> scene = material_scene(sky);
  for (const auto& [name, sampler] : make_samplers(sky)) {
    for (const int bounces : {0, 3}) {
      SCOPED_TRACE(name + ", " + std::to_string(bounces) + " bounces");
      RenderOptions options = small_options();
      options.max_bounces = bounces;
      options.product_sampling = bounces == 0;
      options.sampler = sampler;
      const std::vector<float> host = render_on_host(scene.get(), options);
      EXPECT_EQ(different_pixels(render_on_gpu(scene, options).pixels, host), 0u);
    }
  }
}

TEST_F(CudaTest, OptionsReachTheDevice) {
  const EnvironmentInput sky = make_sky(64, 32, nullptr);
  const std::shared_ptr<Scene> scene = material_scene(sky);
  std::vector<RenderOptions> variants(11, small_options());
  variants[0].film_transparent = true;
  variants[1].bsdf_sampling = false;
  variants[2].light_sampling = false;
  variants[3].pixel_filter = PixelFilter::kBox;
  variants[3].filter_width = 1.0;
  variants[4].first_sample = 5;
  variants[4].seed = 77;
  variants[5].blue_noise = true;
  variants[6].candidates = 6;
  variants[7].light_rays = 3;
  variants[7].control_variate = true;
  variants[8].product_sampling = true;
  variants[8].sampler = make_samplers(sky)[1].second;  // linear blocks
  variants[9].multi_jittered = true;
  variants[10].multi_jittered = true;
  variants[10].samples = 6;
  variants[10].light_rays = 2;
  for (const RenderOptions& options : variants) {
    EXPECT_EQ(different_pixels(render_on_gpu(scene, options).pixels,
                               render_on_host(scene.get(), options)),
              0u);
  }
}

TEST_F(CudaTest, ImagesAgreeWithTheCpu) {
  // The CPU traces with Embree, whose hits differ in the last bits of (t, u, v). Shading carries
  // that on: pixels agree to rounding, except where a difference decides between hit and miss at an
  // edge for one sample.
  const EnvironmentInput sky = make_sky(64, 32, nullptr);
  for (const bool crowded : {false, true}) {
    for (const auto& [name, sampler] : make_samplers(sky)) {
      SCOPED_TRACE(name + (crowded ? ", crowded" : ", materials"));
      const std::shared_ptr<Scene> scene = crowded ? crowded_scene(sky) : material_scene(sky);
      RenderOptions options = small_options();
      options.max_bounces = crowded ? 1 : 3;
      options.light_rays = crowded ? 1 : 2;
      options.control_variate = !crowded;
      options.product_sampling = !crowded;
      options.sampler = sampler;
      const Rendered gpu = render_on_gpu(scene, options);
      RenderSession cpu_session(2);
      const Rendered cpu = render(&cpu_session, scene, options);
      size_t off = 0;
      double gpu_sum = 0, cpu_sum = 0;
      for (size_t i = 0; i < cpu.pixels.size(); ++i) {
        off += std::fabs(gpu.pixels[i] - cpu.pixels[i]) > 1e-3f * (0.1f + std::fabs(cpu.pixels[i]));
        gpu_sum += gpu.pixels[i];
        cpu_sum += cpu.pixels[i];
      }
      std::printf("%zu of %zu values differ by more than 1e-3, means by %.1e\n", off,
                  cpu.pixels.size(), std::fabs(gpu_sum / cpu_sum - 1));
      EXPECT_LE(off, cpu.pixels.size() / 200);
      EXPECT_NEAR(gpu_sum / cpu_sum, 1.0, 2e-3);
      EXPECT_EQ(gpu.stats.rejected_samples, cpu.stats.rejected_samples);
    }
  }
}

TEST_F(CudaTest, RegionIsACutOutOfTheWhole) {
  const std::shared_ptr<Scene> scene = material_scene(make_sky(64, 32, nullptr));
  RenderOptions options = small_options();
  options.control_variate = true;
  const std::vector<float> whole = render_on_gpu(scene, options).pixels;
  options.x0 = 13;
  options.y0 = 7;
  options.x1 = 42;
  options.y1 = 31;
  const std::vector<float> part = render_on_gpu(scene, options).pixels;
  const int width = options.x1 - options.x0;
  for (int y = options.y0; y < options.y1; ++y) {
    const float* row = whole.data() + 4 * (size_t(y) * options.width + options.x0);
    EXPECT_EQ(
        std::memcmp(row, part.data() + 4 * size_t(y - options.y0) * width, 16 * size_t(width)), 0);
  }
}

TEST_F(CudaTest, OnlyWhatChangedIsSent) {
  EnvironmentInput sky = make_sky(256, 128, nullptr);
  const std::shared_ptr<Scene> scene = crowded_scene(sky);
  RenderOptions options = small_options();
  options.samples = 1;
  RenderSession session(1, make_renderer(0));
  render(&session, scene, options);
  const ContextPointer context = Context::acquire(0);
  size_t before = context->uploaded_bytes();
  auto sent = [&] {
    EXPECT_EQ(render(&session, scene, options).warning, "");
    const size_t bytes = context->uploaded_bytes() - before;
    before = context->uploaded_bytes();
    return bytes;
  };
  EXPECT_EQ(sent(), 0u) << "nothing changed";
  sky.color = {2, 2, 2};
  sky.world_to_env = identity3();
  scene->set_environment(sky);
  EXPECT_EQ(sent(), 0u) << "rotation and strength travel with the kernel's parameters";
  scene->set_transform(1, place(1, 3, 1.6, 1.5, 1.5, 1.5));
  const size_t moved = sent();
  EXPECT_GT(moved, 0u);
  EXPECT_LT(moved, size_t(402) * (sizeof(InstanceView) + sizeof(BvhNode) + 8))
      << "the top level, no mesh";
  RenderSession other(1, make_renderer(0));
  EXPECT_EQ(render(&other, scene, options).warning, "");
  const size_t second_view = context->uploaded_bytes() - before;
  EXPECT_LT(second_view, 200u << 10) << "a second view shares meshes and map with the first";
}

TEST_F(CudaTest, CancelsAndStartsAgain) {
  const std::shared_ptr<Scene> scene = material_scene(make_sky(64, 32, nullptr));
  RenderOptions options = small_options();
  const std::vector<float> expected = render_on_gpu(scene, options).pixels;
  RenderSession session(1, make_renderer(0));
  RenderOptions endless = options;
  endless.samples = 1 << 20;
  for (int i = 0; i < 3; ++i) {
    session.start(scene, endless);
    while (session.samples_done() < i && session.running()) std::this_thread::yield();
    session.cancel();
    EXPECT_FALSE(session.running());
    EXPECT_EQ(session.error(), "");
    EXPECT_EQ(session.warning(), "");
    EXPECT_LT(session.samples_done(), endless.samples);
  }
  EXPECT_EQ(different_pixels(render(&session, scene, options).pixels, expected), 0u);
}

TEST_F(CudaTest, TwoViewsOfOneSceneAtTheSameTime) {
  const std::shared_ptr<Scene> scene = material_scene(make_sky(64, 32, nullptr));
  RenderOptions options = small_options(), other = small_options();
  other.seed = 9;
  const std::vector<float> expected = render_on_host(scene.get(), options);
  const std::vector<float> expected_other = render_on_host(scene.get(), other);
  RenderSession first(1, make_renderer(0)), second(1, make_renderer(0));
  first.start(scene, options);
  second.start(scene, other);
  ASSERT_TRUE(first.wait(300) && second.wait(300));
  std::vector<float> pixels(expected.size());
  first.pixels(pixels.data());
  EXPECT_EQ(different_pixels(pixels, expected), 0u);
  second.pixels(pixels.data());
  EXPECT_EQ(different_pixels(pixels, expected_other), 0u);
}

TEST_F(CudaTest, NoGeometryShowsTheSky) {
  auto scene = std::make_shared<Scene>();
  set_test_camera(scene.get(), 5, 1);
  EnvironmentInput sky;
  sky.color = {0.25f, 0.5f, 1.0f};
  scene->set_environment(sky);
  const std::vector<float> pixels = render_on_gpu(scene, small_options()).pixels;
  EXPECT_FLOAT_EQ(pixels[0], 0.25f);
  EXPECT_FLOAT_EQ(pixels[1], 0.5f);
  EXPECT_FLOAT_EQ(pixels[3], 1.0f);
}

TEST_F(CudaEmulatorTest, TwoGpusAtTheSameTime) {
  const EmulatorSettings settings{{"CUEMU_DEVICES", "2"}};
  const std::shared_ptr<Scene> scene = material_scene(make_sky(64, 32, nullptr));
  const RenderOptions options = small_options();
  const std::vector<float> expected = render_on_host(scene.get(), options);
  RenderSession first(1, make_renderer(0)), second(1, make_renderer(1));
  first.start(scene, options);
  second.start(scene, options);
  ASSERT_TRUE(first.wait(300) && second.wait(300));
  EXPECT_EQ(first.warning() + second.warning(), "");
  std::vector<float> pixels(expected.size());
  first.pixels(pixels.data());
  EXPECT_EQ(different_pixels(pixels, expected), 0u);
  second.pixels(pixels.data());
  EXPECT_EQ(different_pixels(pixels, expected), 0u);
  EXPECT_EQ(first.stats().device.back(), '0');  // the emulator numbers its GPUs
  EXPECT_EQ(second.stats().device.back(), '1');
}

TEST_F(CudaTest, AnImageThatSomebodyHoldsStays) {
  const std::shared_ptr<Scene> scene = material_scene(make_sky(64, 32, nullptr));
  RenderOptions options = small_options();
  options.samples = 64;
  std::shared_ptr<const float> held;
  std::vector<float> copy(4 * size_t(options.width) * options.height);
  {
    RenderSession session(1, make_renderer(0));
    session.start(scene, options);
    while (!held && session.running()) {
      session.wait(0.001);
      held = session.device_image();
    }
    ASSERT_TRUE(held);
    std::copy_n(held.get(), copy.size(), copy.begin());
    ASSERT_TRUE(session.wait(300));
    const std::shared_ptr<const float> last = session.device_image();
    std::vector<float> pixels(copy.size());
    session.pixels(pixels.data());
    EXPECT_TRUE(std::equal(pixels.begin(), pixels.end(), last.get()));
    render(&session, scene, small_options());  // and through another render
  }
  EXPECT_TRUE(std::equal(copy.begin(), copy.end(), held.get()));
}

class CudaExecutionOrder : public CudaEmulatorTest,
                           public testing::WithParamInterface<std::pair<const char*, const char*>> {
};

TEST_P(CudaExecutionOrder, DoesNotShowInTheImage) {
  const std::shared_ptr<Scene> scene = material_scene(make_sky(64, 32, nullptr));
  const RenderOptions options = small_options();
  const std::vector<float> expected = render_on_host(scene.get(), options);
  const EmulatorSettings settings{GetParam()};
  EXPECT_EQ(different_pixels(render_on_gpu(scene, options).pixels, expected), 0u);
}

INSTANTIATE_TEST_SUITE_P(
    Emulator, CudaExecutionOrder,
    testing::Values(std::make_pair("CUEMU_LAZY", "1"),  // nothing runs before a wait
                    std::make_pair("CUEMU_ORDER", "shuffle:3"),
                    std::make_pair("CUEMU_ORDER", "reverse"),
                    std::make_pair("CUEMU_PROTECT", "1"),   // no host access
                    std::make_pair("CUEMU_FILL", "0xff")),  // NaN where not written
    [](const auto& info) { return info.param.first + std::to_string(info.index); });

}  // namespace
}  // namespace skytree::cuda
