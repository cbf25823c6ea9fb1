// SPDX-License-Identifier: GPL-3.0-or-later
// The control variate's integral against brute-force quadrature of the interpolated map.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "src/diffuse_moments.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

/// Midpoint rule in double for the angles, `steps` points a texel and side.
std::array<double, 3> quadrature(const LatLongImage& image, Vec3 n, int steps) {
  std::array<double, 3> sum = {0, 0, 0};
  const int width = steps * image.width, height = steps * image.height;
  for (int y = 0; y < height; ++y) {
    const double v = (y + 0.5) / height, theta = M_PI * v;
    const double solid_angle = 4.0 * M_PI / width * std::sin(theta) * std::sin(0.5 * M_PI / height);
    for (int x = 0; x < width; ++x) {
      const double u = (x + 0.5) / width, phi = 2.0 * M_PI * (0.5 - u);
      const double cosine = n.x * std::sin(theta) * std::cos(phi) +
                            n.y * std::sin(theta) * std::sin(phi) + n.z * std::cos(theta);
      const Vec3 l = lookup_bilinear_uv(image, (float)u, (float)v);
      const double p = solid_angle * diffuse_polynomial((float)cosine);
      sum[0] += l.x * p;
      sum[1] += l.y * p;
      sum[2] += l.z * p;
    }
  }
  return sum;
}

const Vec3 kNormals[] = {
    {0, 0, 1},        {0, 0, -1},           {1, 0, 0},        {0, -1, 0},
    {0.6f, -0.8f, 0}, {0.48f, 0.6f, 0.64f}, {-0.8f, 0, 0.6f}, {-0.36f, -0.48f, -0.8f}};

TEST(DiffuseMoments, IntegralIsThatOfQuadrature) {
  std::vector<testing::Map> maps;
  maps.push_back(testing::make_outdoor_map(32, 16));
  maps.push_back(
      testing::make_outdoor_map(30, 7));  // whole turns are folded for an even width only
  maps.push_back(testing::make_outdoor_map(9, 5));
  for (const auto& [width, height] : {std::pair{1, 1}, {2, 1}, {3, 2}, {1, 7}, {5, 3}}) {
    testing::Map map(width, height);
    for (int i = 0; i < 3 * width * height; ++i) map.texels[i] = testing::hash_noise(i, 5);
    maps.push_back(map);
  }
  testing::Map sun(24, 12);
  sun.set(0, 0, 5e4f);
  sun.set(23, 6, 1e3f);
  maps.push_back(sun);
  for (const testing::Map& map : maps) {
    SCOPED_TRACE(std::to_string(map.width) + "x" + std::to_string(map.height));
    const DiffuseMoments moments = diffuse_moments(map.view());
    EXPECT_TRUE(is_finite(moments));
    const int steps = std::max(2, 240 / map.width);
    const std::array<double, 3> scale = quadrature(map.view(), {0, 0, 1}, 4);
    for (Vec3 n : kNormals) {
      const std::array<double, 3> expected = quadrature(map.view(), n, steps);
      const Vec3 g = diffuse_integral(moments, n);
      const double tolerance = 1e-3 * (std::abs(scale[0]) + std::abs(expected[0]));
      EXPECT_NEAR(g.x, expected[0], tolerance);
      EXPECT_NEAR(g.y, expected[1], tolerance);
      EXPECT_NEAR(g.z, expected[2], tolerance);
    }
  }
}

/// Under constant light every normal sees pi, as P has the cosine's mean.
TEST(DiffuseMoments, ConstantMapGivesPi) {
  for (int width : {1, 2, 7, 64}) {
    const testing::Map map(width, (width + 1) / 2, 2.0f);
    const DiffuseMoments moments = diffuse_moments(map.view());
    for (Vec3 n : kNormals) {
      EXPECT_NEAR(diffuse_integral(moments, n).y, 2.0 * M_PI, 1e-5);
    }
  }
}

TEST(DiffuseMoments, OverflowIsTold) {
  testing::Map map(8, 4, 3e38f);
  EXPECT_FALSE(is_finite(diffuse_moments(map.view())));
  EXPECT_THROW(diffuse_moments({nullptr, 0, 0}), std::invalid_argument);
}

}  // namespace
}  // namespace skytree
