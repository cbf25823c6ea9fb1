// SPDX-License-Identifier: GPL-3.0-or-later
// What the CUDA tests share. They run on a GPU, or on a libcuda.so.1 that executes PTX on the
// processor and injects faults ($SKYTREE_CUDA_DRIVER names it; it is found out by its extra export
// cuemuCounter). Without either, or without kernels in the build, they are skipped and say why.
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "cuda/context.h"
#include "cuda/kernel_image.h"

namespace skytree::cuda {

inline void* driver_symbol(const char* name) {
  const char* chosen = std::getenv("SKYTREE_CUDA_DRIVER");
  void* library = dlopen(chosen && *chosen ? chosen : "libcuda.so.1", RTLD_NOW | RTLD_LOCAL);
  void* symbol = library ? dlsym(library, name) : nullptr;
  if (library) dlclose(library);  // the driver layer's own handle keeps it loaded
  return symbol;
}

inline bool is_emulator() { return driver_symbol("cuemuCounter") != nullptr; }

/// Live objects that the emulator counts: "allocations", "contexts", "streams", "events",
/// "modules", "errors", …
inline long long emulator_counter(const char* what) {
  return reinterpret_cast<long long (*)(const char*)>(driver_symbol("cuemuCounter"))(what);
}

/// Settings of the emulator for the length of a scope; it reads them whenever cuInit is called.
class EmulatorSettings {
 public:
  EmulatorSettings(std::initializer_list<std::pair<const char*, const char*>> settings)
      : settings_(settings.begin(), settings.end()) {
    for (const auto& [name, value] : settings_) setenv(name.c_str(), value.c_str(), 1);
    reload();
  }
  ~EmulatorSettings() {
    for (const auto& [name, value] : settings_) unsetenv(name.c_str());
    reload();
  }
  EmulatorSettings(const EmulatorSettings&) = delete;
  EmulatorSettings& operator=(const EmulatorSettings&) = delete;

 private:
  static void reload() { reinterpret_cast<Result (*)(unsigned)>(driver_symbol("cuInit"))(0); }
  std::vector<std::pair<std::string, std::string>> settings_;
};

class CudaTest : public testing::Test {
 protected:
  void SetUp() override {
    setenv("CUEMU_TIMEOUT_MS", "120000",
           0);  // a kernel that hangs fails instead of blocking the run
    if (!kernel_image()) GTEST_SKIP() << "this build has no CUDA kernels (made without nvcc)";
    std::string reason;
    if (devices(&reason).empty()) GTEST_SKIP() << reason;
  }
  void TearDown() override {
    if (!is_emulator()) return;
    for (const char* kind : {"contexts", "allocations", "streams", "events", "modules"}) {
      EXPECT_EQ(emulator_counter(kind), 0) << kind << " left behind by the test";
    }
  }
};

/// For tests that only the emulator can serve.
class CudaEmulatorTest : public CudaTest {
 protected:
  void SetUp() override {
    CudaTest::SetUp();
    if (!IsSkipped() && !is_emulator())
      GTEST_SKIP() << "faults cannot be injected into a real driver";
  }
};

}  // namespace skytree::cuda
