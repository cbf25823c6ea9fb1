// SPDX-License-Identifier: GPL-3.0-or-later
// Every sampler x split criterion x block probability on every kind of map: samples follow the pdf
// (chi^2), the pdf integrates to 1, pdf(direction) is the pdf that came with the direction, and
// estimates of the map's power are unbiased.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>
#include <string>

#include "tests/all_samplers.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::all_samplers;
using testing::constant_samplers;
using testing::Map;
using testing::NamedSampler;

struct NamedMap {
  std::string name;
  Map map;
};

std::vector<NamedMap> all_maps() {
  std::vector<NamedMap> maps;
  const auto lit = [](int width, int height, std::initializer_list<std::pair<int, int>> texels,
                      float ground) {
    Map map(width, height, ground);
    for (const auto& [x, y] : texels) map.set(x, y, 1000.0f);
    return map;
  };
  maps.push_back({"constant", Map(32, 16, 0.7f)});
  maps.push_back({"black", Map(32, 16, 0.0f)});
  maps.push_back({"one lit texel", lit(32, 16, {{13, 6}}, 0.0f)});
  maps.push_back({"one lit texel at the upper pole", lit(32, 16, {{5, 0}}, 0.0f)});
  maps.push_back({"one lit texel at the lower pole", lit(32, 16, {{31, 15}}, 0.01f)});
  maps.push_back({"one lit texel on the seam", lit(32, 16, {{0, 8}}, 0.01f)});
  maps.push_back({"1x1", Map(1, 1, 2.0f)});
  maps.push_back({"3x2", lit(3, 2, {{1, 1}}, 1.0f)});
  maps.push_back({"1x7", lit(1, 7, {{0, 2}}, 1.0f)});
  maps.push_back({"two opposed suns", lit(64, 32, {{10, 8}, {42, 23}}, 0.05f)});
  maps.push_back({"outdoor", testing::make_outdoor_map(96, 40)});
  return maps;
}

class Numbers {
 public:
  explicit Numbers(uint32_t seed) : generator_(seed) {}
  float next() { return (float)(generator_() >> 8) * 0x1p-24f; }
  Vec3 next3() {
    const float x = next(), y = next(), z = next();
    return {x, y, z};
  }

 private:
  std::mt19937 generator_;
};

Vec3 texel_centre(int x, int y, int width, int height) {
  return latlong_direction(((float)x + 0.5f) / (float)width, ((float)y + 0.5f) / (float)height);
}

/// Probability that a chi^2 variable exceeds `value` (Wilson and Hilferty 1931).
double chi2_tail(double value, int degrees) {
  const double v = 2.0 / (9.0 * degrees);
  const double z = (std::cbrt(value / degrees) - (1.0 - v)) / std::sqrt(v);
  return 0.5 * std::erfc(z / std::sqrt(2.0));
}

/// pdf is constant in a texel for every sampler here, so a texel's probability is its pdf at the
/// centre times its solid angle.
TEST(Samplers, SamplesFollowThePdfAndItIntegratesToOne) {
  constexpr int kSamples = 60000;
  for (const NamedMap& map : all_maps()) {
    const int width = map.map.width, height = map.map.height;
    const std::vector<double> solid_angles = row_solid_angles(width, height);
    for (const NamedSampler& named : constant_samplers(map.map.view(), 48)) {
      SCOPED_TRACE(named.name + " on " + map.name);
      const EnvSamplerView view = named.sampler->view();
      std::vector<double> expected((size_t)width * height), drawn(expected.size());
      double integral = 0;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const double p =
              environment_pdf(view, texel_centre(x, y, width, height)) * solid_angles[y];
          integral += p;
          expected[(size_t)y * width + x] = p * kSamples;
        }
      }
      EXPECT_NEAR(integral, 1.0, 2e-5);
      Numbers numbers(1);
      for (int i = 0; i < kSamples; ++i) {
        int32_t x, y;
        latlong_texel(sample_environment(view, numbers.next3()).direction, width, height, &x, &y);
        drawn[(size_t)y * width + x] += 1;
      }
      // Cells that expect little are pooled in order, as chi^2 is no good below 5.
      double chi2 = 0, pooled_expected = 0, pooled_drawn = 0;
      int cells = 0;
      for (size_t i = 0; i < expected.size(); ++i) {
        pooled_expected += expected[i];
        pooled_drawn += drawn[i];
        if (pooled_expected < 5 && i + 1 < expected.size()) continue;
        chi2 += (pooled_drawn - pooled_expected) * (pooled_drawn - pooled_expected) /
                std::max(pooled_expected, 1.0);
        pooled_expected = pooled_drawn = 0;
        ++cells;
      }
      if (cells > 1) {
        EXPECT_GT(chi2_tail(chi2, cells - 1), 1e-5)
            << "chi2 " << chi2 << " in " << cells << " cells";
      }
    }
  }
}

/// chi^2 inside texels: 4 x 4 parts of a texel of equal solid angle, over all texels together.
TEST(Samplers, PointsAreUniformWithinATexel) {
  constexpr int kSamples = 100000, kParts = 4;
  const Map map = testing::make_outdoor_map(24, 12);
  for (const NamedSampler& named : constant_samplers(map.view(), 48)) {
    SCOPED_TRACE(named.name);
    const EnvSamplerView view = named.sampler->view();
    double counts[kParts * kParts] = {};
    Numbers numbers(2);
    for (int i = 0; i < kSamples; ++i) {
      const Vec3 d = sample_environment(view, numbers.next3()).direction;
      int32_t x, y;
      latlong_texel(d, map.width, map.height, &x, &y);
      const double fx = latlong_u(d) * map.width - x;
      const double top = std::cos(M_PI * y / map.height),
                   bottom = std::cos(M_PI * (y + 1) / map.height);
      const double fy = (top - d.z) / (top - bottom);
      const int i0 = std::clamp((int)(fx * kParts), 0, kParts - 1);
      const int i1 = std::clamp((int)(fy * kParts), 0, kParts - 1);
      counts[i1 * kParts + i0] += 1;
    }
    double chi2 = 0;
    constexpr double kExpected = (double)kSamples / (kParts * kParts);
    for (double c : counts) chi2 += (c - kExpected) * (c - kExpected) / kExpected;
    EXPECT_GT(chi2_tail(chi2, kParts * kParts - 1), 1e-5) << chi2;
  }
}

TEST(Samplers, PdfOfASampledDirectionIsThePdfThatCameWithIt) {
  const float corners[] = {0.0f, 0x1p-24f, 0.5f, kOneMinusEpsilon};
  for (const NamedMap& map : all_maps()) {
    for (const NamedSampler& named : all_samplers(map.map.view(), 400)) {
      SCOPED_TRACE(named.name + " on " + map.name);
      const EnvSamplerView view = named.sampler->view();
      Numbers numbers(3);
      int differing = 0;
      for (int i = 0; i < 20000; ++i) {
        Vec3 u = numbers.next3();
        if (i % 3 == 0) u.y = corners[i / 3 % 4];
        if (i % 4 == 0) u.z = corners[i / 4 % 4];
        if (i % 5 == 0) u.x = corners[i / 5 % 4];
        const DirectionSample s = sample_environment(view, u);
        differing += environment_pdf(view, s.direction) != s.pdf;
        ASSERT_NEAR(dot(s.direction, s.direction), 1.0f, 2e-6f);
        ASSERT_TRUE(s.pdf > 0 && std::isfinite(s.pdf));
      }
      EXPECT_EQ(differing, 0);
    }
  }
}

/// The borders of all blocks, approached as closely as sampling can, where a 16k map's texels are a
/// few float steps wide.
TEST(Samplers, BlocksOfA16kMapAreFoundAgainFromTheirBorders) {
  constexpr int kWidth = 16384, kHeight = 8;
  Map map(kWidth, kHeight, 0.1f);
  for (int i = 0; i < 200; ++i) {
    map.set((int)(testing::hash_noise(i, 1) * kWidth), i % kHeight,
            1000.0f * testing::hash_noise(i, 2));
  }
  Map tall(8, 8192, 0.1f);
  for (int i = 0; i < 200; ++i) {
    const int y = i < 50 ? i : i < 100 ? 8191 - (i - 50) : (int)(testing::hash_noise(i, 3) * 8192);
    tall.set(i % 8, y, 1e6f * testing::hash_noise(i, 4));
  }
  for (const LatLongImage& image : {map.view(), tall.view()}) {
    KdTreeConfig config;
    config.split_criterion = SplitCriterion::MIN_VARIANCE;
    const KdTreeSampler sampler(image, config);
    const KdTreeView tree = sampler.view().kdtree;
    for (int b = 0; b < sampler.block_count(); ++b) {
      for (float r : {0.0f, 0.5f, kOneMinusEpsilon}) {
        for (float s : {0.0f, 0.5f, kOneMinusEpsilon}) {
          ASSERT_EQ(locate_block(tree, direction_in_block(tree.warps[b], r, s)), b)
              << r << ' ' << s;
        }
      }
    }
  }
}

/// The renderer interpolates between texels: wherever it sees light, a sampler must be able to go,
/// with the right weight.
TEST(Samplers, EstimateOfTheInterpolatedPowerIsUnbiased) {
  constexpr int kSamples = 40000, kSteps = 16;
  for (const NamedMap& map : all_maps()) {
    const LatLongImage image = map.map.view();
    double power = 0;  // midpoint rule inside every texel
    const std::vector<double> fine = row_solid_angles(kSteps * image.width, kSteps * image.height);
    for (int y = 0; y < kSteps * image.height; ++y) {
      for (int x = 0; x < kSteps * image.width; ++x) {
        const float u = ((float)x + 0.5f) / (float)(kSteps * image.width);
        const float v = ((float)y + 0.5f) / (float)(kSteps * image.height);
        power += lookup_bilinear_uv(image, u, v).x * fine[y];
      }
    }
    for (const NamedSampler& named : all_samplers(image, 48)) {
      SCOPED_TRACE(named.name + " on " + map.name);
      // Pixel statistics know nothing of the light that interpolation spills over a lit texel's
      // border: rare samples there weigh so much that this many of them do not tell the error of
      // their mean.
      const bool of_pixels = named.name.find("pixels") != std::string::npos;
      if (of_pixels && map.name.find("lit") != std::string::npos) continue;
      if (of_pixels && map.name.find("suns") != std::string::npos) continue;
      const EnvSamplerView view = named.sampler->view();
      Numbers numbers(4);
      double sum = 0, squares = 0;
      for (int i = 0; i < kSamples; ++i) {
        const DirectionSample s = sample_environment(view, numbers.next3());
        const double weight = lookup_bilinear(image, s.direction).x / s.pdf;
        sum += weight;
        squares += weight * weight;
      }
      const double mean = sum / kSamples;
      const double deviation =
          std::sqrt(std::max(squares / kSamples - mean * mean, 0.0) / kSamples);
      EXPECT_NEAR(mean, power, 5 * deviation + 2e-3 * power);
    }
  }
}

TEST(Samplers, NoDirectionWithLightHasPdfZero) {
  for (const NamedMap& map : all_maps()) {
    for (const NamedSampler& named : all_samplers(map.map.view(), 400)) {
      SCOPED_TRACE(named.name + " on " + map.name);
      const EnvSamplerView view = named.sampler->view();
      Numbers numbers(5);
      for (int i = 0; i < 5000; ++i) {
        const Vec3 direction = sample_uniform_sphere(numbers.next3()).direction;
        if (lookup_bilinear(map.map.view(), direction).x > 0) {
          ASSERT_GT(environment_pdf(view, direction), 0.0f);
        }
      }
    }
  }
}

/// What an alias table draws each texel with, times their number.
std::vector<double> drawn_shares(const AliasView& table) {
  const size_t count = (size_t)table.width * table.height;
  std::vector<double> shares(count);
  for (size_t i = 0; i < count; ++i) {
    const AliasEntry& entry = table.entries[i];
    const float threshold = alias_threshold(entry);
    EXPECT_GE(threshold, 0.0f);
    EXPECT_LE(threshold, 1.0f);
    shares[i] += threshold;
    if (threshold < 1.0f) shares[alias_of(table, entry, (uint32_t)i)] += 1.0 - threshold;
  }
  return shares;
}

TEST(Samplers, AliasTableDrawsEveryTexelAsItsPdfSays) {
  std::vector<NamedMap> maps = all_maps();
  for (int sun : {0, 70, 159}) {  // rows: of all parts that are swept on their own one has spare
    maps.push_back({"sun in row " + std::to_string(sun), Map(40, 160, 0.5f)});
    maps.back().map.set(7, sun, 1e5f);
  }
  maps.push_back({"detail", testing::make_outdoor_map(256, 128)});
  for (float scale : {1e-37f, 1e33f}) {  // the sum of a map's weights should fit a float no more
    maps.push_back({"scaled", testing::make_outdoor_map(256, 128)});
    for (float& value : maps.back().map.texels) value *= scale;
  }
  for (const NamedMap& map : maps) {
    SCOPED_TRACE(map.name);
    const LatLongImage image = map.map.view();
    const AliasSampler sampler(image, 1), shared(image, 3);
    const AliasView table = sampler.view().alias, other = shared.view().alias;
    const std::vector<double> shares = drawn_shares(table);
    const std::vector<double> solid_angles = row_solid_angles(image.width, image.height);
    // What the rounding of all densities comes to may fall to one texel.
    const double rounding = 1e-7 * (double)shares.size();
    for (size_t i = 0; i < shares.size(); ++i) {
      const double wanted = (table.entries[i].weight * table.rows[i / image.width].pdf) *
                            solid_angles[i / image.width] * (double)shares.size();
      ASSERT_NEAR(shares[i], wanted, 1e-5 * wanted + rounding) << i;
      ASSERT_EQ(table.entries[i].weight, other.entries[i].weight) << i;
      ASSERT_EQ(table.entries[i].alias, other.entries[i].alias) << i;
    }
  }
}

TEST(Samplers, ConstantAndBlackMapsAreSampledUniformly) {
  for (float value : {0.0f, 3.0f}) {
    const Map map(40, 20, value);
    for (const NamedSampler& named : all_samplers(map.view(), 1024)) {
      SCOPED_TRACE(named.name);
      // Median cut goes on to single texels, whose unlike solid angles neither the rank model nor
      // pixel statistics know.
      const bool to_texels = named.name.find("MEDIAN_CUT") == 0;
      if (to_texels && named.name.find("FITTED") != std::string::npos) continue;
      if (to_texels && named.name.find("pixels") != std::string::npos) continue;
      const EnvSamplerView view = named.sampler->view();
      Numbers numbers(6);
      for (int i = 0; i < 2000; ++i) {
        const Vec3 direction = sample_uniform_sphere(numbers.next3()).direction;
        EXPECT_NEAR(environment_pdf(view, direction), kInvFourPi, 2e-4f * kInvFourPi);
      }
    }
  }
}

TEST(Samplers, BadValuesAreCountedAndCountAsZeroAsInRenders) {
  Map map = testing::make_outdoor_map(64, 32);
  Map clean = map;
  for (int x = 0; x < 5; ++x) {
    const size_t texel = 3 * (size_t)(700 + 7 * x);
    map.texels[texel + 1] = x == 0 ? NAN : x < 3 ? INFINITY : -2.0f;
    clean.texels[texel + 1] = 0.0f;
  }
  // A sun of a colour that the map's primaries do not reach.
  map.set(20, 8, 5000.0f);
  clean.set(20, 8, 5000.0f);
  map.texels[3 * (8 * 64 + 20) + 2] = -0.1f;
  clean.texels[3 * (8 * 64 + 20) + 2] = 0.0f;
  const auto damaged = all_samplers(map.view(), 100), mended = all_samplers(clean.view(), 100);
  for (size_t i = 0; i + 1 < damaged.size(); ++i) {  // the uniform sampler reads no map
    SCOPED_TRACE(damaged[i].name);
    EXPECT_EQ(damaged[i].sampler->bad_texels().nan, 1);
    EXPECT_EQ(damaged[i].sampler->bad_texels().infinite, 2);
    EXPECT_EQ(damaged[i].sampler->bad_texels().negative, 3);
    EXPECT_EQ(mended[i].sampler->bad_texels().total(), 0);
    Numbers numbers(7);
    for (int k = 0; k < 1000; ++k) {
      const Vec3 u = numbers.next3();
      const DirectionSample a = sample_environment(damaged[i].sampler->view(), u);
      const DirectionSample b = sample_environment(mended[i].sampler->view(), u);
      ASSERT_EQ(a.pdf, b.pdf);
      ASSERT_EQ(a.direction.x, b.direction.x);
    }
  }
}

TEST(Samplers, BothSearchesOfInversionFindTheSameTexel) {
  const Map map = testing::make_outdoor_map(300, 77);
  const InversionSampler guided(map.view(), true), binary(map.view(), false);
  Numbers numbers(8);
  for (int i = 0; i < 100000; ++i) {
    const Vec3 u = numbers.next3();
    const DirectionSample a = sample_environment(guided.view(), u),
                          b = sample_environment(binary.view(), u);
    ASSERT_EQ(a.pdf, b.pdf);
    ASSERT_EQ(a.direction.z, b.direction.z);
    ASSERT_EQ(a.direction.x, b.direction.x);
  }
}

/// The warp down the tree keeps points of a grid in the unit square apart: each block gets its
/// share to within a few points.
TEST(Samplers, WarpKeepsStratification) {
  const Map map = testing::make_outdoor_map(128, 64);
  KdTreeConfig config;
  config.block_count = 64;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  const KdTreeSampler sampler(map.view(), config);
  const KdTreeView tree = sampler.view().kdtree;
  constexpr int kSide = 256;
  std::vector<double> counts(sampler.block_count());
  for (int j = 0; j < kSide; ++j) {
    for (int i = 0; i < kSide; ++i) {
      counts[choose_block_by_warp(tree, ((float)i + 0.5f) / kSide, ((float)j + 0.5f) / kSide)] += 1;
    }
  }
  for (int b = 0; b < sampler.block_count(); ++b) {
    const double expected = sampler.probabilities()[b] * kSide * kSide;
    // A rectangle of the unit square misses or gains at most a row and a column of the grid.
    EXPECT_NEAR(counts[b], expected, 2 * kSide * std::sqrt(sampler.probabilities()[b]) * 4 + 1);
  }
}

}  // namespace
}  // namespace skytree
