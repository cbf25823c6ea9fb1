// SPDX-License-Identifier: GPL-3.0-or-later
// A sampler's tables on a GPU.
#pragma once

#include <vector>

#include "cuda/context.h"
#include "kernel/env_sampler.h"

namespace skytree::cuda {

/// Holds copies of all arrays behind a sampler's view; view() is the same view with device
/// pointers.
class DeviceSampler {
 public:
  DeviceSampler() = default;
  DeviceSampler(const ContextPointer& context, const EnvSamplerView& host);
  const EnvSamplerView& view() const { return view_; }

 private:
  EnvSamplerView view_;
  std::vector<Buffer> tables_;
};

/// One array behind a view: where in the view its pointer stands, and its contents on the host.
struct SamplerTable {
  size_t pointer_offset;
  const void* data;
  size_t bytes;
};
std::vector<SamplerTable> sampler_tables(const EnvSamplerView& host);

}  // namespace skytree::cuda
