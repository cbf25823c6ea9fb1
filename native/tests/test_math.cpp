// SPDX-License-Identifier: GPL-3.0-or-later
// kernel/math.h against libm in double.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "kernel/math.h"

namespace skytree {
namespace {

/// Largest error over random arguments in [lo, hi), in units of the last place of the true value.
double largest_ulp_error(float lo, float hi, const std::function<float(float)>& ours,
                         const std::function<double(double)>& truth) {
  std::mt19937 generator(7);
  std::uniform_real_distribution<float> argument(lo, hi);
  double worst = 0;
  for (int i = 0; i < 200000; ++i) {
    const float x = argument(generator);
    const double expected = truth(x);
    const float magnitude = std::fabs((float)expected);
    const double ulp = std::nextafter(magnitude, INFINITY) - magnitude;
    worst = std::max(worst, std::fabs(ours(x) - expected) / ulp);
  }
  return worst;
}

float sin_turns(float t) {
  float s, c;
  sky_sincos_turns(t, &s, &c);
  return s;
}

float cos_turns(float t) {
  float s, c;
  sky_sincos_turns(t, &s, &c);
  return c;
}

TEST(Math, ExponentialsAreExactToAnUlpOrTwo) {
  EXPECT_LT(largest_ulp_error(-87, 88, sky_exp, [](double x) { return std::exp(x); }), 1.5);
  EXPECT_LT(largest_ulp_error(-103, -87, sky_exp, [](double x) { return std::exp(x); }), 1.5);
  EXPECT_LT(largest_ulp_error(-126, 127, sky_exp2, [](double x) { return std::exp2(x); }), 1.5);
  EXPECT_LT(largest_ulp_error(-20, 88, sky_expm1, [](double x) { return std::expm1(x); }), 2.0);
  EXPECT_LT(largest_ulp_error(-1e-3f, 1e-3f, sky_expm1, [](double x) { return std::expm1(x); }),
            1.0);
}

TEST(Math, LogarithmsAreExactToAnUlpOrTwo) {
  EXPECT_LT(largest_ulp_error(0, 3, sky_log, [](double x) { return std::log(x); }), 1.5);
  EXPECT_LT(largest_ulp_error(0, 1e30f, sky_log, [](double x) { return std::log(x); }), 1.5);
  EXPECT_LT(largest_ulp_error(0, 1e-38f, sky_log, [](double x) { return std::log(x); }), 1.5);
  EXPECT_LT(largest_ulp_error(0, 3, sky_log2, [](double x) { return std::log2(x); }), 2.5);
  EXPECT_LT(largest_ulp_error(-0.99f, 3, sky_log1p, [](double x) { return std::log1p(x); }), 1.5);
  EXPECT_LT(largest_ulp_error(-0.01f, 0.01f, sky_log1p, [](double x) { return std::log1p(x); }),
            1.0);
  EXPECT_LT(largest_ulp_error(1, 1e6f, sky_log1p, [](double x) { return std::log1p(x); }), 1.5);
}

TEST(Math, SineAndCosineOfTurnsKeepTheirRelativePrecisionAtZeros) {
  // The double's own argument must be reduced exactly too: 2 pi t is rounded, and near a zero
  // nothing else is left.
  const auto sine = [](double t) {
    const double halves = std::round(2 * t);
    return std::sin(2 * M_PI * (t - halves / 2)) * (std::fmod(halves, 2) == 0 ? 1 : -1);
  };
  EXPECT_LT(largest_ulp_error(-2, 2, sin_turns, sine), 2.5);
  EXPECT_LT(largest_ulp_error(-2, 2, cos_turns, [&](double t) { return sine(t + 0.25); }), 2.5);
  EXPECT_EQ(sin_turns(0.5f), 0.0f);
  EXPECT_EQ(cos_turns(0.25f), 0.0f);
}

TEST(Math, SineAndCosineOfRadians) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<float> argument(-8192, 8192);
  for (int i = 0; i < 200000; ++i) {
    const float x = argument(generator);
    EXPECT_NEAR(sky_sin(x), std::sin((double)x), 1.2e-7);
    EXPECT_NEAR(sky_cos(x), std::cos((double)x), 1.2e-7);
  }
}

TEST(Math, Atan2InEveryQuadrant) {
  const auto ours = [](float a) {
    return sky_atan2((float)std::sin((double)a), (float)std::cos((double)a));
  };
  const auto truth = [](double a) {
    return std::atan2((double)(float)std::sin(a), (double)(float)std::cos(a));
  };
  EXPECT_LT(largest_ulp_error(-3.1415f, 3.1415f, ours, truth), 3.0);
  const float edge[] = {0.0f, -0.0f, 1.0f, -1.0f, 1e-30f, 1e30f};
  for (float y : edge) {
    for (float x : edge) EXPECT_FLOAT_EQ(sky_atan2(y, x), std::atan2(y, x)) << y << ' ' << x;
  }
}

TEST(Math, SpecialValues) {
  EXPECT_EQ(sky_log(0.0f), -INFINITY);
  EXPECT_TRUE(std::isnan(sky_log(-1.0f)));
  EXPECT_EQ(sky_log(INFINITY), INFINITY);
  EXPECT_EQ(sky_log1p(-1.0f), -INFINITY);
  EXPECT_EQ(sky_log1p(INFINITY), INFINITY);
  EXPECT_EQ(sky_exp(-INFINITY), 0.0f);
  EXPECT_EQ(sky_exp(INFINITY), INFINITY);
  EXPECT_EQ(sky_exp2(128.0f), INFINITY);
  EXPECT_EQ(sky_exp2(3.0f), 8.0f);
  EXPECT_TRUE(std::isnan(sky_exp(NAN)));
  EXPECT_EQ(sky_expm1(0.0f), 0.0f);
}

}  // namespace
}  // namespace skytree
