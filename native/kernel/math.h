// SPDX-License-Identifier: GPL-3.0-or-later
// Transcendental functions with the same bits on host and device: range reduction and minimax
// polynomials from IEEE-exact operations only, without branches, so that loops vectorise.
// Coefficients: minimax.py beside this file. Largest errors against libm are tested in
// tests/test_math.cpp (2 to 3 ulp). Library functions differ between libm and CUDA in the last
// bits, and then an image depends on the device.
#pragma once

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "kernel/config.h"
#include "kernel/minmax.h"

namespace skytree {

constexpr float kPi = 3.14159265358979f;
constexpr float kTwoPi = 6.28318530717959f;
constexpr float kInvPi = 0.318309886183791f;
constexpr float kInvTwoPi = 0.159154943091895f;
constexpr float kFourPi = 12.5663706143592f;
constexpr float kInvFourPi = 0.0795774715459477f;
/// The largest float below 1: what a random number may be at most.
constexpr float kOneMinusEpsilon = 0.99999994f;

SKY_HD uint32_t float_bits(float x) {
  uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  return bits;
}
SKY_HD float bits_float(uint32_t bits) {
  float x;
  memcpy(&x, &bits, sizeof x);
  return x;
}

namespace detail {

// Adding 1.5 * 2^23 leaves the nearest integer in the low mantissa bits: for |x| < 2^22, and unlike
// a cast it is defined for NaN and infinity too.
constexpr float kRoundMagic = 12582912.0f;
constexpr float kLn2Hi = 0.693145751953125f;  // 16 bits, so that k * kLn2Hi is exact
constexpr float kLn2Lo = 1.42860682030941723212e-6f;
constexpr float kLog2E = 1.44269504088896f;

/// sin and cos of r + quadrant * pi/2 for |r| <= pi/4.
SKY_HD void sincos_quadrant(float r, uint32_t quadrant, float* sine, float* cosine) {
  const float s = r * r;
  const float sin_r = r + r * s * (-0.16666655f + s * (0.008332178f + s * -0.000195173f));
  const float cos_r =
      1.0f - 0.5f * s + s * s * (0.041666646f + s * (-0.0013887368f + s * 2.4438452e-05f));
  const bool swap = quadrant & 1;
  const uint32_t sin_sign = (quadrant & 2) << 30;
  const uint32_t cos_sign = ((quadrant + 1) & 2) << 30;
  *sine = bits_float(float_bits(swap ? cos_r : sin_r) ^ sin_sign);
  *cosine = bits_float(float_bits(swap ? sin_r : cos_r) ^ cos_sign);
}

/// exp(r) - 1 for |r| <= ln(2)/2.
SKY_HD float expm1_reduced(float r) {
  return r + r * r *
                 (0.5f + r * (0.16666667f +
                              r * (0.041666355f +
                                   r * (0.008333273f + r * (0.0013940998f + r * 0.00019914156f)))));
}

/// log(1 + f) - f for sqrt(1/2) <= 1 + f <= sqrt(2).
SKY_HD float log1p_tail(float f) {
  const float s = f * f;
  const float p =
      0.33333316f +
      f * (-0.2500081f +
           f * (0.20002286f +
                f * (-0.16624554f +
                     f * (0.1418119f + f * (-0.13128754f + f * (0.12881655f + f * -0.0785962f))))));
  return s * (f * p - 0.5f);
}

SKY_HD float pow2_int(int k) { return bits_float((uint32_t)(k + 127) << 23); }

/// m * 2^k for -252 <= k <= 254; two factors, so that results may be denormal or overflow to
/// infinity.
SKY_HD float scale_pow2(float m, int k) {
  const int half = k >> 1;
  return m * pow2_int(half) * pow2_int(k - half);
}

/// x = 2^e (1 + f) with sqrt(1/2) <= 1 + f < sqrt(2), for x > 0 and finite.
SKY_HD void log_reduce(float x, float* f, float* e) {
  const bool denormal = x < 1.17549435e-38f;
  const uint32_t bits = float_bits(denormal ? x * 8388608.0f : x);
  const uint32_t offset = bits - 0x3f3504f3u;  // sqrt(1/2)
  const int exponent = (int32_t)offset >> 23;
  *f = bits_float(bits - ((uint32_t)exponent << 23)) - 1.0f;
  *e = (float)(exponent - (denormal ? 23 : 0));
}

SKY_HD float log_special(float x, float value) {
  value = x == 0.0f ? -INFINITY : value;
  value = x < 0.0f || x != x ? NAN : value;
  return x == INFINITY ? INFINITY : value;
}

}  // namespace detail

/// sin and cos of 2 pi t, |t| < 2^20; the reduction to an octant is exact.
SKY_HD void sky_sincos_turns(float t, float* sine, float* cosine) {
  const float magic = 4.0f * t + detail::kRoundMagic;
  const float r = t - 0.25f * (magic - detail::kRoundMagic);
  detail::sincos_quadrant(kTwoPi * r, float_bits(magic), sine, cosine);
}

/// sin and cos of x radians, |x| <= 8192. pi/2 is subtracted in three parts: the absolute error
/// stays below 1e-7, the relative one grows next to the zeros.
SKY_HD void sky_sincos(float x, float* sine, float* cosine) {
  const float magic = x * 0.636619772367581f + detail::kRoundMagic;
  const float k = magic - detail::kRoundMagic;
  const float r =
      ((x - k * 1.5703125f) - k * 4.837512969970703125e-4f) - k * 7.54978995489188216e-8f;
  detail::sincos_quadrant(r, float_bits(magic), sine, cosine);
}

SKY_HD float sky_sin(float x) {
  float s, c;
  sky_sincos(x, &s, &c);
  return s;
}
SKY_HD float sky_cos(float x) {
  float s, c;
  sky_sincos(x, &s, &c);
  return c;
}

/// Angle of (x, y) in [-pi, pi], as atan2 for finite arguments; atan2(0, 0) = 0.
SKY_HD float sky_atan2(float y, float x) {
  const float ax = fabsf(x), ay = fabsf(y);
  const float hi = maxf(ax, ay), lo = minf(ax, ay);
  const bool upper = lo > 0.414213562f * hi;  // tan(pi/8)
  const float numerator = upper ? lo - hi : lo;
  const float denominator = upper ? lo + hi : hi;
  const float t = numerator / (denominator > 0.0f ? denominator : 1.0f);
  const float s = t * t;
  const float tail =
      t * s * (-0.33332956f + s * (0.19977926f + s * (-0.13879849f + s * 0.08060307f)));
  float angle = (upper ? 0.785398163f : 0.0f) + (t + tail);
  angle = ay > ax ? 1.57079632679f - angle : angle;
  angle = float_bits(x) >> 31 ? kPi - angle : angle;
  return bits_float(float_bits(angle) ^ (float_bits(y) & 0x80000000u));
}

SKY_HD float sky_exp(float x) {
  const float clamped = minf(maxf(x, -110.0f), 110.0f);
  const float magic = clamped * detail::kLog2E + detail::kRoundMagic;
  const float k = magic - detail::kRoundMagic;
  const float r = (clamped - k * detail::kLn2Hi) - k * detail::kLn2Lo;
  return x != x ? x : detail::scale_pow2(1.0f + detail::expm1_reduced(r), (int)k);
}

SKY_HD float sky_exp2(float x) {
  const float clamped = minf(maxf(x, -160.0f), 160.0f);
  const float k = (clamped + detail::kRoundMagic) - detail::kRoundMagic;
  const float r = (clamped - k) * 0.693147180559945f;
  return x != x ? x : detail::scale_pow2(1.0f + detail::expm1_reduced(r), (int)k);
}

/// exp(x) - 1 with full relative precision near 0; |x| up to 88.
SKY_HD float sky_expm1(float x) {
  const float clamped = minf(maxf(x, -30.0f), 88.0f);
  const float magic = clamped * detail::kLog2E + detail::kRoundMagic;
  const float k = magic - detail::kRoundMagic;
  const float r = (clamped - k * detail::kLn2Hi) - k * detail::kLn2Lo;
  const float scale = detail::pow2_int((int)k);
  return x != x ? x : scale * detail::expm1_reduced(r) + (scale - 1.0f);
}

SKY_HD float sky_log(float x) {
  float f, e;
  detail::log_reduce(x, &f, &e);
  const float value = e * detail::kLn2Hi + (f + (detail::log1p_tail(f) + e * detail::kLn2Lo));
  return detail::log_special(x, value);
}

SKY_HD float sky_log2(float x) {
  float f, e;
  detail::log_reduce(x, &f, &e);
  return detail::log_special(x, e + (f + detail::log1p_tail(f)) * detail::kLog2E);
}

/// log(1 + x) with full relative precision near 0.
SKY_HD float sky_log1p(float x) {
  const float y = 1.0f + x;
  float f, e;
  detail::log_reduce(y, &f, &e);
  const bool near = x > -0.29f && x < 0.41f;
  // What rounding 1 + x lost, to first order; without it the result is as coarse as y.
  const float lost = y >= 1e30f || y <= 0.0f ? 0.0f : (x - (y - 1.0f)) / y;
  f = near ? x : f;
  e = near ? 0.0f : e;
  const float correction = near ? 0.0f : lost;
  const float value =
      e * detail::kLn2Hi + (f + (detail::log1p_tail(f) + (e * detail::kLn2Lo + correction)));
  return detail::log_special(y, value);
}

}  // namespace skytree
