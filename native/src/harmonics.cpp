// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/harmonics.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "src/environment_image.h"

namespace skytree {
namespace {

// Normalisation of the real harmonics.
constexpr double kY00 = 0.28209479177387814, kY1 = 0.48860251190291992;
constexpr double kY2 = 1.0925484305920792, kY20 = 0.31539156525252005, kY22 = 0.54627421529603959;

/// Integrals over a row of 1, z, z^2 and, with r = sqrt(1 - z^2), of r, r z, r^2; by z.
struct RowIntegrals {
  double one, z, z2, r, rz, r2;
};

RowIntegrals antiderivative(double z) {
  const double r = std::sqrt(std::max(1.0 - z * z, 0.0));
  return {z,
          z * z / 2,
          z * z * z / 3,
          0.5 * (z * r + std::asin(std::clamp(z, -1.0, 1.0))),
          -r * r * r / 3,
          z - z * z * z / 3};
}

RowIntegrals row_integrals(int y, int height) {
  const RowIntegrals a = antiderivative(std::cos(M_PI * y / height));
  const RowIntegrals b = antiderivative(std::cos(M_PI * (y + 1) / height));
  return {a.one - b.one, a.z - b.z, a.z2 - b.z2, a.r - b.r, a.rz - b.rz, a.r2 - b.r2};
}

}  // namespace

std::array<std::array<double, 3>, 9> harmonic_coefficients(const LatLongImage& image) {
  check_image(image);
  const int width = image.width, height = image.height;
  // Integrals over a texel of 1, cos, sin of the azimuth and of twice the azimuth.
  std::vector<std::array<double, 5>> waves(width);
  for (int x = 0; x < width; ++x) {
    const double hi = M_PI - 2 * M_PI * x / width, lo = M_PI - 2 * M_PI * (x + 1) / width;
    waves[x] = {hi - lo, std::sin(hi) - std::sin(lo), std::cos(lo) - std::cos(hi),
                0.5 * (std::sin(2 * hi) - std::sin(2 * lo)),
                0.5 * (std::cos(2 * lo) - std::cos(2 * hi))};
  }
  std::array<std::array<double, 3>, 9> sums = {};
  for (int y = 0; y < height; ++y) {
    double row[5][3] = {};
    for (int x = 0; x < width; ++x) {
      const float* t = image.texels + 3 * ((int64_t)y * width + x);
      for (int k = 0; k < 5; ++k) {
        for (int c = 0; c < 3; ++c) row[k][c] += waves[x][k] * usable_radiance(t[c]);
      }
    }
    const RowIntegrals i = row_integrals(y, height);
    for (int c = 0; c < 3; ++c) {
      sums[0][c] += kY00 * i.one * row[0][c];
      sums[1][c] += kY1 * i.r * row[2][c];
      sums[2][c] += kY1 * i.z * row[0][c];
      sums[3][c] += kY1 * i.r * row[1][c];
      sums[4][c] += 0.5 * kY2 * i.r2 * row[4][c];
      sums[5][c] += kY2 * i.rz * row[2][c];
      sums[6][c] += kY20 * (3 * i.z2 - i.one) * row[0][c];
      sums[7][c] += kY2 * i.rz * row[1][c];
      sums[8][c] += kY22 * i.r2 * row[3][c];
    }
  }
  return sums;
}

Vec3 harmonic_irradiance(const std::array<std::array<double, 3>, 9>& coefficients, Vec3 n) {
  // The cosine's own coefficients by band.
  const double a0 = M_PI, a1 = 2 * M_PI / 3, a2 = M_PI / 4;
  const double x = n.x, y = n.y, z = n.z;
  const double basis[9] = {a0 * kY00,
                           a1 * kY1 * y,
                           a1 * kY1 * z,
                           a1 * kY1 * x,
                           a2 * kY2 * x * y,
                           a2 * kY2 * y * z,
                           a2 * kY20 * (3 * z * z - 1),
                           a2 * kY2 * x * z,
                           a2 * kY22 * (x * x - y * y)};
  double sum[3] = {};
  for (int i = 0; i < 9; ++i) {
    for (int c = 0; c < 3; ++c) sum[c] += basis[i] * coefficients[i][c];
  }
  return {(float)sum[0], (float)sum[1], (float)sum[2]};
}

}  // namespace skytree
