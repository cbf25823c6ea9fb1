// SPDX-License-Identifier: GPL-3.0-or-later
// The part of RenderSession that lets a device render and goes on from what it left.
#include "src/render_session.h"

namespace skytree {

/// False if the threads have to finish the frame.
bool RenderSession::render_on_device() {
  DeviceJob job;
  job.scene = scene_->parts(options_.width, options_.height);
  job.sampler = options_.sampler ? options_.sampler : job.scene.sampler;
  job.settings = job_.settings;
  job.x0 = options_.x0;
  job.y0 = options_.y0;
  job.width = region_width();
  job.height = region_height();
  job.first_sample = options_.first_sample;
  job.samples = options_.samples;
  job.control_variate = uses_control_variate();
  job.product_sampling = options_.product_sampling;
  std::string failure;
  try {
    device_->render(
        job, cancel_,
        [this](std::shared_ptr<const float> image, int done, const PassCounters& counters) {
          take_device_image(std::move(image), done, counters);
        });
  } catch (const std::exception& error) {
    failure = error.what();
  }
  std::lock_guard<std::mutex> lock(mutex_);
  stats_.device = device_->name();
  if (failure.empty()) {
    plan_passes(options_.samples);
    return true;
  }
  warning_ = failure + " The CPU finishes the frame.";
  stats_.device += " + CPU";
  resume_from_device_image();
  plan_passes(samples_done_);
  return false;
}

/// Sums again from the means: what a float rounds is far below a sample's noise.
void RenderSession::resume_from_device_image() {
  film_.assign(size_t(region_width()) * region_height(), Pixel());
  if (device_image_) {
    const float* mean = device_image_.get();
    const int count = samples_done_;
    for (Pixel& pixel : film_) {
      for (double& sum : pixel.radiance) sum = double(*mean++) * count;
      pixel.alpha = double(*mean++) * count;
      pixel.count = uint32_t(count);
    }
  }
  on_device_ = false;
  device_image_.reset();
}

void RenderSession::take_device_image(std::shared_ptr<const float> image, int samples_done,
                                      const PassCounters& counters) {
  std::lock_guard<std::mutex> lock(mutex_);
  device_image_ = std::move(image);
  samples_done_ = samples_done;
  stats_.rays += counters.rays;
  stats_.rejected_samples += counters.rejected;
}

}  // namespace skytree
