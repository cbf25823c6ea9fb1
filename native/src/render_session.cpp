// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/render_session.h"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "kernel/pilot.h"
#include "src/environment_sampler.h"

namespace skytree {
namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double thread_cpu_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// A power of two, so that passes also end where the point set is complete.
constexpr int kMaxPassSamples = 16;

/// The first sample of a pass: 0, 1, 2, 4, 8, 16, 32, 48, ...: a first picture soon, then fewer
/// interruptions.
int64_t pass_begin(uint64_t pass) {
  if (pass == 0) return 0;
  if (pass <= 5) return int64_t(1) << (pass - 1);
  return int64_t(pass - 4) * kMaxPassSamples;
}

void check_options(const RenderOptions& o) {
  auto require = [](bool ok, const char* message) {
    if (!ok) throw std::invalid_argument(message);
  };
  require(o.width >= 1 && o.height >= 1 && o.width <= 65536 && o.height <= 65536,
          "width and height must lie in 1..65536 pixels");
  require(o.samples >= 1, "samples must be at least 1");
  require(o.first_sample >= 0, "first_sample must not be negative");
  require(o.max_bounces >= 0 && o.max_bounces <= 1024, "max_bounces must lie in 0..1024");
  require(o.light_rays >= 0 && o.light_rays <= kMaxLightRays, "light_rays must lie in 0..4");
  require(o.bsdf_sampling || o.light_sampling,
          "bsdf_sampling and light_sampling are both off: nothing would find the light");
  require(o.candidates >= 0 && o.candidates <= 1024, "candidates must lie in 0..1024");
  require(o.candidates == 0 || o.light_sampling,
          "candidates are light samples: light_sampling must be on");
  require(
      0 <= o.x0 && o.x0 < o.x1 && o.x1 <= o.width && 0 <= o.y0 && o.y0 < o.y1 && o.y1 <= o.height,
      "region must be (x0,y0,x1,y1) inside the film and not empty");
}

/// The filtered map serves BSDF samples alone.
void check_filtered(const RenderOptions& o, const EnvironmentSampler* sampler) {
  if (!sampler || sampler->view().type != EnvSamplerType::FILTERED) return;
  if (!o.bsdf_sampling || o.candidates > 0) {
    throw std::invalid_argument(
        "a filtered map has no light samples: bsdf_sampling must be on and candidates 0");
  }
}

}  // namespace

int light_rays_to_begin_with(const RenderOptions& o) {
  // Where light bounces, the noise of the first surface's light is the smaller part.
  return o.light_rays > 0 ? o.light_rays : o.max_bounces == 0 ? 4 : 2;
}

RenderSettings make_render_settings(const RenderOptions& o, const float* filter_table) {
  RenderSettings settings = {};
  settings.seed = o.seed;
  settings.max_bounces = o.max_bounces;
  settings.film_transparent = o.film_transparent;
  settings.bsdf_sampling = o.bsdf_sampling && o.candidates == 0;
  settings.filter_table = filter_table;
  settings.light_sampling = o.light_sampling;
  settings.light_rays = light_rays_to_begin_with(o);
  settings.blue_noise = o.blue_noise;
  const bool known = !o.adaptive_sampling && !o.blue_noise && o.first_sample == 0 &&
                     int64_t(o.samples) * settings.light_rays <= int64_t(kLargestJitteredSet);
  settings.point_count = o.multi_jittered && known ? uint32_t(o.samples) : 0;
  settings.candidates = o.candidates;
  settings.bsdf_candidates = o.bsdf_sampling;
  return settings;
}

RenderSession::RenderSession(int threads, std::unique_ptr<DeviceRenderer> device)
    : device_(std::move(device)) {
  if (threads < 0 || threads > 1024) throw std::invalid_argument("threads must lie in 0..1024");
  const int count = threads ? threads : std::max(1, int(std::thread::hardware_concurrency()));
  stats_.threads = count;
  for (int i = 0; i < count; ++i) threads_.emplace_back([this, i] { worker(i); });
}

RenderSession::~RenderSession() {
  cancel();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    shutdown_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

bool RenderSession::uses_control_variate() const {
  if (!options_.control_variate || !options_.light_sampling || options_.candidates > 0)
    return false;
  // A filtered map has no light samples to take the variate off.
  const EnvironmentSampler* sampler = options_.sampler ? options_.sampler.get() : scene_->sampler();
  return !sampler || sampler->view().type != EnvSamplerType::FILTERED;
}

void RenderSession::start(std::shared_ptr<Scene> scene, const RenderOptions& asked) {
  RenderOptions options = asked;
  if (options.x0 == 0 && options.y0 == 0 && options.x1 == 0 && options.y1 == 0) {
    options.x1 = options.width;
    options.y1 = options.height;
  }
  check_options(options);
  std::vector<float> filter_table = make_filter_table(options.pixel_filter, options.filter_width);
  if (!scene) throw std::invalid_argument("a scene is needed");
  check_filtered(options, options.sampler ? options.sampler.get() : scene->sampler());
  if (running()) throw std::runtime_error("the session is rendering; cancel it first");
  scene->begin_use();

  std::lock_guard<std::mutex> lock(mutex_);
  scene_ = std::move(scene);
  options_ = options;
  filter_table_ = std::move(filter_table);
  const int threads = stats_.threads;
  stats_ = {};
  stats_.threads = threads;
  stats_.device = "CPU";
  error_.clear();
  warning_.clear();
  cancel_ = false;
  samples_done_ = 0;
  next_item_ = 0;
  tiles_ = FilmTiles(options.width, options.height, options.x0, options.y0, options.x1, options.y1);
  plan_passes(0);
  on_device_ = device_ != nullptr;
  device_image_.reset();
  film_.assign(on_device_ ? 0 : tiles_.pixel_count(), Pixel());
  ready_ = false;
  running_ = true;
  busy_ = int(threads_.size());
  ++generation_;
  wake_.notify_all();
}

/// The passes that are left once `done` samples are rendered.
void RenderSession::plan_passes(int done) {
  cpu_begin_ = done;
  tile_passes_.reset(new std::atomic<int>[tiles_.count()]());
  pass_tiles_.reset(new std::atomic<int>[pass_slots()]());
}

bool RenderSession::wait(double seconds) {
  std::unique_lock<std::mutex> lock(mutex_);
  const double bounded = std::clamp(seconds, 0.0, 1e9);
  return ended_.wait_for(lock, std::chrono::duration<double>(bounded),
                         [this] { return !running_; });
}

void RenderSession::cancel() {
  std::unique_lock<std::mutex> lock(mutex_);
  cancel_ = true;
  wake_.notify_all();
  ended_.wait(lock, [this] { return !running_; });
}

std::string RenderSession::error() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return error_;
}

std::string RenderSession::warning() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return warning_;
}

SessionStats RenderSession::stats() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return stats_;
}

void RenderSession::fail(const std::string& message) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (error_.empty()) error_ = message;
  cancel_ = true;
}

void RenderSession::worker(int index) {
  uint64_t seen = 0;
  for (;;) {
    double started = 0.0;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [&] { return shutdown_ || generation_ != seen; });
      if (shutdown_) return;
      seen = generation_;
      started = now();
    }
    try {
      if (index == 0) {
        lead();
      } else {
        std::unique_lock<std::mutex> lock(mutex_);
        wake_.wait(lock, [this] { return ready_ || cancel_; });
      }
      if (!cancel_) render_tiles();
    } catch (const std::exception& error) {
      fail(error.what());
    } catch (...) {
      fail("an unknown error in a render thread");
    }
    std::lock_guard<std::mutex> lock(mutex_);
    if (index == 0) wake_.notify_all();  // after a failure of lead() the others still wait for it
    stats_.render_seconds = std::max(stats_.render_seconds, now() - started);
    if (--busy_ == 0) {
      scene_->end_use();
      scene_.reset();
      running_ = false;
      ended_.notify_all();
    }
  }
}

/// Renders of fewer samples do not learn: what is learnt serves too few to be worth its time.
constexpr int kLeastSamplesToLearn = 16;
/// Samples of a pixel after which nothing more is learnt, and until which paths send probes.
constexpr int64_t kLearningSamples = 16;
constexpr int64_t kProbingSamples = 8;
/// What may be left of the light samples' second moment for learning to go on after so many
/// samples; the first ones promise less than is learnt in the end. No more than half: guided
/// vertices cost about a third more, and less is gained than promised where the error was small
/// already, as stratified samples have little of their second moment as error.
double most_left(int64_t samples) { return samples < 4 ? 0.7 : 0.5; }

void RenderSession::start_learning() {
  guide_.reset();
  guide_pass_ = 0;
  SceneView& scene = job_.scene;
  scene.guide = {};
  if (!options_.learn_visibility || !options_.light_sampling ||
      options_.samples - cpu_begin_ < kLeastSamplesToLearn ||
      !has_warp(scene.environment.sampler)) {
    return;
  }
  // A perspective camera's rays meet in the eye; an orthographic one has none, and cells of one
  // size.
  const CameraView& camera = scene.camera;
  const float spread = length(camera.span_dx), width = length(camera.near_dx);
  const bool perspective = spread > 1e-6f * width;
  const Vec3 eye =
      perspective ? camera.near_center - camera.span_center * (width / spread) : camera.near_center;
  guide_ =
      std::make_unique<VisibilityGuide>(scene.environment.sampler, scene.environment.world_to_env,
                                        eye, perspective ? 0.0f : width / 16.0f);
  scene.guide = guide_->view();
}

/// Waits until all tiles have finished so many samples. False when the render was cancelled.
bool RenderSession::wait_for_samples(int64_t count) {
  std::unique_lock<std::mutex> lock(mutex_);
  wake_.wait(lock, [&] { return samples_done_ - cpu_begin_ >= count || cancel_; });
  return !cancel_;
}

/// Shares out the samples from `begin` on, once, if that is where the measured ones end.
void RenderSession::share_out_before(int64_t begin) {
  if (!plan_ || begin != plan_->measured() || !wait_for_samples(begin)) return;
  std::lock_guard<std::mutex> lock(plan_mutex_);
  if (shared_out_) return;
  plan_->share_out();
  if (options_.light_rays == 0 && job_.settings.light_rays > 1) choose_light_rays(begin);
  shared_out_ = true;
}

/// Light rays of the samples from `begin` on, as the measured ones tell.
void RenderSession::choose_light_rays(int64_t begin) {
  RenderSettings& settings = job_.settings;
  const int before = settings.light_rays;
  settings.light_rays =
      plan_->light_rays_that_pay(before, double(later_rays_) / double(measured_paths_));
  const uint32_t first = uint32_t(options_.first_sample) + uint32_t(begin);
  settings.light_skip = first * uint32_t(before - settings.light_rays);
  std::lock_guard<std::mutex> lock(mutex_);
  stats_.light_rays = settings.light_rays;
}

/// Brings the guide up to date with the passes before, once.
void RenderSession::learn_before(uint64_t pass, int64_t begin) {
  if (!guide_ || pass == 0 || guide_pass_ >= pass || !wait_for_samples(begin)) return;
  std::lock_guard<std::mutex> lock(guide_mutex_);
  if (guide_pass_ >= pass) return;
  const double left = guide_->update();
  guide_->set_probing(begin < kProbingSamples);
  if (begin >= kLearningSamples) guide_->freeze();
  // Where little is gained, as in an open scene, it is not worth the records and look-ups.
  job_.scene.guide = left <= most_left(begin) ? guide_->view() : GuideView();
  // Last, as it lets the other threads go on with the view; for good once nothing more is learnt.
  guide_pass_ = job_.scene.guide.counters ? pass : UINT64_MAX;
}

void RenderSession::lead() {
  const double started = now();
  // A device has trees of its own: Embree's are only built if the CPU has to take over.
  bool built = scene_->commit(cancel_, !device_);
  double commit_seconds = now() - started;
  job_.settings = make_render_settings(options_, filter_table_.data());
  if (built && device_ && !render_on_device()) {
    const double again = now();
    built = scene_->commit(cancel_);
    commit_seconds += now() - again;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  stats_.commit_seconds = commit_seconds;
  if (!built) return;
  job_.scene = scene_->view(options_.width, options_.height);
  job_.tree = scene_->tree();
  render_tile_ = select_render_tile();
  job_.intersect8 = embree().Intersect8;
  job_.occluded8 = embree().Occluded8;
  job_.intersect16 = embree().Intersect16;
  job_.occluded16 = embree().Occluded16;
  job_.width = options_.width;
  job_.height = options_.height;
  if (const EnvironmentSampler* sampler =
          options_.sampler ? options_.sampler.get() : scene_->sampler()) {
    job_.scene.environment.sampler =
        options_.product_sampling ? sampler->product_view() : sampler->view();
  }
  stats_.light_rays = job_.settings.light_rays;
  controls_.assign(size_t(tiles_.count()), 0.0f);
  job_.settings.controls = {controls_.data(), tiles_.first_column, tiles_.first_row,
                            tiles_.columns};
  start_learning();
  plan_.reset();
  shared_out_ = false;
  later_rays_ = measured_paths_ = 0;
  // After a device's samples nothing is known of their spread.
  if (options_.adaptive_sampling && cpu_begin_ == 0 &&
      options_.samples >= SamplePlan::kLeastSamples) {
    plan_ = std::make_unique<SamplePlan>(region_width(), region_height(), options_.samples);
  }
  ready_ = true;
  wake_.notify_all();
}

void RenderSession::render_tiles() {
  const double cpu_started = thread_cpu_seconds();
  std::unique_ptr<TileScratch, decltype(&delete_tile_scratch)> scratch(new_tile_scratch(),
                                                                       delete_tile_scratch);
  auto sample = std::make_unique<TileSample>();
  std::vector<TilePath> paths;
  const uint64_t tiles = uint64_t(tiles_.count());
  const uint32_t first = uint32_t(options_.first_sample);
  uint64_t rays = 0;
  while (!cancel_) {
    const uint64_t item = next_item_++;
    const uint64_t pass = item / tiles;
    const int64_t begin = cpu_begin_ + pass_begin(pass);
    const int64_t end = std::min<int64_t>(cpu_begin_ + pass_begin(pass + 1), options_.samples);
    if (begin >= options_.samples) break;
    const int tile = int(item % tiles);
    learn_before(pass, begin - cpu_begin_);
    share_out_before(begin - cpu_begin_);
    // Sums are taken in the order of the samples, whichever thread takes them.
    while (tile_passes_[tile].load(std::memory_order_acquire) != int(pass) && !cancel_)
      std::this_thread::yield();
    if (pass == 0 && uses_control_variate())
      controls_[tile] = pilot(tile, scratch.get(), sample.get());
    const auto trace = [&](size_t from, size_t count) {
      const TileWork work = {tiles_.column(tile), tiles_.row(tile), paths.data() + from,
                             int(count)};
      rays += render_tile_(job_, work, scratch.get(), sample.get());
      if (plan_ && !shared_out_) {
        later_rays_ += sample->later_rays;
        measured_paths_ += uint64_t(count);
      }
      accumulate(tile, work, *sample);
    };
    if (plan_ && begin - cpu_begin_ >= plan_->measured()) {
      paths.clear();
      tiles_.append_planned(*plan_, tile, begin, end, first, &paths);
      for (size_t i = 0; i < paths.size() && !cancel_; i += kTilePixels) {
        trace(i, std::min<size_t>(kTilePixels, paths.size() - i));
      }
    } else {
      for (int64_t i = begin; i < end && !cancel_; ++i) {
        paths.clear();
        tiles_.append_sample(tile, first + uint32_t(i), &paths);
        trace(0, paths.size());
      }
    }
    if (cancel_) break;
    tile_passes_[tile].store(int(pass) + 1, std::memory_order_release);
    std::atomic<int>& finished = pass_tiles_[pass % pass_slots()];
    if (uint64_t(++finished) == tiles) {
      finished = 0;
      // A tile's passes follow each other, so the passes before this one are complete too.
      const int done = int(end);
      int before = samples_done_.load();
      while (before < done && !samples_done_.compare_exchange_weak(before, done)) {
      }
      if (guide_ || plan_) {
        std::lock_guard<std::mutex> lock(mutex_);  // or a thread about to wait misses this
        wake_.notify_all();
      }
    }
  }
  std::lock_guard<std::mutex> lock(mutex_);
  stats_.rays += rays;
  stats_.cpu_seconds += thread_cpu_seconds() - cpu_started;
}

/// The control variate's factor for a tile, as kernel/path.h computes it on other devices.
float RenderSession::pilot(int tile, TileScratch* scratch, TileSample* sample) const {
  TilePath paths[kPilotPaths];
  TileWork work = {tiles_.column(tile), tiles_.row(tile), paths, 0};
  for (int i = 0; i < kPilotPaths; ++i) {
    const int x = pilot_x(i), y = pilot_y(i);
    if (work.x * kTileSize + x >= options_.width || work.y * kTileSize + y >= options_.height) {
      continue;
    }
    paths[work.count++] = {uint32_t(y * kTileSize + x), 0};
  }
  IntegratorJob job = job_;
  job.scene.guide = {};  // pilots neither learn nor are guided
  Vec3 plain[kPilotPaths];
  PilotSums sums = {0.0f, 0.0f};
  for (const float control : {0.0f, 1.0f}) {
    job.settings = pilot_settings(job_.settings, control);
    render_tile_(job, work, scratch, sample);
    for (int i = 0; i < work.count; ++i) {
      if (control == 0.0f) {
        plain[i] = sample->radiance[i];
      } else {
        add_pilot(plain[i], sample->radiance[i], &sums);
      }
    }
  }
  return control_factor(sums);
}

void RenderSession::accumulate(int tile, const TileWork& work, const TileSample& sample) {
  uint64_t rejected = 0;
  const FilmTiles tiles = tiles_;  // a copy, as no write to the film can change it
  {
    std::lock_guard<std::mutex> lock(film_locks_[tile % 64]);
    for (int i = 0; i < work.count; ++i) {
      size_t place;
      if (!tiles.find_pixel(tile, work.paths[i].pixel, &place)) continue;
      const Vec3 radiance = sample.radiance[i];
      if (plan_ && !shared_out_) {
        plan_->record(place, {radiance, sample.light_rays[i], sample.light_difference[i]});
      }
      Pixel& pixel = film_[place];
      ++pixel.count;
      pixel.alpha += sample.alpha[i];
      if (!std::isfinite(radiance.x + radiance.y + radiance.z)) {
        ++rejected;
        continue;
      }
      pixel.radiance[0] += radiance.x;
      pixel.radiance[1] += radiance.y;
      pixel.radiance[2] += radiance.z;
    }
  }
  if (rejected) {
    std::lock_guard<std::mutex> lock(mutex_);
    stats_.rejected_samples += rejected;
  }
}

std::shared_ptr<const float> RenderSession::device_image() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return device_image_;
}

void RenderSession::pixels(float* out) const {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (on_device_) {
      const size_t count = size_t(4) * region_width() * region_height();
      if (device_image_) {
        std::copy_n(device_image_.get(), count, out);
      } else {
        std::fill_n(out, count, 0.0f);
      }
      return;
    }
  }
  for (int tile = 0; tile < tiles_.count(); ++tile) {
    std::lock_guard<std::mutex> lock(film_locks_[tile % 64]);
    tiles_.for_each_row(tile, [&](size_t first, size_t count) {
      for (size_t i = first; i < first + count; ++i) {
        const Pixel& pixel = film_[i];
        const Rgba mean =
            film_mean(pixel.radiance, pixel.alpha, pixel.count ? 1.0 / pixel.count : 0.0);
        std::memcpy(out + 4 * i, &mean, sizeof mean);
      }
    });
  }
}

}  // namespace skytree
