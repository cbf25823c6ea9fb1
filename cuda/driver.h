// SPDX-License-Identifier: GPL-3.0-or-later
// Opens NVIDIA's driver library at run time and turns its error codes into exceptions that name
// cause and remedy.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "cuda/driver_api.h"

namespace skytree::cuda {

/// A driver call that failed. what() holds what was being done, CUDA's own name and text for the
/// code, and a remedy.
class Error : public std::runtime_error {
 public:
  Error(Result code, const std::string& doing);
  Result code() const { return code_; }

 private:
  Result code_;
};

/// The driver's functions, loaded and initialised on first use; later calls are cheap. Searches
/// $SKYTREE_CUDA_DRIVER (a path), else libcuda.so.1. Throws std::runtime_error or Error with cause
/// and remedy; a failure is tried again by the next call, so that a driver that was repaired needs
/// no restart.
const DriverApi& driver();

/// Throws Error unless `code` is success. `doing` completes "… failed".
inline void check(Result code, const char* doing) {
  if (code != kSuccess) throw Error(code, doing);
}

/// What a GPU is called and has.
struct DeviceInfo {
  int ordinal;
  std::string name;
  int capability_major, capability_minor;
  size_t memory_bytes;
  int multiprocessors;
};

/// The GPUs that the driver offers; empty where there is no driver or no GPU, and then `reason` (if
/// not null) says why.
std::vector<DeviceInfo> devices(std::string* reason = nullptr);

/// Version of the CUDA that the installed driver speaks, as 1000 * major + 10 * minor.
int driver_version();

}  // namespace skytree::cuda
