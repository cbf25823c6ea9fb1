// SPDX-License-Identifier: GPL-3.0-or-later
// Every driver call of a render made to fail: the session says why, the CPU finishes the frame,
// nothing stays behind, and the next render on the GPU works again.
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <set>
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

/// A call of the driver as the emulator names it, without the _v2 of the export.
std::string call_name(std::string symbol) {
  const size_t version = symbol.find("_v2");
  return version == std::string::npos ? symbol : symbol.substr(0, version);
}

class TemporaryFile {
 public:
  TemporaryFile() { close(mkstemp(path_)); }
  ~TemporaryFile() { unlink(path_); }
  const char* path() const { return path_; }
  int lines_with(const std::string& text) const {
    std::ifstream file(path_);
    int count = 0;
    for (std::string line; std::getline(file, line);) count += line.find(text) != std::string::npos;
    return count;
  }

 private:
  char path_[32] = "/tmp/skytree_cuda_XXXXXX";
};

/// The driver's calls, in their order, of a session that renders one frame on the GPU, its end
/// included.
std::vector<std::string> traced_render() {
  const TemporaryFile log;
  {
    const EmulatorSettings settings{{"CUEMU_TRACE", "1"}, {"CUEMU_LOG", log.path()}};
    RenderSession session(1, make_renderer(0));
    session.start(fault_scene(), fault_options());
    finished_pixels(&session, fault_options());
  }
  std::ifstream file(log.path());
  std::vector<std::string> calls;
  for (std::string line; std::getline(file, line);) {
    calls.push_back(call_name(line.substr(line.rfind(' ') + 1)));
  }
  return calls;
}

TEST_F(CudaEmulatorTest, NoKernelIsQueuedBeforeTheUploadsHaveArrived) {
  // The emulator's copies have arrived when they return; those of a GPU need not have.
  bool on_the_way = false;
  size_t uploads = 0, kernels = 0;
  for (const std::string& call : traced_render()) {
    if (call == "cuMemcpyHtoD") {
      on_the_way = true;
      ++uploads;
    } else if (call == "cuStreamSynchronize") {
      on_the_way = false;
    } else if (call == "cuLaunchKernel") {
      EXPECT_FALSE(on_the_way) << "after upload " << uploads;
      ++kernels;
    }
  }
  EXPECT_GT(uploads, 0u);
  EXPECT_GT(kernels, 0u);
}

class CudaCallFault : public CudaEmulatorTest, public testing::WithParamInterface<std::string> {
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

/// Calls that only a failed render makes: the message loses what they would have told, and no more.
void fail_after_a_failure(const std::string& call) {
  const std::string fault = "cuLaunchKernel:1 " + call + ":1";
  const TemporaryFile log;
  const EmulatorSettings settings{
      {"CUEMU_FAIL", fault.c_str()}, {"CUEMU_VERBOSE", "1"}, {"CUEMU_LOG", log.path()}};
  RenderSession session(1, make_renderer(0));
  session.start(fault_scene(), fault_options());
  finished_pixels(&session, fault_options());
  EXPECT_NE(session.warning().find("render_pass failed: CUDA"), std::string::npos)
      << session.warning();
  EXPECT_EQ(log.lines_with("injected failure: " + call), 1) << "no render makes this call";
}

/// Calls that may fail without the picture suffering: they ask, clean up or end a scope.
bool is_harmless(const std::string& call) {
  for (const char* name :
       {"cuCtxPopCurrent", "cuMemGetInfo", "cuMemFree", "cuMemFreeHost", "cuModuleUnload",
        "cuStreamDestroy", "cuEventDestroy", "cuInit", "cuGetErrorName", "cuGetErrorString"}) {
    if (call == name) return true;
  }
  return false;
}

TEST_P(CudaCallFault, CpuFinishesTheFrame) {
  const std::string call = GetParam();
  const std::vector<std::string> trace = traced_render();
  const int calls = int(std::count(trace.begin(), trace.end(), call));
  if (calls == 0) return fail_after_a_failure(call);
  const std::shared_ptr<Scene> scene = fault_scene();
  const std::vector<float> whole = expected(scene);
  std::set<int> which = {1, 2, 3, calls / 4, calls / 2, calls - 1, calls};
  for (const int n : which) {
    if (n < 1 || n > calls) continue;
    const std::string fault = call + ":" + std::to_string(n) + (n == 3 ? ":719" : "");
    SCOPED_TRACE(fault + " of " + std::to_string(calls));
    const TemporaryFile log;
    {
      const EmulatorSettings settings{
          {"CUEMU_FAIL", fault.c_str()}, {"CUEMU_VERBOSE", "1"}, {"CUEMU_LOG", log.path()}};
      RenderSession session(1, make_renderer(0));
      session.start(scene, fault_options());
      expect_close(finished_pixels(&session, fault_options()), whole);
      const bool fell_back = session.stats().device.find("+ CPU") != std::string::npos;
      EXPECT_EQ(fell_back, session.warning() != "");
      if (fell_back) {
        EXPECT_NE(session.warning().find("failed: CUDA_ERROR_"), std::string::npos)
            << session.warning();
        EXPECT_NE(session.warning().find("The CPU finishes the frame."), std::string::npos);
      } else if (n <= 3 && n < calls) {  // later ones may belong to the session's end
        EXPECT_TRUE(is_harmless(call)) << "the failure went unnoticed";
      }
    }
    // How many calls come late in a render depends on the clock; the first ones come always.
    if (n <= 3) {
      EXPECT_GE(log.lines_with("injected failure"), 1);
    }
    RenderSession next(1, make_renderer(0));
    next.start(scene, fault_options());
    expect_close(finished_pixels(&next, fault_options()), whole);
    EXPECT_EQ(next.warning(), "") << "the fault is over, and so must its effect be";
  }
}

/// Every call of the driver that a render makes, so also those that are yet to be written.
std::vector<std::string> calls_of_renders() {
  const std::set<std::string> others = {
      // CudaListingFault and CudaTransferFault in test_cuda_driver.cpp:
      "cuDeviceGetCount", "cuDeviceTotalMem", "cuDriverGetVersion", "cuMemcpyDtoH",
      // The emulator does not let them fail; without a text the code is printed.
      "cuGetErrorName", "cuGetErrorString",
      // When it fails, nothing is left that could be done.
      "cuCtxDestroy"};
  std::vector<std::string> names;
#define SKYTREE_CUDA_NAME(member, symbol, parameters) \
  if (others.count(call_name(symbol)) == 0) names.push_back(call_name(symbol));
  SKYTREE_CUDA_FUNCTIONS(SKYTREE_CUDA_NAME)
#undef SKYTREE_CUDA_NAME
  return names;
}

INSTANTIATE_TEST_SUITE_P(Driver, CudaCallFault, testing::ValuesIn(calls_of_renders()),
                         [](const auto& info) { return info.param; });

class CudaGoneFault : public CudaEmulatorTest, public testing::WithParamInterface<const char*> {};

TEST_P(CudaGoneFault, CpuFinishesTheFrame) {
  // Every call from the second on, as when the GPU is gone.
  const std::shared_ptr<Scene> scene = fault_scene();
  RenderSession cpu(1), session(1, make_renderer(0));
  cpu.start(scene, fault_options());
  const std::vector<float> expected = finished_pixels(&cpu, fault_options());
  const std::string fault = std::string(GetParam()) + ":2+:999";
  const EmulatorSettings settings{{"CUEMU_FAIL", fault.c_str()}, {"CUEMU_LOG", "/dev/null"}};
  session.start(scene, fault_options());
  expect_close(finished_pixels(&session, fault_options()), expected);
  EXPECT_NE(session.warning(), "");
}

INSTANTIATE_TEST_SUITE_P(Driver, CudaGoneFault,
                         testing::Values("cuMemAlloc", "cuLaunchKernel", "cuMemcpyDtoHAsync",
                                         "cuEventSynchronize", "cuCtxPushCurrent"));

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
