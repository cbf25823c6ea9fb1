// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "kernel/multi_jittered.h"

namespace skytree {
namespace {

constexpr uint32_t kSeed = 4711;

/// So many points lie in each of the parts that `part` numbers.
template <class Part>
std::vector<int> counts_of(uint32_t count, uint32_t pair, int parts, const Part& part) {
  std::vector<int> counts(parts, 0);
  for (uint32_t i = 0; i < count; ++i) {
    const Vec2 u = sample_pair(count, kSeed, i, pair);
    EXPECT_TRUE(u.x >= 0.0f && u.x < 1.0f && u.y >= 0.0f && u.y < 1.0f);
    ++counts[part(u)];
  }
  return counts;
}

int part_of(float u, uint32_t parts) { return int(double(u) * parts); }

TEST(MultiJittered, OnePointInEachColumnRowAndCell) {
  for (const uint32_t count :
       {1u, 2u, 4u, 6u, 8u, 9u, 12u, 16u, 25u, 64u, 100u, 128u, 144u, 256u, 1000u, 1024u, 4096u}) {
    uint32_t columns = uint32_t(std::sqrt(count));  // as near to a square as it can be
    while (count % columns != 0) --columns;
    const uint32_t rows = count / columns;
    for (uint32_t pair = 0; pair < 3; ++pair) {
      SCOPED_TRACE(::testing::Message() << count << " points, pair " << pair);
      const std::vector<int> once(count, 1);
      EXPECT_EQ(counts_of(count, pair, count, [&](Vec2 u) { return part_of(u.x, count); }), once);
      EXPECT_EQ(counts_of(count, pair, count, [&](Vec2 u) { return part_of(u.y, count); }), once);
      const auto cell = [&](Vec2 u) {
        return part_of(u.x, columns) + int(columns) * part_of(u.y, rows);
      };
      EXPECT_EQ(counts_of(count, pair, count, cell), once);
    }
  }
}

/// Cells that stay empty: no column of x has more than its share and one.
TEST(MultiJittered, PrimeNumbersAreSpreadToo) {
  for (const uint32_t count : {5u, 7u, 13u, 31u, 97u, 257u}) {
    EXPECT_EQ(counts_of(count, 1, count, [&](Vec2 u) { return part_of(u.y, count); }),
              std::vector<int>(count, 1));
    const uint32_t columns = jittered_grid(count).columns.count;
    const uint32_t rows = (count + columns - 1) / columns;
    for (const int in_column :
         counts_of(count, 1, columns, [&](Vec2 u) { return part_of(u.x, columns); })) {
      EXPECT_LE(in_column, int(rows));
    }
  }
}

TEST(MultiJittered, PermutationsAreThatAndAllAlikeOften) {
  for (const uint32_t count : {1u, 2u, 3u, 4u, 5u, 8u, 11u, 16u, 37u, 64u}) {
    // How often each number comes first, and each after it: evenly, whichever the key.
    const PermutedRange range = permuted_range(count);
    constexpr int kKeys = 4000;
    std::vector<double> firsts(count, 0), steps(count, 0);
    for (int key = 0; key < kKeys; ++key) {
      std::set<uint32_t> seen;
      for (uint32_t i = 0; i < count; ++i) seen.insert(permute_index(range, i, hash_u32(key)));
      ASSERT_EQ(seen.size(), count);
      ASSERT_LT(*seen.rbegin(), count);
      const uint32_t first = permute_index(range, 0, hash_u32(key));
      ++firsts[first];
      if (count == 1) continue;
      ++steps[(permute_index(range, 1, hash_u32(key)) + count - first) % count];
    }
    double chi2 = 0, step_chi2 = 0;
    const double expected = double(kKeys) / count, expected_step = double(kKeys) / (count - 1.0);
    for (uint32_t i = 0; i < count; ++i) {
      chi2 += std::pow(firsts[i] - expected, 2) / expected;
      if (i > 0) step_chi2 += std::pow(steps[i] - expected_step, 2) / expected_step;
    }
    EXPECT_LT(chi2, count + 5 * std::sqrt(2.0 * count)) << count;
    EXPECT_LT(step_chi2, count + 5 * std::sqrt(2.0 * count)) << count;
  }
}

TEST(MultiJittered, EachPointIsUniformAndPairsAreIndependent) {
  // Of one index over many pixels: the mean, and the correlation with the next pair and the next
  // index.
  constexpr int kPixels = 40000;
  for (const uint32_t count : {4u, 12u, 16u, 13u, 64u}) {
    double x = 0, y = 0, xy = 0, pairs = 0, squares = 0;
    for (int pixel = 0; pixel < kPixels; ++pixel) {
      const uint32_t seed = pixel_seed(3, pixel % 200, pixel / 200);
      const Vec2 u = sample_pair(count, seed, 2, 5), next = sample_pair(count, seed, 2, 6);
      x += u.x / kPixels;
      y += u.y / kPixels;
      squares += u.x * u.x / kPixels;
      xy += 12.0 * (u.x - 0.5) * (u.y - 0.5) / kPixels;
      pairs += 12.0 * (u.x - 0.5) * (next.x - 0.5) / kPixels;
    }
    const double deviation = 4.0 / std::sqrt(double(kPixels));
    EXPECT_NEAR(x, 0.5, 0.29 * deviation) << count;
    EXPECT_NEAR(y, 0.5, 0.29 * deviation) << count;
    EXPECT_NEAR(squares, 1.0 / 3.0, 0.3 * deviation) << count;
    EXPECT_NEAR(xy, 0.0, deviation) << count;
    EXPECT_NEAR(pairs, 0.0, deviation) << count;
  }
}

/// What stratification is for: independent points would have an error squared of 0.3 / count.
TEST(MultiJittered, SmoothIntegralsConvergeFast) {
  for (const uint32_t count : {16u, 64u, 100u, 256u}) {
    double error = 0;
    for (uint32_t pixel = 0; pixel < 400; ++pixel) {
      double mean = 0;
      for (uint32_t i = 0; i < count; ++i) {
        const Vec2 u = sample_pair(count, pixel_seed(1, pixel, 7), i, 2);
        mean += std::sin(3.0 * u.x) * std::exp(u.y) / count;
      }
      const double exact = (1.0 - std::cos(3.0)) / 3.0 * (std::exp(1.0) - 1.0);
      error += std::pow(mean - exact, 2) / 400;
    }
    EXPECT_LT(error, 0.2 * std::pow(count, -1.8)) << count;
  }
}

}  // namespace
}  // namespace skytree
