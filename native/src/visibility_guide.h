// SPDX-License-Identifier: GPL-3.0-or-later
// Owner of what kernel/visibility_guide.h learns during one render, and the step from records to
// ratios.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "kernel/guided_light.h"

namespace skytree {

struct GuideConfig {
  /// Share of a slot's samples that goes on as the sampler alone would have it: visibility may
  /// change inside a cell, what was never seen must stay possible, and the noise in what was learnt
  /// must not become the picture's. With 0.2 dim places beside bright ones had up to ten times the
  /// variance.
  double defensive_share = 0.5;
  /// A slot is guided where that promises to divide the second moment of its light samples by at
  /// least this, beyond what knowing which way the surface faces would: below, the noise in what
  /// was learnt and the stratification that it disturbs cost more. What lies behind the surface
  /// alone is no reason: there BSDF samples do as well.
  double least_gain = 2.0;
  /// Trials that a slot needs before it can be judged: one a region.
  uint32_t least_trials = kGuideRegions;
  /// Weight of the parent node's value in a node's estimate, in trials.
  double prior_trials = 8.0;
};

class VisibilityGuide {
 public:
  /// The unit square is cut into regions of about equal solid angle, so that no dark but wide part
  /// of the map hides a window. `sampler` must have a warp (has_warp). 0 `cell_size`: by distance
  /// to the eye.
  VisibilityGuide(const EnvSamplerView& sampler, const Mat3& world_to_env, Vec3 eye,
                  float cell_size = 0.0f, const GuideConfig& config = {});

  GuideView view() const { return view_; }
  /// While on, first vertices send a ray into any region, which only learns.
  void set_probing(bool probing) { view_.probing = probing; }
  /// From now on nothing is recorded.
  void freeze() {
    view_.counters = nullptr;
    view_.probing = false;
  }

  /// Makes the ratios from all records so far; no thread may record meanwhile. Integers only go in,
  /// so the result does not depend on the order of the records. Returns what the counts promise to
  /// be left of the light samples' second moment, the mean over the trials of all slots that can be
  /// judged: 1 where nothing is guided, 0 while nothing is known.
  double update();

  size_t nbytes() const;
  int used_slots() const;

 private:
  // `samples`: where the warp takes an even grid of points.
  void cut_square(const std::vector<DirectionSample>& samples);
  void measure_open_gains(const std::vector<DirectionSample>& samples, const Mat3& world_to_env);
  double make_ratios(uint32_t slot);
  void set_ratios(uint32_t slot);

  GuideConfig config_;
  GuideView view_;
  struct Free {
    void operator()(void* memory) const { std::free(memory); }
  };
  std::vector<float> cuts_, shares_;  // of the inner nodes
  std::vector<float> areas_;          // of the regions
  double open_gains_[kGuideSides];    // what guiding promises where nothing is in the way, by side
  // From calloc: pages of slots that nobody meets cost nothing.
  std::unique_ptr<GuideCounter[], Free> counters_;
  std::unique_ptr<float[], Free> ratios_;
  std::vector<uint8_t> used_, touched_;
  std::vector<double> mean_squares_, masses_;  // of nodes, then regions; while ratios are made
  std::vector<uint64_t> trials_, squares_;
};

}  // namespace skytree
