// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/embree_api.h"

#include <dlfcn.h>

#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

namespace skytree {
namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr int kOpenFlags = RTLD_NOW | RTLD_LOCAL;  // ASan's allocator does not survive deep binding
#else
constexpr int kOpenFlags = RTLD_NOW | RTLD_LOCAL | RTLD_DEEPBIND;
#endif

std::string folder_of_this_module() {
  Dl_info info;
  if (!dladdr(reinterpret_cast<void*>(&folder_of_this_module), &info) || !info.dli_fname)
    return ".";
  const std::string path = info.dli_fname;
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : path.substr(0, slash);
}

void* open_library() {
  std::vector<std::string> candidates;
  if (const char* chosen = std::getenv("SKYTREE_EMBREE"); chosen && *chosen) {
    candidates = {chosen};  // a library named by hand is not silently replaced by another
  } else {
    candidates = {folder_of_this_module() + "/lib/libembree3.so.3", "libembree3.so.3"};
  }
  std::string reasons;
  for (const std::string& path : candidates) {
    if (void* library = dlopen(path.c_str(), kOpenFlags)) return library;
    const char* reason = dlerror();
    reasons += std::string("\n  ") + (reason ? reason : path.c_str());
  }
  throw std::runtime_error(
      "Embree 3 could not be loaded; install Debian's libembree3-3 or set SKYTREE_EMBREE to the "
      "path of "
      "libembree3.so.3. Tried:" +
      reasons);
}

const char* error_name(RTCError code) {
  switch (code) {
    case RTC_ERROR_INVALID_ARGUMENT:
      return "invalid argument";
    case RTC_ERROR_INVALID_OPERATION:
      return "invalid operation";
    case RTC_ERROR_OUT_OF_MEMORY:
      return "out of memory";
    case RTC_ERROR_UNSUPPORTED_CPU:
      return "unsupported processor";
    case RTC_ERROR_CANCELLED:
      return "cancelled";
    default:
      return "unknown error";
  }
}

EmbreeApi load() {
  void* library = open_library();
  EmbreeApi api = {};
#define SKYTREE_EMBREE_LOOKUP(name)                                             \
  api.name = reinterpret_cast<decltype(api.name)>(dlsym(library, "rtc" #name)); \
  if (!api.name)                                                                \
    throw std::runtime_error("the Embree library lacks rtc" #name "; Embree 3.13 is needed");
  SKYTREE_EMBREE_FUNCTIONS(SKYTREE_EMBREE_LOOKUP)
#undef SKYTREE_EMBREE_LOOKUP
  api.device = api.NewDevice("start_threads=0,set_affinity=0");
  if (!api.device) {
    throw std::runtime_error(std::string("Embree: ") + error_name(api.GetDeviceError(nullptr)) +
                             " while opening the device");
  }
  const long major = api.GetDeviceProperty(api.device, RTC_DEVICE_PROPERTY_VERSION_MAJOR);
  if (major != 3) {
    throw std::runtime_error("Embree 3 is needed, but the library that was loaded is version " +
                             std::to_string(major) + "; unset or correct SKYTREE_EMBREE");
  }
  return api;
}

}  // namespace

const EmbreeApi& embree() {
  static const EmbreeApi api = load();  // a failed load is tried again by the next call
  return api;
}

void check_embree(const char* doing) {
  const EmbreeApi& api = embree();
  const RTCError code = api.GetDeviceError(api.device);
  if (code != RTC_ERROR_NONE) {
    throw std::runtime_error(std::string(doing) + ": Embree reports " + error_name(code));
  }
}

EmbreeScene new_embree_scene() {
  const EmbreeApi& api = embree();
  EmbreeScene scene(api.NewScene(api.device));
  // Robust: rays through shared edges must not slip between two triangles.
  api.SetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  api.SetSceneBuildQuality(scene.get(), RTC_BUILD_QUALITY_MEDIUM);
  return scene;
}

bool commit_embree_scene(RTCScene scene, const std::atomic<bool>& cancel) {
  const EmbreeApi& api = embree();
  auto go_on = [](void* flag, double) {
    return !static_cast<const std::atomic<bool>*>(flag)->load();
  };
  api.SetSceneProgressMonitorFunction(scene, go_on, const_cast<std::atomic<bool>*>(&cancel));
  api.CommitScene(scene);
  api.SetSceneProgressMonitorFunction(scene, nullptr, nullptr);
  const RTCError code = api.GetDeviceError(api.device);
  if (code == RTC_ERROR_CANCELLED) return false;
  if (code != RTC_ERROR_NONE) {
    throw std::runtime_error(std::string("building the ray-tracing tree: Embree reports ") +
                             error_name(code));
  }
  return true;
}

}  // namespace skytree
