// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/renderer.h"

#include <algorithm>
#include <chrono>

#include "cuda/device_scene.h"
#include "cuda/kernel_parameters.h"

namespace skytree::cuda {
namespace {

/// How long a pass shall take: cancelling waits for one, and a display driver stops kernels that
/// run for seconds.
constexpr double kPassSeconds = 0.04;
constexpr int kMaxPassSamples = 64;

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// What a session keeps on the GPU from one render to the next.
class GpuState {
 public:
  explicit GpuState(ContextPointer context)
      : context_(context),
        scene_(context),
        compute_(context),
        copy_(context),
        rendered_(context),
        snapshot_taken_(context),
        copied_(context) {}

  const ContextPointer& context() const { return context_; }

  void render(const DeviceJob& job, const std::atomic<bool>& cancel,
              const DeviceRenderer::Deliver& deliver);

 private:
  void reserve_film(size_t bytes);
  void start_copy();

  ContextPointer context_;
  DeviceScene scene_;
  // Counters, then pixels: one copy brings both.
  Buffer film_, snapshot_;
  std::unique_ptr<PinnedBuffer> host_film_;
  Stream compute_, copy_;  // after the buffers, so that they are drained before the buffers go
  Event rendered_, snapshot_taken_, copied_;
};

void GpuState::reserve_film(size_t bytes) {
  if (film_.bytes() == bytes) return;
  film_ = Buffer();
  snapshot_ = Buffer();
  host_film_.reset();
  film_ = Buffer(context_, bytes);
  snapshot_ = Buffer(context_, bytes);
  host_film_ = std::make_unique<PinnedBuffer>(context_, bytes);
}

/// Brings the film as it is after the passes queued so far to the host, while later passes render.
void GpuState::start_copy() {
  copied_.make_wait(compute_);  // the copy before must have left the snapshot
  copy_on_device(*context_, snapshot_, film_, compute_);
  snapshot_taken_.record(compute_);
  snapshot_taken_.make_wait(copy_);
  copy_to_host(*context_, *host_film_, snapshot_, copy_);
  copied_.record(copy_);
}

void GpuState::render(const DeviceJob& job, const std::atomic<bool>& cancel,
                      const DeviceRenderer::Deliver& deliver) {
  if (!scene_.update(job.scene, job.sampler, job.settings.filter_table, cancel)) return;
  constexpr size_t kHeader = 64;  // of the film: the counters, padded
  static_assert(sizeof(PassCounters) <= kHeader);
  reserve_film(kHeader + sizeof(FilmPixel) * size_t(job.width) * job.height);
  clear(*context_, film_, compute_);

  PassParameters pass = {};
  pass.scene = scene_.view();
  pass.tracer = scene_.tracer();
  pass.settings = job.settings;
  pass.settings.filter_table = scene_.filter_table();
  pass.x0 = job.x0;
  pass.y0 = job.y0;
  pass.width = job.width;
  pass.height = job.height;
  pass.counters = film_.writable<PassCounters>();
  pass.film = reinterpret_cast<FilmPixel*>(film_.writable<char>() + kHeader);
  const unsigned blocks = unsigned((job.width + kBlockWidth - 1) / kBlockWidth) *
                          unsigned((job.height + kBlockHeight - 1) / kBlockHeight);

  PassCounters delivered = {};
  int queued = 0;     // samples of passes handed to the GPU
  int in_flight = 0;  // samples that the copy on its way will have
  auto collect = [&] {
    if (in_flight == 0) return;
    copied_.synchronize();
    const PassCounters total = *host_film_->as<PassCounters>();
    deliver(reinterpret_cast<const FilmPixel*>(host_film_->as<char>() + kHeader), in_flight,
            {total.rays - delivered.rays, total.rejected - delivered.rejected});
    delivered = total;
    in_flight = 0;
  };

  double seconds_per_sample = 0.0;
  while (queued < job.samples && !cancel) {
    // 1, 1, 2, 4, … as on the CPU, but no longer than a pass shall take.
    int count = std::min({std::max(queued, 1), kMaxPassSamples, job.samples - queued});
    if (seconds_per_sample > 0.0) {
      count = std::clamp(int(kPassSeconds / seconds_per_sample), 1, count);
    }
    pass.first_sample = uint32_t(job.first_sample + queued);
    pass.sample_count = uint32_t(count);
    const double started = now();
    launch(*context_, compute_, "render_pass", blocks, kThreads, pass);
    rendered_.record(compute_);
    collect();  // the host takes in the pass before while the GPU renders this one
    rendered_.synchronize();
    seconds_per_sample = (now() - started) / count;
    queued += count;
    start_copy();
    in_flight = queued;
  }
  collect();
}

class Renderer : public DeviceRenderer {
 public:
  explicit Renderer(int ordinal) : ordinal_(ordinal), name_("CUDA:" + std::to_string(ordinal)) {}

  std::string name() const override { return name_; }

  void render(const DeviceJob& job, const std::atomic<bool>& cancel,
              const Deliver& deliver) override {
    try {
      if (!state_) state_ = std::make_unique<GpuState>(Context::acquire(ordinal_));
      name_ = state_->context()->device_name();
      state_->render(job, cancel, deliver);
    } catch (...) {
      // Whatever state the GPU is in, the next render starts from nothing, and so do other sessions
      // if the context is lost.
      if (state_ && !state_->context()->healthy()) state_->context()->mark_lost();
      state_.reset();
      throw;
    }
  }

 private:
  const int ordinal_;
  std::string name_;
  std::unique_ptr<GpuState> state_;
};

}  // namespace

std::unique_ptr<DeviceRenderer> make_renderer(int ordinal) {
  return std::make_unique<Renderer>(ordinal);
}

}  // namespace skytree::cuda
