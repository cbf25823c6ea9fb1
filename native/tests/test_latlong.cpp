// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "kernel/latlong.h"
#include "src/environment_image.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

TEST(LatLong, AxesAreBlenders) {
  // u = 0.5 - phi/2pi: the map's middle is +X, a quarter to the left of it +Y.
  const Vec2 x = latlong_uv({1, 0, 0}), y = latlong_uv({0, 1, 0}), up = latlong_uv({0, 0, 1});
  EXPECT_FLOAT_EQ(x.x, 0.5f);
  EXPECT_FLOAT_EQ(x.y, 0.5f);
  EXPECT_FLOAT_EQ(y.x, 0.25f);
  EXPECT_FLOAT_EQ(up.y, 0.0f);
}

TEST(LatLong, DirectionAndPositionAreInverse) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> uniform(0.001f, 0.999f);
  for (int i = 0; i < 100000; ++i) {
    const float u = uniform(generator), v = uniform(generator);
    const Vec3 d = latlong_direction(u, v);
    EXPECT_NEAR(length(d), 1.0f, 3e-7f);
    const Vec2 uv = latlong_uv(d);
    EXPECT_NEAR(uv.x, u, 2e-7f);
    EXPECT_NEAR(uv.y, v, 2e-7f);
  }
}

TEST(LatLong, ElevationKeyGrowsFromPoleToPole) {
  int32_t last = -1;
  for (int i = 1; i < 200000; ++i) {
    const double theta = M_PI * i / 200000;
    const Vec3 d = {(float)std::sin(theta), 0.0f, (float)std::cos(theta)};
    const int32_t key = elevation_key(d);
    EXPECT_GE(key, last) << theta;
    last = key;
  }
}

TEST(LatLong, ElevationKeyTellsRowsOfA16kMapApartAtBothPoles) {
  constexpr int kHeight = 8192;
  for (int row : {0, 1, 2, kHeight - 3, kHeight - 2}) {
    const double theta = M_PI * (row + 0.5) / kHeight, next = M_PI * (row + 1.5) / kHeight;
    const Vec3 a = {(float)std::sin(theta), 0.0f, (float)std::cos(theta)};
    const Vec3 b = {(float)std::sin(next), 0.0f, (float)std::cos(next)};
    EXPECT_LT(elevation_key(a) + 1000, elevation_key(b)) << row;
  }
}

TEST(LatLong, TexelOfEveryCentreOfALargeMap) {
  constexpr int kWidth = 16384, kHeight = 8192;
  for (int i = 0; i < 100000; ++i) {
    const int x = (int)(testing::hash_noise(i, 1) * kWidth),
              y = (int)(testing::hash_noise(i, 2) * kHeight);
    int32_t tx, ty;
    latlong_texel(latlong_direction((x + 0.5f) / kWidth, (y + 0.5f) / kHeight), kWidth, kHeight,
                  &tx, &ty);
    EXPECT_EQ(tx, x);
    EXPECT_EQ(ty, y);
  }
}

TEST(LatLong, LookupInterpolatesWrapsAndClamps) {
  Map map(4, 3);
  map.set(0, 1, 1.0f);
  const LatLongImage image = map.view();
  const float v = 0.5f;                                           // centre of row 1
  EXPECT_FLOAT_EQ(lookup_bilinear_uv(image, 0.125f, v).x, 1.0f);  // centre of the texel
  EXPECT_FLOAT_EQ(lookup_bilinear_uv(image, 0.25f, v).x, 0.5f);   // its right border
  EXPECT_FLOAT_EQ(lookup_bilinear_uv(image, 0.0f, v).x, 0.5f);    // its left border, on the seam
  EXPECT_FLOAT_EQ(lookup_bilinear_uv(image, 1.0f, v).x, 0.5f);    // the seam from the other side
  EXPECT_FLOAT_EQ(lookup_bilinear_uv(image, 0.125f, 1 / 3.0f).x, 0.5f);
  map.set(2, 0, 3.0f);
  for (float near_pole : {0.0f, 0.01f, 0.16f}) {
    EXPECT_FLOAT_EQ(lookup_bilinear_uv(image, 0.625f, near_pole).x, 3.0f);
  }
}

TEST(LatLong, LookupOfASingleTexelIsConstant) {
  Map map(1, 1, 2.5f);
  for (float u : {0.0f, 0.3f, 0.5f, 1.0f}) {
    for (float v : {0.0f, 0.7f, 1.0f}) {
      EXPECT_FLOAT_EQ(lookup_bilinear_uv(map.view(), u, v).y, 2.5f);
    }
  }
}

TEST(EnvironmentImage, RowSolidAnglesSumToTheSphere) {
  for (int height : {1, 2, 3, 8, 513, 8192}) {
    double total = 0;
    for (double omega : row_solid_angles(2 * height, height)) total += 2 * height * omega;
    EXPECT_NEAR(total, 4 * M_PI, 1e-9) << height;
  }
}

TEST(EnvironmentImage, BadTexelsAreCountedByKindAndTheirBadValuesReadAsZero) {
  Map map(5, 2, 1.0f);
  map.texels[0] = NAN;
  map.texels[4] = INFINITY;
  map.texels[8] = -1.0f;
  map.texels[9] = -INFINITY;
  std::vector<float> row(5);
  BadTexels bad;
  luminance_row(map.view(), 0, row.data(), &bad);
  EXPECT_EQ(bad.nan, 1);
  EXPECT_EQ(bad.infinite, 2);
  EXPECT_EQ(bad.negative, 1);
  const float good[] = {1 - 0.2126f, 1 - 0.7152f, 1 - 0.0722f, 1 - 0.2126f, 1};
  for (int x = 0; x < 5; ++x) EXPECT_NEAR(row[x], good[x], 1e-6f) << x;
  EXPECT_EQ(
      bad.message(),
      "environment map has 4 bad texels (1 NaN, 2 infinite, 1 negative); such values count as 0");
  EXPECT_EQ(count_bad_texels(map.view()).total(), 4);
}

TEST(EnvironmentImage, EmptyAndOversizedImagesAreRefusedByName) {
  const float texel[3] = {0, 0, 0};
  for (const LatLongImage& image : {LatLongImage{texel, 0, 1}, LatLongImage{texel, 1, 0},
                                    LatLongImage{nullptr, 1, 1}, LatLongImage{texel, 70000, 1}}) {
    EXPECT_THROW(check_image(image), std::invalid_argument);
  }
}

}  // namespace
}  // namespace skytree
