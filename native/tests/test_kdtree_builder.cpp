// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>

#include "src/kdtree_sampler.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

constexpr SplitCriterion kCriteria[] = {SplitCriterion::RANGE, SplitCriterion::VARIANCE,
                                        SplitCriterion::SSE, SplitCriterion::MIN_VARIANCE};

BuildTree build(const Map& map, int blocks, SplitCriterion criterion,
                Statistics statistics = Statistics::RADIANCE) {
  return build_kdtree(map.view(), statistics, blocks, criterion, {});
}

TEST(KdTreeBuilder, BlocksTileTheMap) {
  for (const auto& [width, height] : {std::pair(200, 100), {33, 90}, {7, 1}, {1, 5}, {3, 2}}) {
    const Map map = testing::make_outdoor_map(width, height);
    for (SplitCriterion criterion : kCriteria) {
      const BuildTree tree = build(map, 100, criterion);
      std::vector<int> covered((size_t)width * height);
      int blocks = 0;
      for (const BuildNode& node : tree.nodes) {
        if (node.first_child >= 0) continue;
        ++blocks;
        for (int y = node.rect.lo[1]; y < node.rect.hi[1]; ++y) {
          for (int x = node.rect.lo[0]; x < node.rect.hi[0]; ++x) ++covered[(size_t)y * width + x];
        }
      }
      EXPECT_EQ(blocks, tree.block_count);
      for (int c : covered) ASSERT_EQ(c, 1);
    }
  }
}

TEST(KdTreeBuilder, AsManyBlocksAsWantedOrAsThereAreTexels) {
  const Map map = testing::make_outdoor_map(200, 100);
  for (SplitCriterion criterion : kCriteria) {
    for (int blocks : {1, 2, 3, 64, 1000})
      EXPECT_EQ(build(map, blocks, criterion).block_count, blocks);
  }
  Map small(3, 2);
  for (int i = 0; i < 6; ++i) small.set(i % 3, i / 3, (float)(1 << 2 * i));
  for (SplitCriterion criterion : kCriteria)
    EXPECT_EQ(build(small, 1000, criterion).block_count, 6);
}

TEST(KdTreeBuilder, WithoutVariationThereIsOneBlock) {
  for (float value : {0.0f, 0.3f, 7.0f}) {
    for (SplitCriterion criterion : kCriteria) {
      EXPECT_EQ(build(Map(64, 32, value), 1024, criterion).block_count, 1);
    }
  }
}

TEST(KdTreeBuilder, OneLitPixelIsIsolatedAndThenSplittingStops) {
  Map map(64, 32);
  map.set(17, 9, 100.0f);
  for (SplitCriterion criterion : kCriteria) {
    const BuildTree tree = build(map, 1024, criterion, Statistics::PIXELS);
    EXPECT_EQ(tree.block_count, 5);  // four cuts free a texel from its surroundings
    bool found = false;
    for (const BuildNode& node : tree.nodes) {
      found |= node.rect.area() == 1 && node.rect.lo[0] == 17 && node.rect.lo[1] == 9;
    }
    EXPECT_TRUE(found);
  }
}

TEST(KdTreeBuilder, SplitsTheBlockWithTheLargestSquaredErrorFirst) {
  const Map map = testing::make_outdoor_map(128, 64);
  ThreadTeam team(1);
  const auto shared =
      measure_statistics(read_luminance(map.view(), team, {}), Statistics::PIXELS, team, {});
  const ImageStatistics& statistics = *shared;
  const BuildTree tree = build(map, 200, SplitCriterion::SSE, Statistics::PIXELS);
  // Replayed: at every step the split block has the largest error of those that exist.
  std::vector<int32_t> existing = {0};
  for (int32_t next = 1; next < (int32_t)tree.nodes.size(); next += 2) {
    int32_t parent = -1;
    double largest = -1, split = -1;
    for (int32_t i : existing) {
      const BuildNode& node = tree.nodes[i];
      const double error = squared_error(node.moments, statistics.solid_angle(node.rect));
      largest = std::max(largest, error);
      if (node.first_child == next) {
        parent = i;
        split = error;
      }
    }
    ASSERT_GE(parent, 0);
    EXPECT_EQ(split, largest);
    existing.erase(std::find(existing.begin(), existing.end(), parent));
    existing.push_back(next);
    existing.push_back(next + 1);
  }
}

TEST(KdTreeBuilder, SameInputSameTree) {
  const Map map = testing::make_outdoor_map(256, 128);
  for (SplitCriterion criterion : kCriteria) {
    const BuildTree a = build(map, 300, criterion), b = build(map, 300, criterion);
    ASSERT_EQ(a.nodes.size(), b.nodes.size());
    for (size_t i = 0; i < a.nodes.size(); ++i) {
      EXPECT_EQ(a.nodes[i].axis, b.nodes[i].axis);
      EXPECT_EQ(a.nodes[i].position, b.nodes[i].position);
      EXPECT_EQ(a.nodes[i].moments.power, b.nodes[i].moments.power);
    }
  }
}

TEST(KdTreeBuilder, ProgressGrowsAndCanStopTheBuild) {
  const Map map = testing::make_outdoor_map(256, 128);
  double last = 0;
  int calls = 0;
  KdTreeConfig config;
  config.progress = [&](double done) {
    EXPECT_GE(done, last);
    EXPECT_LE(done, 1.0);
    last = done;
    ++calls;
    return true;
  };
  KdTreeSampler whole(map.view(), config);
  EXPECT_GT(calls, 10);
  // Told by what is done, not by the number of calls: while the map is read, the calling thread
  // reports the pieces that fell to it, which differ from run to run.
  for (double stop_at : {0.0, 0.3, 0.8, last}) {
    int refusals = 0;
    config.progress = [&](double done) {
      refusals += done >= stop_at;
      return done < stop_at;
    };
    EXPECT_THROW(KdTreeSampler(map.view(), config), BuildCancelled) << "at " << stop_at;
    EXPECT_EQ(refusals, 1) << "at " << stop_at;
  }
}

TEST(KdTreeBuilder, SettingsOutOfRangeAreRefused) {
  const Map map(4, 2, 1.0f);
  KdTreeConfig config;
  for (int blocks : {-1, KdTreeConfig::kLargestBlockCount + 1}) {
    config.block_count = blocks;
    EXPECT_THROW(KdTreeSampler(map.view(), config), std::invalid_argument);
  }
  config.block_count = 1;
  for (double share : {0.0, -0.1, 1.1, (double)NAN}) {
    config.uniform_share = share;
    EXPECT_THROW(KdTreeSampler(map.view(), config), std::invalid_argument);
  }
}

TEST(RankFit, FindsWhatAScanFinds) {
  for (int n : {2, 5, 100, 1024}) {
    for (double decay : {0.0, 0.01, 0.3, 1.2, 3.0}) {
      std::vector<double> empirical(n);
      double total = 0;
      for (int i = 0; i < n; ++i) total += empirical[i] = std::pow(1.0 + i, -decay);
      for (double& p : empirical) p /= total;
      const RankFit fit = fit_rank_model(empirical);
      const auto rms = [&](double alpha) {
        double sum = 0;
        const std::vector<double> model = rank_probabilities(alpha, n);
        for (int i = 0; i < n; ++i) sum += (model[i] - empirical[i]) * (model[i] - empirical[i]);
        return std::sqrt(sum / n);
      };
      double best = INFINITY;
      for (double l = std::log(kSmallestAlpha); l < std::log(kLargestAlphaPerBlock * n);
           l += 0.01) {
        best = std::min(best, rms(std::exp(l)));
      }
      EXPECT_LE(fit.rms_error, best * (1 + 1e-6) + 1e-12) << n << ' ' << decay;
      EXPECT_NEAR(fit.rms_error, rms(fit.alpha), 1e-12);
      EXPECT_GE(fit.kl_divergence, -1e-12);
    }
  }
}

TEST(RankFit, RecoversTheModelItself) {
  for (double alpha : {0.05, 1.0, 40.0}) {
    const RankFit fit = fit_rank_model(rank_probabilities(alpha, 1024));
    EXPECT_NEAR(fit.alpha, alpha, 1e-4 * alpha);
    EXPECT_LT(fit.kl_divergence, 1e-9);
  }
}

TEST(RankModel, RanksAreDrawnWithTheirProbabilities) {
  for (float alpha : {1e-3f, 0.7f, 25.0f, 1e6f}) {
    const RankModel model = {alpha, (float)std::log1p(100.0 / alpha), 100};
    std::vector<double> drawn(100);
    constexpr int kSteps = 1 << 20;
    for (int i = 0; i < kSteps; ++i) drawn[sample_rank(model, (i + 0.5f) / kSteps)] += 1.0 / kSteps;
    const std::vector<double> expected = rank_probabilities(alpha, 100);
    for (int i = 0; i < 100; ++i) {
      EXPECT_NEAR(drawn[i], expected[i], 3.0 / kSteps + 1e-5 * expected[i]) << alpha << ' ' << i;
      EXPECT_NEAR(rank_probability(model, i), expected[i], 1e-5 * expected[i]);
    }
    EXPECT_LT(sample_rank(model, kOneMinusEpsilon), 100);
  }
}

TEST(KdTreeSampler, RunTimeTablesFitIn48KilobytesWhateverTheMap) {
  for (int width : {256, 2048}) {
    const Map map = testing::make_outdoor_map(width, width / 2);
    for (BlockProbability probability :
         {BlockProbability::FITTED, BlockProbability::EXACT, BlockProbability::MIN_VARIANCE}) {
      KdTreeConfig config;
      config.block_probability = probability;
      const KdTreeSampler sampler(map.view(), config);
      EXPECT_EQ(sampler.block_count(), 1024);
      EXPECT_LE(sampler.nbytes(), 48u * 1024u);
    }
  }
}

TEST(KdTreeSampler, ReconstructionKeepsBlockMeans) {
  Map map(8, 4, 1.0f);
  for (int y = 0; y < 4; ++y) {
    for (int x = 4; x < 8; ++x) map.set(x, y, 3.0f);
  }
  map.texels[0] = NAN;
  KdTreeConfig config;
  config.statistics = Statistics::PIXELS;
  const KdTreeSampler sampler(map.view(), config);
  std::vector<float> out(map.texels.size());
  sampler.reconstruct(map.view(), out.data());
  for (int y = 1; y < 4; ++y) {
    for (int x = 0; x < 8; ++x) EXPECT_FLOAT_EQ(out[3 * (8 * y + x)], x < 4 ? 1.0f : 3.0f);
  }
  for (float v : out) EXPECT_TRUE(std::isfinite(v));
  const Map other(4, 4, 1.0f);
  EXPECT_THROW(sampler.reconstruct(other.view(), out.data()), std::invalid_argument);
}

}  // namespace
}  // namespace skytree
