// SPDX-License-Identifier: GPL-3.0-or-later
// Sampling the map times a lobe by a cut of the tree: the density is a density, samples follow it,
// pdf(direction) is what came with the sample, estimates are unbiased and vary less.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "kernel/guided_light.h"
#include "src/kdtree_sampler.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

KdTreeConfig config_of(int blocks, double compensation = 0.0) {
  KdTreeConfig config;
  config.block_count = blocks;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  config.block_density = BlockDensity::LINEAR;
  config.compensation = compensation;
  return config;
}

/// A lobe of a surface that faces (0.3, -0.2, 0.93), about.
Lobe make_lobe(LobeType type, float alpha_x, float alpha_y) {
  Lobe lobe = {};
  lobe.type = type;
  lobe.weight = {1, 1, 1};
  lobe.normal = normalize({0.3f, -0.2f, 0.93f});
  orthonormal_basis(lobe.normal, &lobe.tangent, &lobe.bitangent);
  lobe.alpha_x = alpha_x;
  lobe.alpha_y = alpha_y;
  return lobe;
}

const Vec3 kView = normalize({-0.5f, 0.4f, 0.6f});

/// The mixture for one lobe, and half a diffuse one with it if asked for.
ProductMix mix_of(const KdTreeSampler& sampler, Lobe lobe, bool diffuse) {
  Shading shading = {};
  shading.count = diffuse ? 2 : 1;
  lobe.select = diffuse ? 0.5f : 1.0f;
  shading.lobes[0] = lobe;
  shading.lobes[1] = make_lobe(LobeType::kDiffuse, 0, 0);
  shading.lobes[1].select = 0.5f;
  return mix_products(sampler.product_view().kdtree.products, identity3(), shading, kView);
}

struct NamedLobe {
  const char* name;
  Lobe lobe;
  bool diffuse;
};

std::vector<NamedLobe> lobes() {
  return {{"GGX 0.2", make_lobe(LobeType::kGlossy, 0.04f, 0.04f), false},
          {"GGX 0.5", make_lobe(LobeType::kGlossy, 0.25f, 0.25f), false},
          {"anisotropic GGX", make_lobe(LobeType::kGlossy, 0.05f, 0.4f), false},
          {"Ward", make_lobe(LobeType::kWard, 0.1f, 0.3f), false},
          {"anisotropic GGX and diffuse", make_lobe(LobeType::kGlossy, 0.4f, 0.05f), true}};
}

DirectionSample draw(const EnvSamplerView& view, const ProductMix& mix, Vec2 u) {
  return sample_guided(view, {}, kNoGuideSlot, mix, {0.5f, u.x, u.y}).light;
}

TEST(ProductCut, CutsAreThoseOfTheTree) {
  for (int blocks : {1, 2, 50, 128, 1024}) {
    const Map map = testing::make_outdoor_map(128, 64);
    const KdTreeSampler sampler(map.view(), config_of(blocks));
    const CutView cut = sampler.cut();
    EXPECT_EQ(cut.count, std::min(blocks, kLargestCut));
    std::vector<double> below(cut.count);
    double solid_angle = 0;
    for (int b = 0; b < sampler.block_count(); ++b) {
      ASSERT_LT(cut.node_of_block[b], cut.count);
      below[cut.node_of_block[b]] += sampler.probabilities()[b];
    }
    for (int i = 0; i < cut.count; ++i) {
      const CutNode& node = cut.nodes[i];
      EXPECT_NEAR(below[i], node.probability, 1e-6);
      EXPECT_NEAR(node.warp_extent.x * node.warp_extent.y, node.probability, 1e-6);
      EXPECT_NEAR(length(node.direction), 1.0f, 1e-5);
      EXPECT_GE(node.spread, 0.0f);
      solid_angle += node.solid_angle;
    }
    EXPECT_NEAR(solid_angle, 4 * M_PI, 1e-5);
  }
}

TEST(ProductCut, SamplesFollowTheDensityAndFindItAgain) {
  constexpr int kSamples = 100000;
  const Map map = testing::make_outdoor_map(96, 48);
  for (int blocks : {1, 3, 400}) {
    const KdTreeSampler sampler(map.view(), config_of(blocks, blocks == 400 ? 1.0 : 0.0));
    const EnvSamplerView view = sampler.product_view();
    const KdTreeView& tree = view.kdtree;
    for (const NamedLobe& named : lobes()) {
      SCOPED_TRACE(named.name);
      const ProductMix mix = mix_of(sampler, named.lobe, named.diffuse);
      ASSERT_GT(mix.count, 0);
      std::vector<double> expected(sampler.block_count()), drawn(expected.size());
      double total = 0;
      for (int b = 0; b < sampler.block_count(); ++b) {
        const double p = sampler.probabilities()[b] *
                         product_ratio(tree.products, mix, sampler.cut().node_of_block[b]);
        total += p;
        expected[b] = p * kSamples;
      }
      EXPECT_NEAR(total, 1.0, 1e-5);
      std::mt19937 generator(1);
      const float corners[] = {0.0f, 0.5f, kOneMinusEpsilon};
      int differing = 0;
      for (int i = 0; i < kSamples; ++i) {
        Vec2 u = {(float)(generator() >> 8) * 0x1p-24f, (float)(generator() >> 8) * 0x1p-24f};
        const bool corner = i % 50 == 0;
        if (corner) u = {corners[i / 50 % 3], corners[i / 150 % 3]};
        const DirectionSample s = draw(view, mix, u);
        differing += guided_pdf(view, {}, kNoGuideSlot, mix, s.direction) != s.pdf;
        ASSERT_TRUE(s.pdf > 0 && std::isfinite(s.pdf));
        const float azimuth = cell_azimuth(s.direction, tree.cell_width);
        if (!corner) drawn[locate_block(tree, azimuth, s.direction)] += 50.0 / 49.0;
      }
      EXPECT_EQ(differing, 0);
      double chi2 = 0, pooled_expected = 0, pooled_drawn = 0;
      int bins = 0;
      for (size_t b = 0; b < expected.size(); ++b) {
        pooled_expected += expected[b];
        pooled_drawn += drawn[b];
        if (pooled_expected < 10 && b + 1 < expected.size()) continue;
        chi2 += std::pow(pooled_drawn - pooled_expected, 2) / std::max(pooled_expected, 1.0);
        pooled_expected = pooled_drawn = 0;
        ++bins;
      }
      EXPECT_LT(chi2, bins + 6 * std::sqrt(2.0 * bins)) << bins;
    }
  }
}

/// Mean and variance of L f / pdf.
template <typename Sample>
std::pair<double, double> estimate(const Map& map, const Lobe& lobe, int count,
                                   const Sample& sample) {
  std::mt19937 generator(2);
  double sum = 0, squares = 0;
  for (int i = 0; i < count; ++i) {
    const float x = (float)(generator() >> 8) * 0x1p-24f, y = (float)(generator() >> 8) * 0x1p-24f;
    const DirectionSample s = sample(Vec2{x, y});
    const double value = luminance(lookup_bilinear(map.view(), s.direction)) *
                         luminance(eval_lobe(lobe, kView, s.direction).f) / s.pdf;
    sum += value;
    squares += value * value;
  }
  const double mean = sum / count;
  return {mean, squares / count - mean * mean};
}

TEST(ProductCut, EveryCellHoldsItsAxis) {
  double spread = 0;
  for (int32_t cell = 0; cell < kLobeAxes; ++cell) {
    const Vec3 axis = lobe_axis(cell);
    EXPECT_NEAR(length(axis), 1.0f, 1e-6f);
    EXPECT_EQ(lobe_cell(axis), cell);
  }
  std::mt19937 generator(3);
  for (int i = 0; i < 10000; ++i) {
    const float x = (float)(generator() >> 8) * 0x1p-24f, y = (float)(generator() >> 8) * 0x1p-24f;
    const Vec3 direction = direction_at_height(x, y, false);
    const float angle = std::acos(clampf(dot(direction, lobe_axis(lobe_cell(direction))), -1, 1));
    EXPECT_LT(angle, 0.13f);
    spread += angle * angle / 10000;
  }
  EXPECT_NEAR(spread, 4 * M_PI / kLobeAxes / 6, 1e-3);  // what the table widens lobes by
}

TEST(ProductCut, OnlyDirectedSurfacesMix) {
  const Map map = testing::make_outdoor_map(96, 48);
  const KdTreeSampler sampler(map.view(), config_of(400));
  EXPECT_EQ(mix_of(sampler, make_lobe(LobeType::kDiffuse, 0, 0), false).count, 0);
  EXPECT_EQ(mix_of(sampler, make_lobe(LobeType::kTabulated, 1, 1), true).count, 0);
  EXPECT_EQ(mix_of(sampler, make_lobe(LobeType::kGlossy, 1e-4f, 1e-4f), true).count, 0);
  EXPECT_EQ(mix_of(sampler, make_lobe(LobeType::kMetal, 0.2f, 0.2f), false).count, 1);
  EXPECT_EQ(mix_of(sampler, make_lobe(LobeType::kGlossy, 0.1f, 0.4f), true).count, 4);
}

TEST(ProductCut, NarrowLobesAreDirectedOnlyToWhatIsBrighterThanTheRest) {
  const Lobe lobe = make_lobe(LobeType::kGlossy, 0.01f, 0.01f);
  const Vec3 mirrored = lobe.normal * (2.0f * dot(lobe.normal, kView)) - kView;
  const auto largest_ratio = [&](Vec3 sun) {
    Map map(256, 128);
    for (int y = 0; y < 128; ++y) {
      // Hardly uneven, for a tree of small nodes.
      for (int x = 0; x < 256; ++x) map.set(x, y, (x / 16 + y / 16) % 2 ? 1.0f : 1.02f);
    }
    const Vec2 uv = latlong_uv(sun);
    map.set((int)(uv.x * 256), (int)(uv.y * 128), 200.0f);
    const KdTreeSampler sampler(map.view(), config_of(1024));
    const ProductView products = sampler.product_view().kdtree.products;
    const ProductMix mix = mix_of(sampler, lobe, false);
    EXPECT_EQ(mix.count, 1);
    float largest = 0;
    for (int i = 0; i < sampler.cut().count; ++i) {
      largest = std::max(largest, product_ratio(products, mix, i));
    }
    return largest;
  };
  EXPECT_LT(largest_ratio(-mirrored), 1.5f);  // what it reflects is even: BSDF samples are enough
  EXPECT_GT(largest_ratio(mirrored), 50.0f);
}

TEST(ProductCut, EstimatesAreUnbiasedAndVaryLess) {
  constexpr int kSamples = 150000;
  const Map map = testing::make_outdoor_map(256, 128);
  const KdTreeSampler sampler(map.view(), config_of(1024));
  const EnvSamplerView view = sampler.product_view();
  for (const NamedLobe& named : lobes()) {
    SCOPED_TRACE(named.name);
    if (named.diffuse) continue;
    const ProductMix mix = mix_of(sampler, named.lobe, false);
    const auto [plain, plain_variance] = estimate(map, named.lobe, kSamples, [&](Vec2 u) {
      return sample_environment(view, {0, u.x, u.y});
    });
    const auto [directed, directed_variance] =
        estimate(map, named.lobe, kSamples, [&](Vec2 u) { return draw(view, mix, u); });
    EXPECT_NEAR(directed, plain, 4 * std::sqrt((plain_variance + directed_variance) / kSamples));
    EXPECT_LT(directed_variance, 0.8 * plain_variance);
    std::printf("%s: variance %.3f of the tree's alone\n", named.name,
                directed_variance / plain_variance);
  }
}

}  // namespace
}  // namespace skytree
