// SPDX-License-Identifier: GPL-3.0-or-later
// A progressive render on threads of its own.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "src/device_renderer.h"
#include "src/film_tiles.h"
#include "src/filter_table.h"
#include "src/sample_plan.h"
#include "src/scene.h"
#include "src/tile_integrator.h"
#include "src/visibility_guide.h"

namespace skytree {

struct RenderOptions {
  int width = 0, height = 0;  // of the whole film, pixels
  int samples = 0;
  int max_bounces = 4;
  uint32_t seed = 0;
  PixelFilter pixel_filter = PixelFilter::kBlackmanHarris;
  double filter_width = 1.5;
  int x0 = 0, y0 = 0, x1 = 0,
      y1 = 0;  // region in pixels from the lower left; all 0: the whole film
  bool film_transparent = false;
  int first_sample = 0;
  bool bsdf_sampling = true;
  bool light_sampling = true;
  /// Steer light samples by what earlier shadow rays of the same render met (CPU; samplers with a
  /// warp). A part of a film then differs in its noise from the same part of the whole.
  bool learn_visibility = false;
  /// Share out most of the samples by where the first ones found noise; `samples` is the mean of
  /// all pixels (CPU; from SamplePlan::kLeastSamples on). A part of a film then differs in its
  /// noise from the same part of the whole.
  bool adaptive_sampling = false;
  bool blue_noise = false;  // neighbouring pixels' errors differ (kernel/rng.h)
  /// Multi-jittered points (kernel/multi_jittered.h) where a pixel's samples are known beforehand:
  /// without adaptive_sampling, blue_noise and first_sample, and up to kLargestJitteredSet light
  /// samples. Elsewhere this does nothing.
  bool multi_jittered = false;
  /// Above 0: each light sample is chosen from so many candidates, half of them BSDF samples if
  /// bsdf_sampling is on (kernel/resampling.h). The BSDF's own ray then brings no environment.
  int candidates = 0;
  /// Light samples at a path's first vertex, up to kMaxLightRays; mirrors and narrow lobes take
  /// one. 0: as many as pay, which with adaptive_sampling the first samples tell.
  int light_rays = 1;
  /// Diffuse light by its difference from the unshadowed map's, tile by tile as far as that helps;
  /// needs light_sampling, without it this does nothing.
  bool control_variate = false;
  /// Light samples of glossy surfaces from the map times their lobes, at a path's first vertex;
  /// samplers with linear blocks, no candidates.
  bool product_sampling = false;
  std::shared_ptr<const EnvironmentSampler> sampler;  // null: the scene's own
};

/// What the kernel takes of them; `filter_table` as filter_table.h makes it.
RenderSettings make_render_settings(const RenderOptions& options, const float* filter_table);

struct SessionStats {
  uint64_t rays = 0;
  uint64_t rejected_samples = 0;  // not finite, counted as black
  double commit_seconds = 0.0;    // scene changes to ray-tracing trees
  double render_seconds = 0.0;    // wall clock, commit included
  double cpu_seconds = 0.0;       // of the session's threads while they render tiles
  int threads = 0;
  int light_rays = 0;  // at the first surface, in the last samples
  std::string device;  // what rendered: "CPU", a GPU's name, or "… + CPU" where the CPU took over
};

/// One render at a time. Methods may be called from any one thread besides the session's own.
class RenderSession {
 public:
  /// 0 threads: all cores. With a `device` that one renders; if it fails, the threads finish the
  /// frame and warning() says why.
  explicit RenderSession(int threads, std::unique_ptr<DeviceRenderer> device = nullptr);
  ~RenderSession();

  /// Returns at once. Throws std::invalid_argument for options out of range, std::runtime_error
  /// while running. Several sessions may render one scene at the same time.
  void start(std::shared_ptr<Scene> scene, const RenderOptions& options);
  /// True if the render has ended; waits at most `seconds`.
  bool wait(double seconds);
  /// Returns when all threads stand still.
  void cancel();

  bool running() const { return running_.load(); }
  int samples_done() const { return samples_done_.load(); }
  std::string error() const;
  /// Why the CPU renders although another device was asked for; empty if it does not.
  std::string warning() const;
  SessionStats stats() const;
  int region_width() const { return options_.x1 - options_.x0; }
  int region_height() const { return options_.y1 - options_.y0; }

  /// The mean of what has been rendered so far, RGBA of the region, bottom row first; a pixel
  /// without samples is 0.
  void pixels(float* out) const;
  /// The same without a copy, where a device brought it; null where the CPU renders, or nothing has
  /// come yet.
  std::shared_ptr<const float> device_image() const;

 private:
  struct Pixel {
    double radiance[3] = {0, 0, 0};  // double: float sums drift after some thousand samples
    double alpha = 0;
    uint32_t count = 0;
  };
  void worker(int index);
  void lead();
  bool render_on_device();
  void take_device_image(std::shared_ptr<const float> image, int samples_done,
                         const PassCounters& counters);
  void resume_from_device_image();
  void plan_passes(int done);
  /// More than passes can be under way: each thread waits in at most one.
  size_t pass_slots() const { return threads_.size() + 2; }
  void render_tiles();
  bool uses_control_variate() const;
  float pilot(int tile, TileScratch* scratch, TileSample* sample) const;
  void accumulate(int tile, const TileWork& work, const TileSample& sample);
  void start_learning();
  bool wait_for_samples(int64_t count);
  void learn_before(uint64_t pass, int64_t begin);
  void share_out_before(int64_t begin);
  void choose_light_rays(int64_t begin);
  void fail(const std::string& message);

  std::vector<std::thread> threads_;
  std::shared_ptr<Scene> scene_;
  RenderOptions options_;
  std::vector<float> filter_table_;
  std::vector<float> controls_;  // by tile, for the control variate; set in a tile's first pass
  IntegratorJob job_ = {};
  RenderTile render_tile_ = nullptr;
  std::unique_ptr<DeviceRenderer> device_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_, ended_;
  uint64_t generation_ = 0;  // counts starts
  bool shutdown_ = false;
  int busy_ = 0;        // threads inside render_tiles
  bool ready_ = false;  // the scene is built, tiles may be rendered
  std::string error_, warning_;
  SessionStats stats_;
  bool on_device_ = false;  // the pixels are device_image_, and film_ is empty
  std::shared_ptr<const float> device_image_;

  std::atomic<bool> cancel_{false}, running_{false};
  std::atomic<int> samples_done_{0};

  std::unique_ptr<VisibilityGuide> guide_;
  std::unique_ptr<SamplePlan> plan_;  // null: every pixel takes as many samples
  bool shared_out_ = false;
  std::atomic<uint64_t> later_rays_{0}, measured_paths_{0};  // of the measured samples
  std::mutex plan_mutex_;
  std::mutex guide_mutex_;
  std::atomic<uint64_t> guide_pass_{0};  // the last pass that the guide was brought up to date for

  FilmTiles tiles_;
  int cpu_begin_ = 0;  // samples that a device had done when the threads took over
  std::atomic<uint64_t> next_item_{0};
  std::unique_ptr<std::atomic<int>[]> tile_passes_;  // passes finished, by tile
  std::unique_ptr<std::atomic<int>[]> pass_tiles_;   // tiles finished, by pass modulo pass_slots()
  mutable std::mutex film_locks_[64];
  std::vector<Pixel> film_;
};

}  // namespace skytree
