// SPDX-License-Identifier: GPL-3.0-or-later
// Files of compressed maps: what was written comes back, and what is not such a file is refused.
// Under the sanitizers this also shows that no bytes, however wrong, are read or written outside.
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "src/compressed_map.h"
#include "src/rank_fit.h"
#include "synthetic_maps.h"

namespace skytree {
namespace {

testing::Map noisy_map(int width, int height) {
  testing::Map map(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      map.set(x, y, std::exp2(8.0f * testing::hash_noise((uint32_t)x, (uint32_t)y)));
    }
  }
  return map;
}

CompressedMap compress(const testing::Map& map, int64_t max_bytes, int32_t max_blocks = INT32_MAX) {
  CompressionConfig config;
  config.max_bytes = max_bytes;
  config.max_blocks = max_blocks;
  return CompressedMap::compress(map.view(), config);
}

uint32_t plain_crc32(const std::vector<uint8_t>& bytes) {
  uint32_t crc = ~0u;
  for (size_t i = 0; i < bytes.size(); ++i) {
    if (i >= 12 && i < 16) continue;
    crc ^= bytes[i];
    for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? crc >> 1 ^ 0xedb88320u : crc >> 1;
  }
  return ~crc;
}

void sign(std::vector<uint8_t>* bytes) {
  const uint32_t crc = plain_crc32(*bytes);
  for (int i = 0; i < 4; ++i) (*bytes)[12 + i] = (uint8_t)(crc >> 8 * i);
}

std::string refusal(std::vector<uint8_t> bytes) {
  try {
    CompressedMap::decode(std::move(bytes));
  } catch (const std::invalid_argument& problem) {
    return problem.what();
  }
  return "";
}

TEST(CompressedMap, FillsItsBudgetAndTilesTheMap) {
  const testing::Map map = noisy_map(61, 33);
  for (int64_t budget : {33, 40, 500, 2000, 5000}) {
    const CompressedMap made = compress(map, budget);
    EXPECT_LE((int64_t)made.bytes().size(), budget);
    // One more block would take at most its colour and about fifteen bits of the tree.
    if (budget > 40) EXPECT_GT((int64_t)made.bytes().size(), budget - 7);
    std::vector<int> covered(61 * 33);
    for (const TexelRect& rect : made.rects()) {
      for (int y = rect.lo[1]; y < rect.hi[1]; ++y)
        for (int x = rect.lo[0]; x < rect.hi[0]; ++x) ++covered[y * 61 + x];
    }
    for (int count : covered) ASSERT_EQ(count, 1);
    EXPECT_EQ(CompressedMap::decode(made.bytes()).rects().size(), made.rects().size());
  }
}

TEST(CompressedMap, EveryTexelItsOwnBlockGivesTheMapBack) {
  const testing::Map map = noisy_map(16, 8);
  const CompressedMap made = compress(map, 1 << 16);
  ASSERT_EQ(made.rects().size(), 16u * 8u);
  std::vector<float> out(map.texels.size());
  made.paint(out.data());
  for (size_t i = 0; i < out.size(); ++i) {
    EXPECT_NEAR(out[i], map.texels[i], map.texels[i] * 0.5 / 256);  // nine bits from the first one
  }
}

TEST(CompressedMap, KeepsSunsAndShadowsApart) {
  testing::Map map(32, 16, 1e-3f);
  map.set(5, 5, 1e5f);
  std::vector<float> out(map.texels.size());
  compress(map, 4096).paint(out.data());
  EXPECT_NEAR(out[3 * (5 * 32 + 5)], 1e5f, 1e5f * 0.002f);
  EXPECT_NEAR(out[0], 1e-3f, 1e-3f * 0.1f);
  testing::Map black(8, 4);
  compress(black, 4096).paint(out.data());
  EXPECT_EQ(out[0], 0.0f);
}

TEST(CompressedMap, EveryChangedByteAndEveryMissingEndIsRefused) {
  const std::vector<uint8_t> good = compress(noisy_map(40, 20), 600).bytes();
  ASSERT_EQ(refusal(good), "");
  for (size_t i = 0; i < good.size(); ++i) {
    std::vector<uint8_t> bad = good;
    bad[i] ^= 1 << i % 8;
    EXPECT_NE(refusal(bad), "") << "byte " << i;
    EXPECT_NE(refusal({good.begin(), good.begin() + (int64_t)i}), "") << i << " bytes";
  }
  std::vector<uint8_t> longer = good;
  longer.push_back(0);
  EXPECT_NE(refusal(longer).find("damaged"), std::string::npos);
  EXPECT_NE(refusal({good.begin(), good.end() - 1}).find("cut short"), std::string::npos);
}

TEST(CompressedMap, ANewerVersionIsNamed) {
  std::vector<uint8_t> bytes = compress(noisy_map(8, 4), 600).bytes();
  bytes[4] = 2;
  sign(&bytes);
  EXPECT_NE(refusal(bytes).find("newer Skytree (format 2"), std::string::npos);
}

TEST(CompressedMap, WrongBytesUnderARightChecksumDoNoHarm) {
  const std::vector<uint8_t> good = compress(noisy_map(40, 20), 600).bytes();
  int refused = 0;
  for (uint32_t round = 0; round < 4000; ++round) {
    std::vector<uint8_t> bytes = good;
    for (uint32_t k = 0; k < 1 + round % 4; ++k) {
      const size_t at = 16 + (size_t)(testing::hash_noise(round, k) * (float)(bytes.size() - 16));
      bytes[at] = (uint8_t)(256.0f * testing::hash_noise(k, round));
    }
    bytes[17] = bytes[19] = 0;  // small enough to be painted here
    sign(&bytes);
    try {
      const CompressedMap map = CompressedMap::decode(bytes);
      std::vector<float> out(3 * (size_t)map.width() * map.height());
      map.paint(out.data());
    } catch (const std::invalid_argument&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 400);
}

TEST(CompressedMap, LimitsThatLeaveNoRoomAreRefused) {
  EXPECT_THROW(compress(noisy_map(8, 4), 32), std::invalid_argument);
  EXPECT_THROW(compress(noisy_map(8, 4), 1000, 0), std::invalid_argument);
  EXPECT_EQ(compress(noisy_map(8, 4), 1000, 5).rects().size(), 5u);
}

double objective_of(const std::vector<double>& p, double alpha, RankObjective objective) {
  const std::vector<double> q = rank_probabilities(alpha, (int)p.size());
  double sum = 0;
  for (size_t i = 0; i < p.size(); ++i) {
    switch (objective) {
      case RankObjective::LIKELIHOOD:
        sum += p[i] > 0 ? p[i] * std::log(p[i] / q[i]) : 0.0;
        break;
      case RankObjective::SECOND_MOMENT:
        sum += p[i] * p[i] / q[i];
        break;
      default:
        sum += (p[i] - q[i]) * (p[i] - q[i]);
    }
  }
  return sum;
}

TEST(RankFit, NoOtherAlphaIsBetterByTheObjective) {
  for (RankObjective objective :
       {RankObjective::LEAST_SQUARES, RankObjective::LIKELIHOOD, RankObjective::SECOND_MOMENT}) {
    for (double shape : {0.3, 1.0, 1.7, 3.0}) {
      std::vector<double> p;
      double sum = 0;
      for (int i = 0; i < 300; ++i) sum += p.emplace_back(std::pow(i + 2.0, -shape));
      p.back() = 0;  // a black block
      for (double& value : p) value /= sum;
      const double alpha = fit_rank_model(p, objective).alpha;
      const double best = objective_of(p, alpha, objective);
      for (double factor = 1e-4; factor < 1e4; factor *= 1.3) {
        EXPECT_LE(best, objective_of(p, alpha * factor, objective) * (1 + 1e-9))
            << "shape " << shape << ", alpha " << alpha << " times " << factor;
      }
    }
  }
}

}  // namespace
}  // namespace skytree
