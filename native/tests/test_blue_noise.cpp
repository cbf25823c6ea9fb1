// SPDX-License-Identifier: GPL-3.0-or-later
// Blue noise across pixels (kernel/rng.h): the error of neighbours differs, at every power of two
// of samples, and each pixel's own sequence is as good as without.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "kernel/rng.h"

namespace skytree {
namespace {

constexpr int kSize = 64;

/// Light through a round window, as seen by one light sample.
double round_window(Vec2 u) {
  const double x = u.x - 0.4, y = u.y - 0.55;
  return x * x + y * y < 0.12 ? 1.0 : 0.0;
}
constexpr double kRoundWindow = 3.14159265358979 * 0.12;  // wholly inside the square

double smooth(Vec2 u) { return u.x * u.y; }
constexpr double kSmooth = 0.25;

/// Error of each pixel after `samples` samples of the integrand f.
template <class F>
std::vector<double> error_image(F f, double truth, int samples, uint32_t seed, bool blue) {
  std::vector<double> error;
  for (int i = 0; i < kSize * kSize; ++i) {
    const uint32_t pixel = pixel_seed(seed, i % kSize, i / kSize, blue);
    double sum = 0.0;
    for (int s = 0; s < samples; ++s) sum += f(pixel, static_cast<uint32_t>(s));
    error.push_back(sum / samples - truth);
  }
  return error;
}

/// Share of the image's variance that is left when blocks of 4x4 pixels are averaged, times 16: 1
/// for white noise, less for blue.
double low_frequency_share(const std::vector<double>& error) {
  double all = 0.0, low = 0.0;
  for (int by = 0; by < kSize; by += 4) {
    for (int bx = 0; bx < kSize; bx += 4) {
      // Blocks that are not aligned with the Z-order's: of those it would be trivial.
      double mean = 0.0;
      for (int i = 0; i < 16; ++i) {
        const int x = (bx + i % 4 + 1) % kSize, y = (by + i / 4 + 3) % kSize;
        const double e = error[y * kSize + x];
        mean += e / 16.0;
        all += e * e;
      }
      low += 256.0 * mean * mean;
    }
  }
  return low / all;
}

template <class F>
double mean_share(F f, double truth, int samples, bool blue) {
  double share = 0.0;
  for (uint32_t seed = 0; seed < 8; ++seed) {
    share += low_frequency_share(error_image(f, truth, samples, seed, blue)) / 8.0;
  }
  return share;
}

TEST(BlueNoise, ErrorsOfNeighboursDiffer) {
  const auto window = [](uint32_t p, uint32_t s) { return round_window(random_pair(p, s, 1)); };
  const auto product = [](uint32_t p, uint32_t s) { return smooth(random_pair(p, s, 1)); };
  for (const int samples : {1, 2, 4}) {
    EXPECT_NEAR(mean_share(product, kSmooth, samples, false), 1.0, 0.15) << samples;
    EXPECT_LT(mean_share(product, kSmooth, samples, true), 0.7) << samples;
    EXPECT_LT(mean_share(window, kRoundWindow, samples, true), 0.8) << samples;
  }
}

/// Variance that is left when two neighbours along one axis are averaged, of the image's times two.
double pair_share(const std::vector<double>& error, int step_x, int step_y) {
  double all = 0.0, low = 0.0;
  for (int i = 0; i < kSize * kSize; ++i) {
    const int x = (i % kSize + step_x) % kSize, y = (i / kSize + step_y) % kSize;
    const double mean = (error[i] + error[y * kSize + x]) / 2;
    all += error[i] * error[i];
    low += 2.0 * mean * mean;
  }
  return low / all;
}

TEST(BlueNoise, HasNoGrain) {
  // Without the turned quads horizontal neighbours would differ far more than vertical ones.
  const auto product = [](uint32_t p, uint32_t s) { return smooth(random_pair(p, s, 1)); };
  double across = 0.0, down = 0.0;
  for (uint32_t seed = 0; seed < 8; ++seed) {
    const std::vector<double> error = error_image(product, kSmooth, 1, seed, true);
    across += pair_share(error, 1, 0) / 8.0;
    down += pair_share(error, 0, 1) / 8.0;
  }
  EXPECT_LT(across, 0.9);
  EXPECT_LT(down, 0.9);
  EXPECT_NEAR(across, down, 0.05);
}

TEST(BlueNoise, PairsOfOnePixelAreIndependent) {
  // With one order of pixels for all pairs, this integrand of two pairs would be off by the same
  // amount in all pixels: the share would be far above 1.
  const auto both = [](uint32_t p, uint32_t s) {
    return smooth(random_pair(p, s, 1)) * random_pair(p, s, 2).x;
  };
  for (const int samples : {1, 4, 16}) {
    EXPECT_LT(mean_share(both, kSmooth / 2, samples, true), 1.8) << samples;
  }
}

TEST(BlueNoise, UnbiasedOverSeeds) {
  // One pixel, one sample: every seed shows another part of the plane.
  double sum = 0.0;
  const int seeds = 1 << 14;
  for (uint32_t seed = 0; seed < seeds; ++seed) {
    sum += round_window(random_pair(pixel_seed(seed, 5, 9, true), 3, 4));
  }
  const double deviation = std::sqrt(kRoundWindow * (1 - kRoundWindow) / seeds);
  EXPECT_NEAR(sum / seeds, kRoundWindow, 4 * deviation);
}

TEST(BlueNoise, EachPixelKeepsItsStrata) {
  // The first 2^m points of a pixel lie one in each elementary interval of area 2^-m.
  for (uint32_t pixel = 0; pixel < 32; ++pixel) {
    const uint32_t seed = pixel_seed(7, 13 * pixel, 29 * pixel, true);
    for (int bits = 0; bits <= 6; ++bits) {
      std::vector<int> seen(64, 0);
      for (uint32_t s = 0; s < 64; ++s) {
        const Vec2 u = random_pair(seed, s, 2);
        ++seen[(static_cast<int>(u.x * static_cast<float>(1 << bits)) << (6 - bits)) +
               static_cast<int>(u.y * static_cast<float>(1 << (6 - bits)))];
      }
      for (const int count : seen) EXPECT_EQ(count, 1);
    }
  }
}

TEST(BlueNoise, KindsOfSeedsAreToldApart) {
  for (uint32_t i = 0; i < 1000; ++i) {
    EXPECT_FALSE(has_blue_noise(pixel_seed(i, 3 * i, 7 * i)));
    EXPECT_TRUE(has_blue_noise(pixel_seed(i, 3 * i, 7 * i, true)));
  }
}

}  // namespace
}  // namespace skytree
