// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/brdf_table.h"

#include <cmath>
#include <stdexcept>

#include "kernel/microfacet.h"
#include "kernel/ward.h"

namespace skytree {
namespace {

constexpr size_t kLargestTable = size_t(1) << 28;  // values; indices in the kernel have 32 bits

size_t cell_count(const BrdfTableSize& size) {
  size_t count = 1;
  for (const int n : {size.half_theta, size.half_phi, size.diff_theta, size.diff_phi}) {
    if (n < 1 || count * size_t(n) > kLargestTable) {
      throw std::invalid_argument(
          "BRDF table: sizes must be at least 1 and make at most 2^28 cells");
    }
    count *= size_t(n);
  }
  return count;
}

/// The directions at the middle of a cell, of which one may lie below the surface.
struct Directions {
  Vec3 o, i, h;
  float cos_half;
};

Directions cell_directions(const BrdfTableSize& size, Vec2 stretch, int half_theta, int half_phi,
                           int diff_theta, int diff_phi) {
  const double t = (half_theta + 0.5) / size.half_theta;
  const double theta_h = 0.5 * M_PI * t * t;
  const double phi_h = size.half_phi == 1 ? 0.0 : 2.0 * M_PI * (half_phi + 0.5) / size.half_phi;
  const Vec3 h =
      normalize({float(std::sin(theta_h) * std::cos(phi_h)) * stretch.x,
                 float(std::sin(theta_h) * std::sin(phi_h)) * stretch.y, float(std::cos(theta_h))});
  const double theta_d = 0.5 * M_PI * (diff_theta + 0.5) / size.diff_theta;
  const double phi_d = M_PI * (diff_phi + 0.5) / size.diff_phi;
  const float radius = sqrtf(h.x * h.x + h.y * h.y);
  const Vec2 axis = {h.x / radius, h.y / radius};
  const Vec3 along = {axis.x * h.z, axis.y * h.z, -radius}, across = {-axis.y, axis.x, 0.0f};
  const Vec3 side = along * float(std::sin(theta_d) * std::cos(phi_d)) +
                    across * float(std::sin(theta_d) * std::sin(phi_d));
  const Vec3 up = h * float(std::cos(theta_d));
  return {up - side, up + side, h, float(std::cos(theta_d))};
}

template <class Model>
BrdfTablePointer tabulate(float alpha_x, float alpha_y, bool stretched, BrdfTableSize size,
                          Model model) {
  for (const float alpha : {alpha_x, alpha_y}) {
    if (!(alpha >= 1e-3f && alpha <= 1.0f)) {
      throw std::invalid_argument("BRDF table: alpha must be between 0.001 and 1");
    }
  }
  const bool isotropic = alpha_x == alpha_y;
  if (size.half_theta == 0)
    size = isotropic ? BrdfTableSize{128, 1, 96, 16} : BrdfTableSize{64, 64, 48, 8};
  const float largest = fmaxf(alpha_x, alpha_y);
  const Vec2 stretch = stretched ? Vec2{alpha_x / largest, alpha_y / largest} : Vec2{1.0f, 1.0f};
  std::vector<float> values;
  values.reserve(cell_count(size));
  for (int a = 0; a < size.half_theta; ++a) {
    for (int b = 0; b < size.half_phi; ++b) {
      for (int c = 0; c < size.diff_theta; ++c) {
        for (int d = 0; d < size.diff_phi; ++d) {
          values.push_back(model(cell_directions(size, stretch, a, b, c, d)));
        }
      }
    }
  }
  return std::make_shared<BrdfTable>(std::move(values), size, 1, stretch);
}

}  // namespace

BrdfTable::BrdfTable(std::vector<float> values, BrdfTableSize size, int channels, Vec2 stretch)
    : values_(std::move(values)), size_(size), channels_(channels), stretch_(stretch) {
  if (channels != 1 && channels != 3) {
    throw std::invalid_argument("BRDF table: 1 or 3 channels, not " + std::to_string(channels));
  }
  const size_t wanted = cell_count(size) * size_t(channels);
  if (values_.size() != wanted) {
    throw std::invalid_argument("BRDF table: " + std::to_string(wanted) + " values are needed, " +
                                std::to_string(values_.size()) + " were given");
  }
  for (const float s : {stretch.x, stretch.y}) {
    if (!(s > 0.0f && s <= 1.0f)) {
      throw std::invalid_argument("BRDF table: stretch must be in (0, 1]");
    }
  }
  for (float& x : values_) x = x >= 0.0f && x <= 3.4e38f ? x : 0.0f;
}

BrdfTableView BrdfTable::view() const {
  return {values_.data(), size_.half_theta, size_.half_phi, size_.diff_theta,
          size_.diff_phi, channels_,        stretch_};
}

BrdfTablePointer make_ward_table(float alpha_x, float alpha_y, bool stretched, BrdfTableSize size) {
  return tabulate(alpha_x, alpha_y, stretched, size, [&](const Directions& d) {
    // Ward's value knows the half vector and cos_half only: it goes on below the horizon.
    const float pdf = ward_eval(d.o, d.i, alpha_x, alpha_y).pdf;
    return pdf / (d.cos_half * d.h.z);
  });
}

BrdfTablePointer make_ggx_table(float alpha_x, float alpha_y, bool stretched, BrdfTableSize size) {
  return tabulate(alpha_x, alpha_y, stretched, size, [&](Directions d) {
    // Below the horizon, where the value only serves interpolation, the cosines are mirrored.
    d.o.z = fmaxf(fabsf(d.o.z), 1e-4f);
    d.i.z = fmaxf(fabsf(d.i.z), 1e-4f);
    const float masking =
        1.0f + ggx_lambda(d.o, alpha_x, alpha_y) + ggx_lambda(d.i, alpha_x, alpha_y);
    return ggx_distribution(d.h, alpha_x, alpha_y) / (4.0f * d.o.z * d.i.z * masking);
  });
}

}  // namespace skytree
