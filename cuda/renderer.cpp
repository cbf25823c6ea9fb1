// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/renderer.h"

#include <algorithm>
#include <chrono>
#include <utility>
#include <vector>

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
  void reserve_film(size_t pixels);
  void start_copy(size_t pixels, int samples);
  std::shared_ptr<PinnedBuffer> free_image(size_t bytes);
  TileControls pilot(const DeviceJob& job, const RenderSettings& settings);

  ContextPointer context_;
  DeviceScene scene_;
  // Counters, then sums of each pixel; counters, then means: one copy brings both to the host.
  Buffer film_, snapshot_;
  // Page-locked images, those that somebody still looks at among them.
  std::vector<std::shared_ptr<PinnedBuffer>> images_;
  std::shared_ptr<PinnedBuffer> arriving_;
  Buffer controls_;        // a float per tile
  Stream compute_, copy_;  // after the buffers, so that they are drained before the buffers go
  Event rendered_, snapshot_taken_, copied_;
};

constexpr size_t kHeader = 64;  // of film and snapshot: the counters, padded
static_assert(sizeof(PassCounters) <= kHeader);

void GpuState::reserve_film(size_t pixels) {
  const size_t bytes = kHeader + sizeof(FilmPixel) * pixels;
  if (film_.bytes() == bytes) return;
  film_ = Buffer();
  snapshot_ = Buffer();
  images_.clear();
  film_ = Buffer(context_, bytes);
  snapshot_ = Buffer(context_, kHeader + sizeof(Rgba) * pixels);
  clear(*context_, snapshot_, compute_);  // the header's padding is copied, too
}

/// Page-locked memory that nobody looks at. Allocating it takes milliseconds, so a few are kept.
std::shared_ptr<PinnedBuffer> GpuState::free_image(size_t bytes) {
  constexpr size_t kKept = 4;  // shown, held by the session, arriving, and one to spare
  std::shared_ptr<PinnedBuffer> found;
  for (size_t i = images_.size(); i-- > 0;) {
    if (images_[i].use_count() > 1) continue;
    if (!found) {
      found = images_[i];
    } else if (images_.size() > kKept) {
      images_.erase(images_.begin() + std::ptrdiff_t(i));
    }
  }
  if (!found) images_.push_back(found = std::make_shared<PinnedBuffer>(context_, bytes));
  return found;
}

/// Brings the means after the passes queued so far to the host, while later passes render.
void GpuState::start_copy(size_t pixels, int samples) {
  arriving_ = free_image(snapshot_.bytes());
  copied_.make_wait(compute_);  // the copy before must have left the snapshot
  const ResolveParameters resolve = {reinterpret_cast<const FilmPixel*>(film_.as<char>() + kHeader),
                                     film_.as<PassCounters>(),
                                     reinterpret_cast<Rgba*>(snapshot_.writable<char>() + kHeader),
                                     snapshot_.writable<PassCounters>(),
                                     uint32_t(pixels),
                                     1.0 / samples};
  launch(*context_, compute_, "resolve_film", unsigned((pixels + kThreads - 1) / kThreads),
         kThreads, resolve);
  snapshot_taken_.record(compute_);
  snapshot_taken_.make_wait(copy_);
  copy_to_host(*context_, *arriving_, snapshot_, copy_);
  copied_.record(copy_);
}

/// The control variate's factor for every tile that the region touches.
TileControls GpuState::pilot(const DeviceJob& job, const RenderSettings& settings) {
  PilotParameters pilot = {};
  pilot.scene = scene_.view();
  pilot.tracer = scene_.tracer();
  pilot.settings = settings;
  pilot.first_x = job.x0 / kTileSize;
  pilot.first_y = job.y0 / kTileSize;
  pilot.columns = (job.x0 + job.width - 1) / kTileSize + 1 - pilot.first_x;
  const int rows = (job.y0 + job.height - 1) / kTileSize + 1 - pilot.first_y;
  pilot.count = uint32_t(pilot.columns * rows);
  if (controls_.bytes() != pilot.count * sizeof(float)) {
    controls_ = Buffer();
    controls_ = Buffer(context_, pilot.count * sizeof(float));
  }
  pilot.factors = controls_.writable<float>();
  launch(*context_, compute_, "pilot_tiles", (pilot.count + kThreads - 1) / kThreads, kThreads,
         pilot);
  return {pilot.factors, pilot.first_x, pilot.first_y, pilot.columns};
}

void GpuState::render(const DeviceJob& job, const std::atomic<bool>& cancel,
                      const DeviceRenderer::Deliver& deliver) {
  if (!scene_.update(job.scene, job.sampler, job.product_sampling, job.settings.filter_table,
                     cancel))
    return;
  const size_t pixels = size_t(job.width) * job.height;
  reserve_film(pixels);
  clear(*context_, film_, compute_);

  PassParameters pass = {};
  pass.scene = scene_.view();
  pass.tracer = scene_.tracer();
  pass.settings = job.settings;
  pass.settings.filter_table = scene_.filter_table();
  if (job.control_variate) pass.settings.controls = pilot(job, pass.settings);
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
    const PassCounters total = *arriving_->as<PassCounters>();
    const auto* means = reinterpret_cast<const float*>(arriving_->as<char>() + kHeader);
    const std::shared_ptr<const float> image(std::exchange(arriving_, nullptr), means);
    deliver(image, in_flight, {total.rays - delivered.rays, total.rejected - delivered.rejected});
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
    start_copy(pixels, queued);
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
