// SPDX-License-Identifier: GPL-3.0-or-later
// Every driver call of a render made to fail: the session says why, the CPU finishes the frame,
// nothing stays behind, and the next render on the GPU works again.
#include <thread>

#include "cuda/renderer.h"
#include "cuda_test_scenes.h"
#include "cuda_test_support.h"
#include "src/kdtree_sampler.h"
#include "src/render_session.h"

namespace skytree::cuda {
namespace {

RenderOptions fault_options() {
  RenderOptions options;
  options.width = 24;
  options.height = 16;
  options.samples = 8;
  options.max_bounces = 1;
  return options;
}

std::shared_ptr<Scene> fault_scene() {
  EnvironmentInput sky = make_sky(64, 32, nullptr);
  sky.sampler = std::make_shared<KdTreeSampler>(LatLongImage{sky.texels.get(), 64, 32});
  return material_scene(sky);
}

std::vector<float> finished_pixels(RenderSession* session, const RenderOptions& options) {
  EXPECT_TRUE(session->wait(300));
  EXPECT_EQ(session->error(), "");
  EXPECT_EQ(session->samples_done(), options.samples);
  std::vector<float> pixels(4 * size_t(options.width) * options.height);
  session->pixels(pixels.data());
  return pixels;
}

/// Some samples may come from the GPU, whose hits are rounded differently: close, but for a sample
/// at an edge.
void expect_close(const std::vector<float>& pixels, const std::vector<float>& expected) {
  size_t off = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    off += !(std::fabs(pixels[i] - expected[i]) <= 1e-3f * (0.1f + std::fabs(expected[i])));
  }
  EXPECT_LE(off, pixels.size() / 100);
}

struct CallFault {
  std::string fault;     // as CUEMU_FAIL takes it
  bool must_be_noticed;  // false: what failed is cleaned up or was only asked for
};

class CudaCallFault : public CudaEmulatorTest, public testing::WithParamInterface<CallFault> {
 protected:
  static const std::vector<float>& expected(const std::shared_ptr<Scene>& scene) {
    static const std::vector<float> pixels = [&] {
      RenderSession cpu(1);
      cpu.start(scene, fault_options());
      return finished_pixels(&cpu, fault_options());
    }();
    return pixels;
  }
};

TEST_P(CudaCallFault, CpuFinishesTheFrame) {
  const std::shared_ptr<Scene> scene = fault_scene();
  RenderSession session(1, make_renderer(0));
  {
    const EmulatorSettings settings{{"CUEMU_FAIL", GetParam().fault.c_str()},
                                    {"CUEMU_LOG", "/dev/null"}};
    session.start(scene, fault_options());
    expect_close(finished_pixels(&session, fault_options()), expected(scene));
    if (GetParam().must_be_noticed) {
      EXPECT_NE(session.warning().find("failed: CUDA_ERROR_"), std::string::npos)
          << session.warning();
      EXPECT_NE(session.warning().find("The CPU finishes the frame."), std::string::npos);
      EXPECT_NE(session.stats().device.find("+ CPU"), std::string::npos);
    }
  }
  // The fault is over: the same session renders on the GPU again.
  session.start(scene, fault_options());
  expect_close(finished_pixels(&session, fault_options()), expected(scene));
  EXPECT_EQ(session.warning(), "");
}

std::vector<CallFault> call_faults() {
  std::vector<CallFault> faults;
  for (const char* call : {"cuDeviceGet", "cuDeviceGetName", "cuDeviceGetAttribute", "cuCtxCreate",
                           "cuModuleLoadDataEx", "cuModuleGetFunction", "cuMemAllocHost",
                           "cuStreamWaitEvent", "cuMemsetD32Async"}) {
    faults.push_back({std::string(call) + ":1", true});
  }
  // Calls that come often: the first, one in the middle of sending the scene, later ones between
  // passes.
  for (const char* call : {"cuMemAlloc", "cuMemcpyHtoD", "cuCtxPushCurrent"}) {
    for (const char* which : {":1", ":2", ":9", ":25"})
      faults.push_back({std::string(call) + which, true});
  }
  for (const char* call : {"cuStreamCreate", "cuEventCreate"}) {
    for (const char* which : {":1", ":2"}) faults.push_back({std::string(call) + which, true});
  }
  for (const char* call :
       {"cuLaunchKernel", "cuEventRecord", "cuEventSynchronize", "cuMemcpyDtoHAsync"}) {
    for (const char* which : {":1", ":2", ":3:719"})
      faults.push_back({std::string(call) + which, true});
  }
  for (const char* call : {"cuCtxPopCurrent", "cuStreamSynchronize", "cuMemGetInfo"}) {
    faults.push_back({std::string(call) + ":1", false});
  }
  // Everything from the second call on, as when the GPU is gone.
  for (const char* call : {"cuMemAlloc", "cuLaunchKernel", "cuMemcpyDtoHAsync", "cuCtxCreate"}) {
    faults.push_back({std::string(call) + ":2+:999", std::string(call) != "cuCtxCreate"});
  }
  return faults;
}

INSTANTIATE_TEST_SUITE_P(Driver, CudaCallFault, testing::ValuesIn(call_faults()),
                         [](const auto& info) {
                           std::string name = info.param.fault;
                           for (char& c : name) c = std::isalnum(c) ? c : '_';
                           return name;
                         });

class CudaDeviceFault
    : public CudaEmulatorTest,
      public testing::WithParamInterface<std::tuple<const char*, const char*, const char*>> {};

TEST_P(CudaDeviceFault, CpuFinishesTheFrameAndTheReasonIsGiven) {
  const auto& [setting, value, reason] = GetParam();
  const std::shared_ptr<Scene> scene = fault_scene();
  RenderSession cpu(1);
  cpu.start(scene, fault_options());
  const std::vector<float> expected = finished_pixels(&cpu, fault_options());
  {
    const EmulatorSettings settings{{setting, value}, {"CUEMU_LOG", "/dev/null"}};
    RenderSession session(1, make_renderer(0));
    session.start(scene, fault_options());
    expect_close(finished_pixels(&session, fault_options()), expected);
    EXPECT_NE(session.warning().find(reason), std::string::npos) << session.warning();
  }
  RenderSession session(1, make_renderer(0));
  session.start(scene, fault_options());
  expect_close(finished_pixels(&session, fault_options()), expected);
  EXPECT_EQ(session.warning(), "") << "the next session gets a new context";
}

INSTANTIATE_TEST_SUITE_P(
    Device, CudaDeviceFault,
    testing::Values(
        std::make_tuple("CUEMU_MEMORY", "200k", "CUDA_ERROR_OUT_OF_MEMORY"),
        std::make_tuple("CUEMU_FAIL_ALLOC", "12+", "The GPU's memory does not hold"),
        // A lost device: the launch succeeds, the next call tells, and the context stays dead.
        std::make_tuple("CUEMU_FAIL_LAUNCH", "1", "CUDA_ERROR_LAUNCH_FAILED"),
        std::make_tuple("CUEMU_FAIL_LAUNCH", "3", "CUDA_ERROR_LAUNCH_FAILED"),
        std::make_tuple("CUEMU_CAPABILITY", "7.0", "CUDA_ERROR_"),
        std::make_tuple("CUEMU_DRIVER_VERSION", "12020", "update NVIDIA's driver"),
        std::make_tuple("CUEMU_DEVICES", "0", "CUDA_ERROR_INVALID_DEVICE")),
    [](const auto& info) {
      return std::string(std::get<0>(info.param)) + "_" + std::to_string(info.index);
    });

TEST_F(CudaEmulatorTest, ALostContextDoesNotStopTheOtherView) {
  const std::shared_ptr<Scene> scene = fault_scene();
  RenderSession first(1, make_renderer(0)), second(1, make_renderer(0));
  first.start(scene, fault_options());
  const std::vector<float> expected = finished_pixels(&first, fault_options());
  {
    const EmulatorSettings settings{{"CUEMU_FAIL_LAUNCH", "1"}, {"CUEMU_LOG", "/dev/null"}};
    second.start(scene, fault_options());  // the same context, which dies now
    expect_close(finished_pixels(&second, fault_options()), expected);
    EXPECT_NE(second.warning(), "");
  }
  first.start(scene, fault_options());  // holds the dead context: falls back once …
  expect_close(finished_pixels(&first, fault_options()), expected);
  EXPECT_NE(first.warning(), "");
  first.start(scene, fault_options());  // … and is on a new one after that
  expect_close(finished_pixels(&first, fault_options()), expected);
  EXPECT_EQ(first.warning(), "");
}

TEST_F(CudaEmulatorTest, ManyRendersLeaveNothingBehind) {
  const std::shared_ptr<Scene> scene = fault_scene();
  RenderSession session(1, make_renderer(0));
  RenderOptions options = fault_options();
  options.samples = 1;
  options.width = options.height = 4;
  session.start(scene, options);
  finished_pixels(&session, options);
  const long long allocations = emulator_counter("allocations");
  for (int i = 0; i < 100; ++i) {
    options.width = 4 + i % 5;  // the film is made anew
    scene->set_transform(3, place(0, 0, 1 + 0.01 * i, 1, 1, 1));
    session.start(scene, options);
    finished_pixels(&session, options);
  }
  EXPECT_LE(emulator_counter("allocations"), allocations);
  EXPECT_EQ(session.warning(), "");
}

}  // namespace
}  // namespace skytree::cuda
