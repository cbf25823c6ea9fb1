// SPDX-License-Identifier: GPL-3.0-or-later
// Adaptive sampling: some samples of every pixel tell where the noise is, and the rest is shared
// out in proportion to it.
//
// A pixel whose number of samples depended on its own samples would be biased: where the first ones
// miss a small bright thing the pixel looks calm and is left alone (D. Kirk and J. Arvo, "Unbiased
// Sampling Techniques for Image Synthesis", SIGGRAPH 1991). So a pixel's noise is estimated from
// its neighbours' samples without its own: their random numbers are independent of the pixel's, so
// the mean of however many samples it then takes is unbiased. (What all pixels together are scaled
// by knows the pixel's own samples too, by one part in as many as there are pixels.)
//
// The same samples tell how many light rays pay in what is left of the render. That number is one
// for the whole film and no pixel's count depends on it, so what all samples tell may be used.
#pragma once

#include <cstdint>
#include <vector>

#include "kernel/vec.h"

namespace skytree {

/// What one measured sample of a pixel brought.
struct MeasuredSample {
  Vec3 radiance;
  int light_rays = 0;                 // as in PathState
  Vec3 light_difference = {0, 0, 0};  // as in PathState
};

class SamplePlan {
 public:
  /// Fewer samples are spread evenly: there would be too few to measure with.
  static constexpr int kLeastSamples = 3;

  /// For a film of width x height pixels that takes `samples` a pixel in the mean.
  SamplePlan(int width, int height, int samples);

  /// So many samples every pixel takes before the rest is shared out; a power of two or a multiple
  /// of 16.
  int measured() const { return measured_; }
  /// Takes in one of a pixel's measured samples; pixels are counted row by row. Different pixels
  /// may be recorded at the same time.
  void record(size_t pixel, const MeasuredSample& sample);
  /// Shares out the rest, once all measured samples are recorded.
  void share_out();

  /// How many light rays at the first surface make the rest least noisy for its time, once it is
  /// shared out. The measured samples took `measured_rays` there, an even number, and traced
  /// `later_rays` a path from other vertices.
  int light_rays_that_pay(int measured_rays, double later_rays) const;

  /// How many samples a pixel has when the render has done `done` a pixel in the mean.
  uint32_t samples_at(size_t pixel, int64_t done) const {
    if (done <= measured_) return uint32_t(done);
    return uint32_t(measured_ +
                    (done - measured_) * int64_t(extra_[pixel]) / (samples_ - measured_));
  }

 private:
  struct Sums {
    float radiance[3] = {0, 0, 0};
    float squares = 0;             // of all channels
    float difference_squares = 0;  // of light_difference, all channels
    uint32_t several = 0;          // samples that took more than one light ray
  };
  double variance_of(const Sums& sums) const;  // of a sample, all channels
  double brightness_of(const Sums& sums) const;

  int width_, height_, samples_, measured_;
  std::vector<Sums> sums_;
  std::vector<uint32_t> extra_;  // samples beyond the measured ones
};

}  // namespace skytree
