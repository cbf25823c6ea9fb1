// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/sample_plan.h"

#include <algorithm>
#include <cmath>

#include "kernel/rng.h"

namespace skytree {
namespace {

/// Most samples of a pixel, in units of their mean: an estimate from few samples is not trusted
/// beyond.
constexpr double kLargestShare = 8.0;
/// Pixels on each side that a pixel's noise is estimated from.
constexpr int kReach = 2;
/// Brightness below which noise is no longer judged against the pixel's own, over the image's mean.
constexpr double kDark = 0.1;

/// What a neighbour's samples count, by its distance: too often asked for to be computed each time.
struct NeighbourWeights {
  double by_square[2 * kReach * kReach + 1];
  NeighbourWeights() {
    for (int i = 0; i <= 2 * kReach * kReach; ++i) by_square[i] = std::exp(-0.5 * i);
  }
};

/// About a quarter of the samples, where a pass ends.
int measured_samples(int samples) {
  const int quarter = samples / 4;
  if (quarter >= 16) return quarter / 16 * 16;
  int power = 1;
  while (2 * power <= quarter) power *= 2;
  return power;
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
  std::vector<float> variance(count), mean(count);
  double image_mean = 0.0;
  for (size_t i = 0; i < count; ++i) {
    const Sums& s = sums_[i];
    double squared_mean = 0.0;
    for (const float channel : s.radiance) {
      const double m = double(channel) / measured_;
      squared_mean += m * m;
      mean[i] += float(std::max(m, 0.0) / 3.0);
    }
    variance[i] = float(std::max(s.squares / measured_ - squared_mean, 0.0));
    image_mean += mean[i] / double(count);
  }

  // Error squared over brightness, as the eye weighs it, is least with samples in proportion to
  // deviation / sqrt(brightness).
  const NeighbourWeights neighbours;
  std::vector<float> demand(count, 0.0f);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      double weights = 0.0, noise = 0.0, brightness = 0.0;
      for (int dy = -kReach; dy <= kReach; ++dy) {
        for (int dx = -kReach; dx <= kReach; ++dx) {
          const int nx = x + dx, ny = y + dy;
          if ((dx == 0 && dy == 0) || nx < 0 || ny < 0 || nx >= width_ || ny >= height_) continue;
          const double weight = neighbours.by_square[dx * dx + dy * dy];
          const size_t i = size_t(ny) * width_ + nx;
          weights += weight;
          noise += weight * variance[i];
          brightness += weight * mean[i];
        }
      }
      if (weights == 0.0) continue;
      demand[size_t(y) * width_ + x] =
          float(std::sqrt(noise / (brightness + weights * (kDark * image_mean + 1e-30))));
    }
  }

  // The scale with which max(measured, scale * demand) adds up to all samples, by bisection.
  const double total = double(samples_) * double(count), most = kLargestShare * samples_;
  const auto wanted = [&](size_t i, double scale) {
    return std::clamp(scale * demand[i], double(measured_), most);
  };
  const double largest = *std::max_element(demand.begin(), demand.end());
  if (!(largest > 0.0) || !std::isfinite(largest)) return;  // no noise: evenly
  double low = 0.0, high = most / largest;
  const auto sum = [&](double scale) {
    double result = 0.0;
    for (size_t i = 0; i < count; ++i) result += wanted(i, scale);
    return result;
  };
  while (sum(high) < total && high < 1e30) high *= 2.0;
  for (int i = 0; i < 32; ++i) {
    const double middle = 0.5 * (low + high);
    (sum(middle) < total ? low : high) = middle;
  }
  // Rounded up or down by chance, but by one that no sample has a part in.
  for (size_t i = 0; i < count; ++i) {
    const double rounded = std::floor(wanted(i, high) + unit_float(hash_u32(uint32_t(i))));
    extra_[i] = uint32_t(rounded) - uint32_t(measured_);
  }
}

}  // namespace skytree
