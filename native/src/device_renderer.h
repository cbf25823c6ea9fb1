// SPDX-License-Identifier: GPL-3.0-or-later
// What a RenderSession asks of a device other than the CPU's own cores.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>

#include "kernel/path.h"
#include "src/scene_parts.h"

namespace skytree {

struct DeviceJob {
  SceneParts scene;
  std::shared_ptr<const EnvironmentSampler> sampler;  // null: uniform
  RenderSettings settings;                            // filter_table on the host
  int x0, y0, width, height;                          // region, pixels
  int first_sample, samples;
  bool control_variate, product_sampling;
};

class DeviceRenderer {
 public:
  /// Means of `samples_done` samples of each pixel, RGBA, bottom row first, and what happened since
  /// the call before. The image is the receiver's for as long as it holds it, and does not change.
  using Deliver = std::function<void(std::shared_ptr<const float> image, int samples_done,
                                     const PassCounters&)>;

  virtual ~DeviceRenderer() = default;

  /// As the maker calls it, once it was used; before that as it was asked for.
  virtual std::string name() const = 0;

  /// Renders all samples, or until `cancel`; delivers after each pass. Throws std::runtime_error
  /// with cause and remedy when the device fails: what was delivered before stays valid.
  virtual void render(const DeviceJob& job, const std::atomic<bool>& cancel,
                      const Deliver& deliver) = 0;
};

}  // namespace skytree
