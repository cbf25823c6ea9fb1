// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/sample_plan.h"

#include <algorithm>
#include <cmath>

#include "kernel/rng.h"

namespace skytree {
namespace {

/// Most samples of a pixel, in units of their mean: twice the measured samples, and at most this.
/// An estimate from few samples is not trusted beyond.
constexpr int kLargestShare = 8;
/// Pixels on each side that a pixel's noise is estimated from, and their weights along one axis.
constexpr int kReach = 2;
constexpr float kWeights[2 * kReach + 1] = {0.135335f, 0.606531f, 1.0f, 0.606531f, 0.135335f};
/// Brightness below which noise is no longer judged against the pixel's own, over the image's mean.
constexpr float kDark = 0.1f;
/// With this power of variance over brightness a pixel's samples grow. The error is least with 0.5
/// if it falls as 1 / samples, and with 1 / (1 + a) if as samples^-a: of stratified samples more
/// than 1 (docs/rendering.md).
constexpr float kDemandPower = 0.4f;

/// About a quarter of the samples, where a pass ends, but 4 as soon as that is no more than half;
/// 2 at least, as one alone tells no spread.
int measured_samples(int samples) {
  const int quarter = samples / 4;
  if (quarter >= 16) return quarter / 16 * 16;
  int power = samples >= 8 ? 4 : 2;
  while (2 * power <= quarter) power *= 2;
  return power;
}

/// Per pixel the weighted sum of its neighbours' values, its own left out.
class Neighbours {
 public:
  Neighbours(int width, int height)
      : width_(width), height_(height), row_(size_t(width) + 2 * kReach, 0.0f) {}

  std::vector<float> sum(const std::vector<float>& values) {
    std::vector<float> result(values.size(), 0.0f);
    std::vector<float> along(static_cast<size_t>(width_));
    for (int y = 0; y < height_; ++y) {
      std::copy_n(&values[size_t(y) * width_], width_, row_.begin() + kReach);
      const float* row = row_.data();
      float* own = &result[size_t(y) * width_];
      for (int x = 0; x < width_; ++x) {
        float others = 0.0f;  // of the row
        for (int i = 0; i < kReach; ++i) {
          others += kWeights[i] * (row[x + i] + row[x + 2 * kReach - i]);
        }
        own[x] += others;
        along[x] = others + row[x + kReach];
      }
      for (int dy = std::max(-kReach, -y); dy <= std::min(kReach, height_ - 1 - y); ++dy) {
        if (dy == 0) continue;
        float* to = &result[size_t(y + dy) * width_];
        for (int x = 0; x < width_; ++x) to[x] += kWeights[dy + kReach] * along[x];
      }
    }
    return result;
  }

 private:
  int width_, height_;
  std::vector<float> row_;  // one of them, with zeros at both ends
};

/// The scale with which clamp(scale * demand, least, most) adds up to `total`; 0 if nothing is in
/// demand.
double fit_scale(const std::vector<float>& demand, double least, double most, double total) {
  double all = 0.0;
  for (const float d : demand) all += d;
  if (!(all > 0.0) || !std::isfinite(all)) return 0.0;
  // Where the sum is too small and where not; a step as if no pixel changed sides, where it stays
  // between them.
  double low = 0.0, high = 1e30, scale = total / all;
  for (int step = 0; step < 64 && high - low > 1e-6 * high; ++step) {
    double sum = 0.0, slope = 0.0;
    for (const float d : demand) {
      const double wanted = scale * d;
      sum += std::clamp(wanted, least, most);
      slope += d * double((wanted >= least) & (wanted < most));  // a branch would be mispredicted
    }
    (sum < total ? low : high) = scale;
    const double next = slope > 0.0 ? scale + (total - sum) / slope : 0.0;
    if (next == scale) break;
    scale = next > low && next < high ? next : high < 1e30 ? 0.5 * (low + high) : 2.0 * low;
  }
  return scale;
}

}  // namespace

SamplePlan::SamplePlan(int width, int height, int samples)
    : width_(width),
      height_(height),
      samples_(samples),
      measured_(measured_samples(samples)),
      sums_(size_t(width) * height),
      extra_(size_t(width) * height, uint32_t(samples - measured_)) {}

void SamplePlan::record(size_t pixel, Vec3 radiance) {
  if (!std::isfinite(radiance.x + radiance.y + radiance.z)) return;
  Sums& sums = sums_[pixel];
  sums.radiance[0] += radiance.x;
  sums.radiance[1] += radiance.y;
  sums.radiance[2] += radiance.z;
  sums.squares += dot(radiance, radiance);
}

void SamplePlan::share_out() {
  const size_t count = sums_.size();
  std::vector<float> variance(count), brightness(count);
  double image_mean = 0.0;
  for (size_t i = 0; i < count; ++i) {
    const Sums& s = sums_[i];
    double squared_mean = 0.0;
    for (const float channel : s.radiance) {
      const double m = double(channel) / measured_;
      squared_mean += m * m;
      brightness[i] += float(std::max(m, 0.0) / 3.0);
    }
    variance[i] = float(std::max(s.squares / measured_ - squared_mean, 0.0));
    image_mean += brightness[i] / double(count);
  }

  // Error squared over brightness, as the eye weighs it, is what is to become small.
  Neighbours neighbours(width_, height_);
  const std::vector<float> weights = neighbours.sum(std::vector<float>(count, 1.0f));
  const std::vector<float> noise = neighbours.sum(variance), light = neighbours.sum(brightness);
  const float dark = kDark * float(image_mean) + 1e-30f;
  std::vector<float> demand(count);
  for (size_t i = 0; i < count; ++i) {
    if (weights[i] > 0.0f) {
      demand[i] = std::pow(noise[i] / (light[i] + weights[i] * dark), kDemandPower);
    }
  }
  const double most = double(samples_) * std::min(kLargestShare, 2 * measured_);
  const double scale = fit_scale(demand, measured_, most, double(samples_) * double(count));
  if (scale == 0.0) return;  // no noise: evenly
  // In steps, as Sobol' points are at their best in powers of two, and up or down by chance, but by
  // one that no sample has a part in.
  const int step = std::min(std::max(measured_ / 2, 1), 8);
  for (size_t i = 0; i < count; ++i) {
    const double wanted = std::clamp(scale * demand[i], double(measured_), most);
    const double steps = std::floor(wanted / step + unit_float(hash_u32(uint32_t(i))));
    extra_[i] = uint32_t(steps) * uint32_t(step) - uint32_t(measured_);
  }
}

}  // namespace skytree
