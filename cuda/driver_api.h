// SPDX-License-Identifier: GPL-3.0-or-later
// The part of the CUDA driver API that Skytree uses, declared here so that no CUDA toolkit is
// needed to compile the host side and nothing is linked: the functions are looked up at run time in
// the libcuda.so.1 that the display driver installs. tests/test_cuda_driver.cpp compares these
// declarations with NVIDIA's cuda.h where there is one.
#pragma once

#include <cstddef>
#include <cstdint>

namespace skytree::cuda {

using Device = int;
using DevicePointer = unsigned long long;
using ContextHandle = struct ContextOpaque*;
using ModuleHandle = struct ModuleOpaque*;
using FunctionHandle = struct FunctionOpaque*;
using StreamHandle = struct StreamOpaque*;
using EventHandle = struct EventOpaque*;

/// CUresult. Only codes that are told apart have a name here; every name and text comes from the
/// driver itself.
enum Result : int {
  kSuccess = 0,
  kErrorOutOfMemory = 2,
  kErrorNotInitialized = 3,
  kErrorNoDevice = 100,
  kErrorInvalidDevice = 101,
  kErrorNoBinaryForGpu = 209,
  kErrorInvalidPtx = 218,
  kErrorUnsupportedPtxVersion = 222,
  kErrorNotReady = 600,
  kErrorIllegalAddress = 700,
  kErrorLaunchTimeout = 702,
  kErrorLaunchFailed = 719,
  kErrorSystemDriverMismatch = 803,
};

enum DeviceAttribute : int {
  kAttributeMultiprocessorCount = 16,
  kAttributeCapabilityMajor = 75,
  kAttributeCapabilityMinor = 76,
};

enum JitOption : int { kJitErrorLogBuffer = 5, kJitErrorLogBufferSizeBytes = 6 };
constexpr unsigned kStreamNonBlocking = 1;
constexpr unsigned kEventDisableTiming = 2;
// A waiting thread sleeps: the cores stay Blender's. A context's flag covers its streams alone.
constexpr unsigned kEventBlockingSync = 1;
constexpr unsigned kContextBlockingSync = 4;

// X(member, exported symbol, parameters). The plain names of functions that have a _v2 are CUDA
// 2's, with 32-bit pointers; they still exist in the library and would be called without a warning.
#define SKYTREE_CUDA_FUNCTIONS(X)                                                                  \
  X(init, "cuInit", (unsigned flags))                                                              \
  X(driver_get_version, "cuDriverGetVersion", (int* version))                                      \
  X(get_error_name, "cuGetErrorName", (Result code, const char** text))                            \
  X(get_error_string, "cuGetErrorString", (Result code, const char** text))                        \
  X(device_get_count, "cuDeviceGetCount", (int* count))                                            \
  X(device_get, "cuDeviceGet", (Device * device, int ordinal))                                     \
  X(device_get_name, "cuDeviceGetName", (char* name, int size, Device device))                     \
  X(device_get_attribute, "cuDeviceGetAttribute",                                                  \
    (int* value, DeviceAttribute attribute, Device device))                                        \
  X(device_total_memory, "cuDeviceTotalMem_v2", (size_t * bytes, Device device))                   \
  X(context_create, "cuCtxCreate_v2", (ContextHandle * context, unsigned flags, Device device))    \
  X(context_destroy, "cuCtxDestroy_v2", (ContextHandle context))                                   \
  X(context_push, "cuCtxPushCurrent_v2", (ContextHandle context))                                  \
  X(context_pop, "cuCtxPopCurrent_v2", (ContextHandle * context))                                  \
  X(module_load, "cuModuleLoadDataEx",                                                             \
    (ModuleHandle * module, const void* image, unsigned option_count, JitOption* options,          \
     void** values))                                                                               \
  X(module_unload, "cuModuleUnload", (ModuleHandle module))                                        \
  X(module_get_function, "cuModuleGetFunction",                                                    \
    (FunctionHandle * function, ModuleHandle module, const char* name))                            \
  X(memory_alloc, "cuMemAlloc_v2", (DevicePointer * pointer, size_t bytes))                        \
  X(memory_free, "cuMemFree_v2", (DevicePointer pointer))                                          \
  X(memory_get_info, "cuMemGetInfo_v2", (size_t * free, size_t * total))                           \
  X(memory_alloc_host, "cuMemAllocHost_v2", (void** pointer, size_t bytes))                        \
  X(memory_free_host, "cuMemFreeHost", (void* pointer))                                            \
  X(copy_to_device, "cuMemcpyHtoD_v2", (DevicePointer to, const void* from, size_t bytes))         \
  X(copy_to_host, "cuMemcpyDtoH_v2", (void* to, DevicePointer from, size_t bytes))                 \
  X(copy_to_host_async, "cuMemcpyDtoHAsync_v2",                                                    \
    (void* to, DevicePointer from, size_t bytes, StreamHandle stream))                             \
  X(memset_async, "cuMemsetD32Async",                                                              \
    (DevicePointer to, unsigned value, size_t count, StreamHandle stream))                         \
  X(stream_create, "cuStreamCreate", (StreamHandle * stream, unsigned flags))                      \
  X(stream_destroy, "cuStreamDestroy_v2", (StreamHandle stream))                                   \
  X(stream_synchronize, "cuStreamSynchronize", (StreamHandle stream))                              \
  X(stream_wait_event, "cuStreamWaitEvent",                                                        \
    (StreamHandle stream, EventHandle event, unsigned flags))                                      \
  X(event_create, "cuEventCreate", (EventHandle * event, unsigned flags))                          \
  X(event_destroy, "cuEventDestroy_v2", (EventHandle event))                                       \
  X(event_record, "cuEventRecord", (EventHandle event, StreamHandle stream))                       \
  X(event_synchronize, "cuEventSynchronize", (EventHandle event))                                  \
  X(launch_kernel, "cuLaunchKernel",                                                               \
    (FunctionHandle function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x, \
     unsigned block_y, unsigned block_z, unsigned shared_bytes, StreamHandle stream,               \
     void** params, void** extra))

struct DriverApi {
#define SKYTREE_CUDA_POINTER(member, symbol, parameters) Result(*member) parameters;
  SKYTREE_CUDA_FUNCTIONS(SKYTREE_CUDA_POINTER)
#undef SKYTREE_CUDA_POINTER
};

}  // namespace skytree::cuda
