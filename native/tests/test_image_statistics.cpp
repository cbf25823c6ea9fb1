// SPDX-License-Identifier: GPL-3.0-or-later
// Strip tables against sums over texels, split planes against trying every plane, the moments of
// interpolated radiance against quadrature.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "src/range_table.h"
#include "src/split_criterion.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

ImageStatistics measure(const Map& map, Statistics statistics) {
  ThreadTeam team(2);
  const auto ignore = [](double) {};
  return ImageStatistics(std::make_shared<LuminancePlane>(map.view(), team, ignore), statistics,
                         team, ignore);
}

/// Moments of every texel by definition: the oracle.
class BruteForce {
 public:
  BruteForce(const Map& map, Statistics statistics)
      : width_(map.width), moments_(map.width * map.height) {
    const LatLongImage image = map.view();
    const auto luminance_at = [&](int x, int y) {
      x = (x + map.width) % map.width;
      y = std::clamp(y, 0, map.height - 1);
      return (double)texel_luminance(image.texels + 3 * ((size_t)y * map.width + x));
    };
    // Gauss quadrature with two points a half texel integrates the square of the bilinear
    // interpolation exactly.
    const double gauss[4] = {
        0.5 - 0.25 * (1 + 1 / std::sqrt(3.0)), 0.5 - 0.25 * (1 - 1 / std::sqrt(3.0)),
        0.5 + 0.25 * (1 - 1 / std::sqrt(3.0)), 0.5 + 0.25 * (1 + 1 / std::sqrt(3.0))};
    const std::vector<double> solid_angles = row_solid_angles(map.width, map.height);
    for (int y = 0; y < map.height; ++y) {
      for (int x = 0; x < map.width; ++x) {
        Moments& m = moments_[(size_t)y * width_ + x];
        if (statistics == Statistics::PIXELS) {
          const double l = luminance_at(x, y);
          m = {l, l * l};
          continue;
        }
        m = {0, 0};
        for (double gy : gauss) {
          for (double gx : gauss) {
            const int x0 = gx < 0.5 ? x - 1 : x, y0 = gy < 0.5 ? y - 1 : y;
            const double fx = gx < 0.5 ? gx + 0.5 : gx - 0.5, fy = gy < 0.5 ? gy + 0.5 : gy - 0.5;
            const double l =
                (1 - fy) * ((1 - fx) * luminance_at(x0, y0) + fx * luminance_at(x0 + 1, y0)) +
                fy * ((1 - fx) * luminance_at(x0, y0 + 1) + fx * luminance_at(x0 + 1, y0 + 1));
            m = m + Moments{l * solid_angles[y] / 16, l * l * solid_angles[y] / 16};
          }
        }
      }
    }
  }

  Moments sum(const TexelRect& rect) const {
    Moments total{};
    for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
      for (int x = rect.lo[0]; x < rect.hi[0]; ++x)
        total = total + moments_[(size_t)y * width_ + x];
    }
    return total;
  }

 private:
  int width_;
  std::vector<Moments> moments_;
};

Map noisy_map(int width, int height, uint32_t seed) {
  Map map(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float r = testing::hash_noise(x + 1000 * seed, y);
      map.set(x, y, r > 0.995f ? 5000.0f : 0.1f + r * r);
    }
  }
  return map;
}

TexelRect random_rect(std::mt19937& generator, int width, int height) {
  const auto pick = [&](int limit) { return (int)(generator() % (uint32_t)limit); };
  TexelRect rect;
  rect.lo[0] = pick(width);
  rect.lo[1] = pick(height);
  rect.hi[0] = rect.lo[0] + 1 + pick(width - rect.lo[0]);
  rect.hi[1] = rect.lo[1] + 1 + pick(height - rect.lo[1]);
  return rect;
}

struct Size {
  int width, height;
};
constexpr Size kSizes[] = {{1, 1}, {3, 2}, {16, 16}, {17, 33}, {100, 50}, {64, 32}, {47, 90}};

TEST(ImageStatistics, EverySumIsTheSumOverItsTexels) {
  std::mt19937 generator(5);
  for (Statistics statistics : {Statistics::RADIANCE, Statistics::PIXELS}) {
    for (const Size& size : kSizes) {
      const Map map = noisy_map(size.width, size.height, 1);
      const BruteForce oracle(map, statistics);
      const ImageStatistics fast = measure(map, statistics);
      for (int i = 0; i < 300; ++i) {
        const TexelRect rect = random_rect(generator, size.width, size.height);
        const Moments expected = oracle.sum(rect), got = fast.sum(rect);
        ASSERT_NEAR(got.power, expected.power, 2e-6 * expected.power + 1e-15);
        ASSERT_NEAR(got.square, expected.square, 2e-6 * expected.square + 1e-15);
      }
    }
  }
}

TEST(ImageStatistics, ASunOutsideAddsNothing) {
  Map map(64, 64, 1e-3f);
  map.set(20, 20, 1e9f);
  const BruteForce oracle(map, Statistics::PIXELS);
  const ImageStatistics fast = measure(map, Statistics::PIXELS);
  std::mt19937 generator(5);
  for (int i = 0; i < 2000; ++i) {
    const TexelRect rect = random_rect(generator, 64, 64);
    const double expected = oracle.sum(rect).square;
    // The table's differences are rounded at 1e18 * 1e-16; within that a dark rectangle must stay
    // dark.
    ASSERT_NEAR(fast.sum(rect).square, expected, 1e-5 * expected + 500.0);
  }
}

TEST(ImageStatistics, SlicesSumToTheRectangle) {
  const Map map = noisy_map(70, 90, 2);
  const BruteForce oracle(map, Statistics::RADIANCE);
  const ImageStatistics fast = measure(map, Statistics::RADIANCE);
  std::mt19937 generator(9);
  for (int i = 0; i < 300; ++i) {
    TexelRect rect = random_rect(generator, 70, 90);
    const int axis = i % 2;
    rect.hi[axis] = std::min(rect.hi[axis], rect.lo[axis] + ImageStatistics::kTile);
    double slices[ImageStatistics::kTile];
    fast.inner_slices(rect, axis, Quantity::SQUARE, slices);
    fast.add_rim_slices(rect, axis, Quantity::SQUARE, slices);
    for (int k = 0; k < rect.size(axis); ++k) {
      TexelRect slice = rect;
      slice.lo[axis] = rect.lo[axis] + k;
      slice.hi[axis] = slice.lo[axis] + 1;
      const double expected = oracle.sum(slice).square;
      ASSERT_NEAR(slices[k], expected, 2e-6 * expected);
    }
  }
}

TEST(ImageStatistics, ConstantMapHasNoSquaredError) {
  for (float value : {1e-3f, 0.7f, 1e4f}) {
    const Map map(100, 50, value);
    const ImageStatistics fast = measure(map, Statistics::RADIANCE);
    std::mt19937 generator(5);
    for (int i = 0; i < 300; ++i) {
      const TexelRect rect = random_rect(generator, 100, 50);
      EXPECT_EQ(squared_error(fast.sum(rect), fast.solid_angle(rect)), 0.0);
    }
  }
}

double score(SplitCriterion criterion, double n1, const Moments& a, double n2, const Moments& b) {
  return criterion == SplitCriterion::MIN_VARIANCE
             ? -(std::sqrt(n1 * a.square) + std::sqrt(n2 * b.square))
             : a.power * a.power / n1 + b.power * b.power / n2;
}

TEST(SplitCriterion, FindsThePlaneThatTryingEveryPlaneFinds) {
  std::mt19937 generator(11);
  for (Statistics statistics : {Statistics::RADIANCE, Statistics::PIXELS}) {
    for (uint32_t seed = 0; seed < 3; ++seed) {
      const Map map = seed == 2 ? testing::make_outdoor_map(120, 60) : noisy_map(90, 75, seed);
      const BruteForce oracle(map, statistics);
      const ImageStatistics fast = measure(map, statistics);
      for (int i = 0; i < 60; ++i) {
        const TexelRect rect = i == 0 ? TexelRect{{0, 0}, {map.width, map.height}}
                                      : random_rect(generator, map.width, map.height);
        if (rect.area() < 2) continue;
        for (SplitCriterion criterion : {SplitCriterion::SSE, SplitCriterion::MIN_VARIANCE}) {
          const auto score_at = [&](int axis, int position) {
            TexelRect a = rect, b = rect;
            a.hi[axis] = b.lo[axis] = position;
            return score(criterion, fast.solid_angle(a), oracle.sum(a), fast.solid_angle(b),
                         oracle.sum(b));
          };
          double best = -INFINITY;
          for (int axis = 0; axis < 2; ++axis) {
            for (int p = rect.lo[axis] + 1; p < rect.hi[axis]; ++p)
              best = std::max(best, score_at(axis, p));
          }
          const Split split = find_split(fast, rect, criterion);
          ASSERT_GE(split.axis, 0);
          const double whole = std::sqrt(fast.solid_angle(rect) * oracle.sum(rect).square);
          const double gain = std::max(best + whole, 0.0);
          const double tolerance = criterion == SplitCriterion::MIN_VARIANCE
                                       ? gain * kGainTolerance / (1 + kGainTolerance)
                                       : 0.0;
          // Planes whose scores differ by less than single-precision sums resolve are equally good.
          const double found = score_at(split.axis, split.position);
          EXPECT_GE(found, best - tolerance - 2e-6 * std::abs(best));
          EXPECT_NEAR(split.score, found, 4e-6 * std::abs(best));
        }
      }
    }
  }
}

TEST(SplitCriterion, SingleTexelHasNoPlane) {
  const Map map(4, 4, 1.0f);
  const ImageStatistics fast = measure(map, Statistics::PIXELS);
  EXPECT_LT(find_split(fast, {{1, 1}, {2, 2}}, SplitCriterion::SSE).axis, 0);
}

TEST(SplitCriterion, SeparatesTwoHalves) {
  Map map(32, 16, 1.0f);
  for (int y = 0; y < 16; ++y) {
    for (int x = 11; x < 32; ++x) map.set(x, y, 9.0f);
  }
  const ImageStatistics fast = measure(map, Statistics::PIXELS);
  const Split split = find_split(fast, {{0, 0}, {32, 16}}, SplitCriterion::SSE);
  EXPECT_EQ(split.axis, 0);
  EXPECT_EQ(split.position, 11);
}

TEST(RangeTable, RangeIsThatOfTheTexels) {
  const Map map = noisy_map(50, 40, 4);
  const ImageStatistics statistics = measure(map, Statistics::PIXELS);
  const LuminancePlane& plane = statistics.luminance();
  ThreadTeam team(3);
  const RangeTable table(plane, team);
  std::mt19937 generator(5);
  for (int i = 0; i < 500; ++i) {
    const TexelRect rect = random_rect(generator, 50, 40);
    float smallest = INFINITY, largest = 0;
    for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
      for (int x = rect.lo[0]; x < rect.hi[0]; ++x) {
        smallest = std::min(smallest, plane.row(y)[x]);
        largest = std::max(largest, plane.row(y)[x]);
      }
    }
    EXPECT_EQ(table.range(rect), (double)largest - smallest);
  }
}

}  // namespace
}  // namespace skytree
