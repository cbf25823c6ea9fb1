// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/driver.h"

#include <dlfcn.h>

#include <cstdlib>
#include <mutex>

#include "cuda/kernel_image.h"

namespace skytree::cuda {
namespace {

// Set once the library is open, before cuInit: error texts are wanted for a failed cuInit, too.
DriverApi table = {};
bool opened = false;
bool initialised = false;
std::mutex loading;

void open_library() {
  const char* chosen = std::getenv("SKYTREE_CUDA_DRIVER");
  const std::string path = chosen && *chosen ? chosen : "libcuda.so.1";
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    const char* reason = dlerror();
    throw std::runtime_error(std::string("NVIDIA's driver could not be loaded (") +
                             (reason ? reason : path.c_str()) +
                             "). Install NVIDIA's display driver, or choose the CPU as device.");
  }
  DriverApi api = {};
#define SKYTREE_CUDA_LOOKUP(member, symbol, parameters)                                      \
  api.member = reinterpret_cast<decltype(api.member)>(dlsym(library, symbol));               \
  if (!api.member) {                                                                         \
    dlclose(library);                                                                        \
    throw std::runtime_error("The driver library " + path +                                  \
                             " lacks " symbol                                                \
                             ": NVIDIA's driver is too old. Update it, or choose the CPU."); \
  }
  SKYTREE_CUDA_FUNCTIONS(SKYTREE_CUDA_LOOKUP)
#undef SKYTREE_CUDA_LOOKUP
  table = api;
  opened = true;
}

std::string version_text(int version) {
  return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

std::string remedy(Result code) {
  switch (code) {
    case kErrorOutOfMemory:
      return "The GPU's memory does not hold the scene and the image: close other programs that "
             "use the GPU, or use "
             "smaller textures and a smaller HDRI.";
    case kErrorNoDevice:
    case kErrorInvalidDevice:
      return "No such NVIDIA GPU: look at skytree_core.devices(), and whether CUDA_VISIBLE_DEVICES "
             "hides it.";
    case kErrorNoBinaryForGpu:
      return "The kernels were not built for this GPU's architecture: build Skytree with PTX, or "
             "with a newer CUDA "
             "toolkit.";
    case kErrorInvalidPtx:
    case kErrorUnsupportedPtxVersion:
    case kErrorSystemDriverMismatch: {
      int version = 0;
      if (opened) table.driver_get_version(&version);
      return "The driver speaks CUDA " + version_text(version) +
             ", the kernels were built with CUDA " + version_text(kernel_toolkit_version()) +
             ": update NVIDIA's driver.";
    }
    case kErrorIllegalAddress:
    case kErrorLaunchFailed:
      return "A kernel failed and its context is lost; starting the render again makes a new one. "
             "Please report this "
             "with the scene.";
    case kErrorLaunchTimeout:
      return "The display driver stopped a kernel that ran too long: render on a GPU without a "
             "display, or lower the "
             "resolution.";
    default:
      return "If restarting the render does not help: restart the computer's driver, or choose the "
             "CPU as device.";
  }
}

std::string describe(Result code, const std::string& doing) {
  const char* name = nullptr;
  const char* text = nullptr;
  if (opened) {
    table.get_error_name(code, &name);
    table.get_error_string(code, &text);
  }
  return doing + " failed: " + (name ? name : "CUDA error " + std::to_string(code)) +
         (text ? std::string(" (") + text + "). " : ". ") + remedy(code);
}

}  // namespace

Error::Error(Result code, const std::string& doing)
    : std::runtime_error(describe(code, doing)), code_(code) {}

const DriverApi& driver() {
  const std::lock_guard<std::mutex> lock(loading);
  if (!opened) open_library();
  if (!initialised) {
    check(table.init(0), "Starting NVIDIA's driver (cuInit)");
    initialised = true;
  }
  return table;
}

std::vector<DeviceInfo> devices(std::string* reason) {
  std::vector<DeviceInfo> found;
  try {
    const DriverApi& api = driver();
    int count = 0;
    check(api.device_get_count(&count), "Counting GPUs (cuDeviceGetCount)");
    for (int ordinal = 0; ordinal < count; ++ordinal) {
      Device device;
      check(api.device_get(&device, ordinal), "Opening a GPU (cuDeviceGet)");
      char name[256] = "";
      check(api.device_get_name(name, sizeof name, device),
            "Reading a GPU's name (cuDeviceGetName)");
      DeviceInfo info = {ordinal, name, 0, 0, 0, 0};
      const char* doing = "Reading a GPU's properties (cuDeviceGetAttribute)";
      check(api.device_get_attribute(&info.capability_major, kAttributeCapabilityMajor, device),
            doing);
      check(api.device_get_attribute(&info.capability_minor, kAttributeCapabilityMinor, device),
            doing);
      check(api.device_get_attribute(&info.multiprocessors, kAttributeMultiprocessorCount, device),
            doing);
      check(api.device_total_memory(&info.memory_bytes, device),
            "Reading a GPU's memory (cuDeviceTotalMem)");
      found.push_back(info);
    }
    if (found.empty() && reason) *reason = "NVIDIA's driver reports no GPU.";
  } catch (const std::runtime_error& failure) {
    found.clear();
    if (reason) *reason = failure.what();
  }
  return found;
}

int driver_version() {
  int version = 0;
  check(driver().driver_get_version(&version), "Reading the driver's version (cuDriverGetVersion)");
  return version;
}

}  // namespace skytree::cuda
