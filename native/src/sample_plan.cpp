// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/sample_plan.h"

#include <algorithm>
#include <cmath>

#include "kernel/rng.h"
#include "kernel/scene_view.h"

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

/// Time of a path in units of one light ray at the first surface, about what `bench --peers` finds:
/// all of a path but those, and each ray of the vertices that follow. Those lie in all directions,
/// which costs caches and packets.
constexpr double kPathCost = 2.0, kLaterRayCost = 2.0;
/// Of the variance that the halves' difference tells, what light rays still bring in the end:
/// points of a sequence are spread more evenly than independent ones, and the more so the more
/// there are. In the scenes of `bench --peers` it is 0.7 with bounces, and nearly all without.
constexpr double kLightShare = 0.8;
/// What another number of light rays must promise of error times time, over what it is: the promise
/// is rough, and points of a sequence are best taken in steps of one size.
constexpr double kWorthAChange = 0.95;

}  // namespace

SamplePlan::SamplePlan(int width, int height, int samples)
    : width_(width),
      height_(height),
      samples_(samples),
      measured_(measured_samples(samples)),
      sums_(size_t(width) * height),
      extra_(size_t(width) * height, uint32_t(samples - measured_)) {}

void SamplePlan::record(size_t pixel, const MeasuredSample& sample) {
  const Vec3 radiance = sample.radiance;
  if (!std::isfinite(radiance.x + radiance.y + radiance.z)) return;
  Sums& sums = sums_[pixel];
  sums.several += sample.light_rays > 1;
  const float difference_square = dot(sample.light_difference, sample.light_difference);
  if (std::isfinite(difference_square)) sums.difference_squares += difference_square;
  sums.radiance[0] += radiance.x;
  sums.radiance[1] += radiance.y;
  sums.radiance[2] += radiance.z;
  sums.squares += dot(radiance, radiance);
}

double SamplePlan::variance_of(const Sums& sums) const {
  double squared_mean = 0.0;
  for (const float channel : sums.radiance) {
    squared_mean += double(channel) / measured_ * channel / measured_;
  }
  return std::max(sums.squares / measured_ - squared_mean, 0.0);
}

double SamplePlan::brightness_of(const Sums& sums) const {
  double sum = 0.0;
  for (const float channel : sums.radiance) sum += std::max(channel, 0.0f);
  return sum / (3.0 * measured_);
}

void SamplePlan::share_out() {
  const size_t count = sums_.size();
  std::vector<float> variance(count), brightness(count);
  double image_mean = 0.0;
  for (size_t i = 0; i < count; ++i) {
    variance[i] = float(variance_of(sums_[i]));
    brightness[i] = float(brightness_of(sums_[i]));
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

int SamplePlan::light_rays_that_pay(int measured_rays, double later_rays) const {
  double image_mean = 0.0;
  for (const Sums& s : sums_) image_mean += brightness_of(s) / double(sums_.size());
  const double dark = kDark * image_mean + 1e-30;
  // Squared error over brightness in the end, and what of it `measured_rays` light rays bring;
  // samples to come, and those that take several light rays.
  double error = 0.0, light_error = 0.0, samples = 0.0, several = 0.0;
  for (size_t i = 0; i < sums_.size(); ++i) {
    const Sums& s = sums_[i];
    const double weight = 1.0 / ((measured_ + double(extra_[i])) * (brightness_of(s) + dark));
    error += weight * variance_of(s) * measured_ / (measured_ - 1.0);
    light_error += weight * s.difference_squares / measured_;
    samples += extra_[i];
    several += double(extra_[i]) * s.several / measured_;
  }
  light_error = kLightShare * std::min(light_error, error);
  const auto cost = [&](int n) {
    return samples * (kPathCost + 1.0 + kLaterRayCost * later_rays) + several * (n - 1.0);
  };
  const auto error_of = [&](int n) {
    return error + light_error * (double(measured_rays) / n - 1.0);
  };
  int best = measured_rays;
  double least = kWorthAChange * error_of(best) * cost(best);
  for (int n = 1; n <= kMaxLightRays; ++n) {
    const double product = error_of(n) * cost(n);
    if (product < least) {
      least = product;
      best = n;
    }
  }
  return best;
}

}  // namespace skytree
