// SPDX-License-Identifier: GPL-3.0-or-later
// The driver layer: declarations, device list, error messages, ownership.
#include <numeric>
#include <tuple>

#include "cuda/kernel_parameters.h"
#include "cuda_test_support.h"

#if __has_include(<cuda.h>)
#include <cuda.h>
#define SKYTREE_HAVE_CUDA_H 1
#endif

namespace skytree::cuda {
namespace {

#ifdef SKYTREE_HAVE_CUDA_H

template <class... Ours, class... Theirs>
constexpr bool same_call(Result (*)(Ours...), CUresult (*)(Theirs...)) {
  if constexpr (sizeof...(Ours) != sizeof...(Theirs)) {
    return false;
  } else {
    return ((sizeof(Ours) == sizeof(Theirs) &&
             std::is_pointer_v<Ours> == std::is_pointer_v<Theirs>)&&...);
  }
}

TEST(CudaDriverApi, DeclarationsAgreeWithCudaH) {
  const DriverApi* api = nullptr;
  static_assert(same_call(decltype(api->memory_alloc){}, decltype(&::cuMemAlloc){}));
  static_assert(same_call(decltype(api->memory_get_info){}, decltype(&::cuMemGetInfo){}));
  static_assert(same_call(decltype(api->device_total_memory){}, decltype(&::cuDeviceTotalMem){}));
  static_assert(
      same_call(decltype(api->device_get_attribute){}, decltype(&::cuDeviceGetAttribute){}));
  static_assert(same_call(decltype(api->module_load){}, decltype(&::cuModuleLoadDataEx){}));
  static_assert(
      same_call(decltype(api->module_get_function){}, decltype(&::cuModuleGetFunction){}));
  static_assert(same_call(decltype(api->copy_to_device){}, decltype(&::cuMemcpyHtoD){}));
  static_assert(same_call(decltype(api->copy_to_host_async){}, decltype(&::cuMemcpyDtoHAsync){}));
  static_assert(same_call(decltype(api->memset_async){}, decltype(&::cuMemsetD32Async){}));
  static_assert(same_call(decltype(api->stream_create){}, decltype(&::cuStreamCreate){}));
  static_assert(same_call(decltype(api->stream_wait_event){}, decltype(&::cuStreamWaitEvent){}));
  static_assert(same_call(decltype(api->event_create){}, decltype(&::cuEventCreate){}));
  static_assert(same_call(decltype(api->launch_kernel){}, decltype(&::cuLaunchKernel){}));

  static_assert(int(kErrorOutOfMemory) == CUDA_ERROR_OUT_OF_MEMORY);
  static_assert(int(kErrorNotInitialized) == CUDA_ERROR_NOT_INITIALIZED);
  static_assert(int(kErrorNoDevice) == CUDA_ERROR_NO_DEVICE);
  static_assert(int(kErrorInvalidDevice) == CUDA_ERROR_INVALID_DEVICE);
  static_assert(int(kErrorNoBinaryForGpu) == CUDA_ERROR_NO_BINARY_FOR_GPU);
  static_assert(int(kErrorInvalidPtx) == CUDA_ERROR_INVALID_PTX);
  static_assert(int(kErrorUnsupportedPtxVersion) == CUDA_ERROR_UNSUPPORTED_PTX_VERSION);
  static_assert(int(kErrorIllegalAddress) == CUDA_ERROR_ILLEGAL_ADDRESS);
  static_assert(int(kErrorLaunchTimeout) == CUDA_ERROR_LAUNCH_TIMEOUT);
  static_assert(int(kErrorLaunchFailed) == CUDA_ERROR_LAUNCH_FAILED);
  static_assert(int(kErrorSystemDriverMismatch) == CUDA_ERROR_SYSTEM_DRIVER_MISMATCH);
  static_assert(int(kAttributeCapabilityMajor) == CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR);
  static_assert(int(kAttributeCapabilityMinor) == CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR);
  static_assert(int(kAttributeMultiprocessorCount) == CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT);
  static_assert(int(kJitErrorLogBuffer) == CU_JIT_ERROR_LOG_BUFFER);
  static_assert(int(kJitErrorLogBufferSizeBytes) == CU_JIT_ERROR_LOG_BUFFER_SIZE_BYTES);
  static_assert(kStreamNonBlocking == CU_STREAM_NON_BLOCKING);
  static_assert(kEventDisableTiming == CU_EVENT_DISABLE_TIMING);
  static_assert(kEventBlockingSync == CU_EVENT_BLOCKING_SYNC);
  static_assert(kContextBlockingSync == CU_CTX_SCHED_BLOCKING_SYNC);
}

#else
TEST(CudaDriverApi, DeclarationsAgreeWithCudaH) { GTEST_SKIP() << "no CUDA toolkit here"; }
#endif

TEST_F(CudaTest, DevicesHaveNamesAndProperties) {
  for (const DeviceInfo& device : devices()) {
    EXPECT_FALSE(device.name.empty());
    EXPECT_GE(device.capability_major, 5);
    EXPECT_GT(device.memory_bytes, size_t(1) << 20);
    EXPECT_GT(device.multiprocessors, 0);
  }
  EXPECT_GE(driver_version(), 11000);
}

TEST_F(CudaTest, BuffersCarryData) {
  const ContextPointer context = Context::acquire(0);
  std::vector<int> numbers(1000), back(1000);
  std::iota(numbers.begin(), numbers.end(), 7);
  Buffer first(context, numbers.data(), numbers.size() * sizeof(int));
  Buffer second = std::move(first);
  EXPECT_EQ(first.pointer(), 0u);
  second.download(back.data(), back.size() * sizeof(int));
  EXPECT_EQ(numbers, back);
  const Buffer none(context, 0);
  EXPECT_EQ(none.pointer(), 0u);
}

TEST_F(CudaTest, ContextIsSharedWhileUsedAndMadeAnewWhenLost) {
  const ContextPointer context = Context::acquire(0);
  EXPECT_EQ(Context::acquire(0), context);
  context->mark_lost();
  const ContextPointer other = Context::acquire(0);
  EXPECT_NE(other, context);
  EXPECT_EQ(Context::acquire(0), other);
}

TEST_F(CudaTest, UnknownKernelIsNamed) {
  const ContextPointer context = Context::acquire(0);
  try {
    context->function("no_such_kernel");
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("no_such_kernel"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("CUDA_ERROR_NOT_FOUND"), std::string::npos);
  }
}

TEST_F(CudaEmulatorTest, ListsSeveralGpus) {
  const EmulatorSettings settings{{"CUEMU_DEVICES", "3"}, {"CUEMU_CAPABILITY", "8.6"}};
  const std::vector<DeviceInfo> found = devices();
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found[2].ordinal, 2);
  EXPECT_EQ(found[2].capability_minor, 6);
  const ContextPointer third = Context::acquire(2);
  EXPECT_NE(third, Context::acquire(0));
}

TEST_F(CudaEmulatorTest, ReadingBeyondABufferIsFound) {
  // What makes the other tests here tests of bounds, too.
  const EmulatorSettings settings{{"CUEMU_LOG", "/dev/null"}};
  const ContextPointer context = Context::acquire(0);
  const std::vector<Vec3> up(64, Vec3{0, 0, 1});
  const Buffer directions(context, up.data(), up.size() * sizeof(Vec3));
  const Buffer pdf(context, 1024 * sizeof(float));
  const Stream stream(context);
  const PdfParameters parameters = {EnvSamplerView(), directions.as<Vec3>(), pdf.writable<float>(),
                                    1024};
  launch(*context, stream, "evaluate_pdf", 1024 / kThreads, kThreads, parameters);
  try {
    stream.synchronize();
    ADD_FAILURE() << "not noticed";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), kErrorIllegalAddress) << error.what();
  }
  context->mark_lost();
}

TEST_F(CudaEmulatorTest, NoGpuIsSaid) {
  const EmulatorSettings settings{{"CUEMU_DEVICES", "0"}};
  std::string reason;
  EXPECT_TRUE(devices(&reason).empty());
  EXPECT_NE(reason.find("no GPU"), std::string::npos) << reason;
}

class CudaListingFault : public CudaEmulatorTest,
                         public testing::WithParamInterface<const char*> {};

TEST_P(CudaListingFault, IsTheReasonWhyThereAreNoGpus) {
  const EmulatorSettings settings{{"CUEMU_FAIL", GetParam()}, {"CUEMU_LOG", "/dev/null"}};
  std::string reason;
  EXPECT_TRUE(devices(&reason).empty());
  EXPECT_NE(reason.find("failed: CUDA_ERROR_UNKNOWN"), std::string::npos) << reason;
}

INSTANTIATE_TEST_SUITE_P(Driver, CudaListingFault,
                         testing::Values("cuDeviceGetCount:1", "cuDeviceGet:1", "cuDeviceGetName:1",
                                         "cuDeviceGetAttribute:1", "cuDeviceGetAttribute:3",
                                         "cuDeviceTotalMem:1"));

TEST_F(CudaEmulatorTest, CudaTransferFault) {
  const ContextPointer context = Context::acquire(0);
  const Buffer buffer(context, 16);
  const EmulatorSettings settings{{"CUEMU_FAIL", "cuMemcpyDtoH:1 cuDriverGetVersion:1"},
                                  {"CUEMU_LOG", "/dev/null"}};
  int number;
  EXPECT_THROW(buffer.download(&number, sizeof number), Error);
  EXPECT_NO_THROW(buffer.download(&number, sizeof number));
  EXPECT_THROW(driver_version(), Error);
}

struct Fault {
  const char* setting;
  const char* value;
  const char* cause;
  const char* remedy;
};

class CudaContextFault : public CudaEmulatorTest, public testing::WithParamInterface<Fault> {};

TEST_P(CudaContextFault, NamesCauseAndRemedy) {
  const Fault& fault = GetParam();
  const EmulatorSettings settings{{fault.setting, fault.value}, {"CUEMU_LOG", "/dev/null"}};
  try {
    const ContextPointer context = Context::acquire(0);
    const Buffer buffer(context, size_t(3) << 20);
    FAIL() << "no error";
  } catch (const std::runtime_error& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find(fault.cause), std::string::npos) << text;
    EXPECT_NE(text.find(fault.remedy), std::string::npos) << text;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Faults, CudaContextFault,
    testing::Values(
        Fault{"CUEMU_FAIL", "cuDeviceGet:1:101", "CUDA_ERROR_INVALID_DEVICE", "devices()"},
        Fault{"CUEMU_FAIL", "cuDeviceGetName:1", "CUDA_ERROR_UNKNOWN", "choose the CPU"},
        Fault{"CUEMU_FAIL", "cuDeviceGetAttribute:1", "CUDA_ERROR_UNKNOWN", "choose the CPU"},
        Fault{"CUEMU_FAIL", "cuCtxCreate:1:2", "CUDA_ERROR_OUT_OF_MEMORY", "smaller"},
        Fault{"CUEMU_FAIL", "cuCtxPushCurrent:1:201", "CUDA_ERROR_INVALID_CONTEXT", "CPU"},
        Fault{"CUEMU_FAIL", "cuModuleLoadDataEx:1:209", "CUDA_ERROR_NO_BINARY_FOR_GPU",
              "architecture"},
        Fault{"CUEMU_CAPABILITY", "5.2", "CUDA_ERROR_", "sm_75"},
        Fault{"CUEMU_DRIVER_VERSION", "11080", "CUDA_ERROR_UNSUPPORTED_PTX_VERSION",
              "update NVIDIA's driver"},
        Fault{"CUEMU_MEMORY", "1M", "CUDA_ERROR_OUT_OF_MEMORY", "3 MB"}),
    [](const testing::TestParamInfo<Fault>& info) {
      std::string name = std::string(info.param.setting) + "_" + info.param.value;
      for (char& c : name) c = std::isalnum(c) ? c : '_';
      return name;
    });

}  // namespace
}  // namespace skytree::cuda
