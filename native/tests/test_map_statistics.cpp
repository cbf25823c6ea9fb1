// SPDX-License-Identifier: GPL-3.0-or-later
// Neither threads nor what an earlier build left behind change a bit of a table.
#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <thread>

#include "src/alias_sampler.h"
#include "src/hierarchy_sampler.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"
#include "src/map_statistics.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

constexpr int kThreads = 3;

std::vector<Map> maps() {
  std::vector<Map> all = {testing::make_outdoor_map(300, 150), Map(130, 70), Map(37, 3), Map(1, 1)};
  for (int y = 0; y < 70; ++y) {
    for (int x = 0; x < 130; ++x) all[1].set(x, y, testing::hash_noise(x, y));
  }
  all[1].set(5, 63, NAN);  // where a thread's rows end
  all[1].set(5, 64, -1.0f);
  all[1].set(6, 64, INFINITY);
  all[2].set(20, 1, 7.0f);
  return all;
}

struct Case {
  SplitCriterion criterion;
  BlockProbability probability;
  Statistics statistics;
};
constexpr Case kCases[] = {
    {SplitCriterion::MIN_VARIANCE, BlockProbability::MIN_VARIANCE, Statistics::RADIANCE},
    {SplitCriterion::MIN_VARIANCE, BlockProbability::EXACT, Statistics::RADIANCE},
    {SplitCriterion::SSE, BlockProbability::FITTED, Statistics::PIXELS},
    {SplitCriterion::VARIANCE, BlockProbability::EXACT, Statistics::RADIANCE},
    {SplitCriterion::RANGE, BlockProbability::FITTED, Statistics::RADIANCE},
    {SplitCriterion::MEDIAN_CUT, BlockProbability::EXACT, Statistics::RADIANCE}};

KdTreeConfig config_of(const Case& c, int block_count, int threads) {
  KdTreeConfig config;
  config.split_criterion = c.criterion;
  config.block_probability = c.probability;
  config.statistics = c.statistics;
  config.block_count = block_count;
  config.threads = threads;
  return config;
}

template <typename T>
void expect_same(const std::vector<T>& a, const std::vector<T>& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.empty() ? 0 : std::memcmp(a.data(), b.data(), a.size() * sizeof(T)), 0);
}

void expect_same(const KdTreeSampler& a, const KdTreeSampler& b) {
  expect_same(a.rects(), b.rects());
  expect_same(a.probabilities(), b.probabilities());
  expect_same(a.empirical(), b.empirical());
  expect_same(a.tilts(), b.tilts());
  EXPECT_EQ(a.fit().alpha, b.fit().alpha);
  EXPECT_EQ(a.bad_texels().total(), b.bad_texels().total());
}

TEST(MapStatistics, TreesOfSharedStatisticsAreThoseOfTheImage) {
  for (const Map& map : maps()) {
    MapStatistics shared(map.view());
    // Up and down, so that trees are taken from larger ones and grow further.
    for (int block_count : {60, 7, 400, KdTreeConfig::kAutoBlockCount, 61, 1}) {
      for (const Case& c : kCases) {
        SCOPED_TRACE(std::to_string(map.width) + " wide, " + std::to_string(block_count) +
                     " blocks, criterion " + std::to_string((int)c.criterion));
        const KdTreeSampler alone(map.view(), config_of(c, block_count, 1));
        expect_same(alone, KdTreeSampler(map.view(), config_of(c, block_count, kThreads)));
        expect_same(alone, KdTreeSampler(shared, config_of(c, block_count, kThreads)));
      }
    }
  }
}

TEST(MapStatistics, KeepsWhatItSaysItKeeps) {
  const Map map = testing::make_outdoor_map(1024, 512);
  MapStatistics shared(map.view());
  EXPECT_EQ(shared.nbytes(), 0u);
  const size_t texels = (size_t)map.width * map.height;
  size_t before = 0;
  for (const Case& c : {kCases[0], kCases[1], kCases[2]}) {
    KdTreeSampler(shared, config_of(c, 100, kThreads));
    // Luminance and one, two, three kinds of statistics.
    EXPECT_GT(shared.nbytes(), before + 2 * texels);
    EXPECT_LT(shared.nbytes(), (before ? before : 4 * texels) + 4 * texels);
    before = shared.nbytes();
  }
  KdTreeSampler(shared, config_of(kCases[0], 50, kThreads));
  EXPECT_EQ(shared.nbytes(), before);
}

TEST(MapStatistics, AStoppedBuildCanBeAskedForAgain) {
  const Map map = testing::make_outdoor_map(300, 150);
  const KdTreeConfig wanted = config_of(kCases[0], 700, kThreads);
  const KdTreeSampler alone(map.view(), wanted);
  MapStatistics shared(map.view());
  int stopped = 0;
  for (double limit : {0.01, 0.4, 0.75, 0.9}) {
    KdTreeConfig config = wanted;
    config.progress = [&](double done) { return done < limit; };
    try {
      KdTreeSampler(shared, config);
    } catch (const BuildCancelled&) {
      ++stopped;
    }
  }
  EXPECT_EQ(stopped, 4);
  expect_same(alone, KdTreeSampler(shared, wanted));
}

TEST(MapStatistics, ServesThreadsAtATime) {
  const Map map = testing::make_outdoor_map(300, 150);
  MapStatistics shared(map.view());
  std::vector<std::unique_ptr<KdTreeSampler>> built(4);
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&, i] {
      built[i] = std::make_unique<KdTreeSampler>(shared, config_of(kCases[i % 2], 100 + i, 2));
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (int i = 0; i < 4; ++i) {
    expect_same(KdTreeSampler(map.view(), config_of(kCases[i % 2], 100 + i, 1)), *built[i]);
  }
}

TEST(MapStatistics, ThreadsDoNotChangeTexelTables) {
  for (const Map& map : maps()) {
    SCOPED_TRACE(std::to_string(map.width) + " wide");
    const size_t texels = (size_t)map.width * map.height;
    const AliasSampler alias1(map.view(), 1), alias3(map.view(), kThreads);
    EXPECT_EQ(std::memcmp(alias1.view().alias.entries, alias3.view().alias.entries,
                          texels * sizeof(AliasEntry)),
              0);
    MapStatistics statistics(map.view());
    const AliasSampler shared(statistics);
    EXPECT_EQ(std::memcmp(alias1.view().alias.entries, shared.view().alias.entries,
                          texels * sizeof(AliasEntry)),
              0);
    const InversionSampler inversion1(map.view(), true, 1), inversion3(map.view(), true, kThreads);
    const InversionView a = inversion1.view().inversion, b = inversion3.view().inversion;
    EXPECT_EQ(std::memcmp(a.marginal, b.marginal, (map.height + 1) * sizeof(float)), 0);
    EXPECT_EQ(std::memcmp(a.conditional, b.conditional, (texels + map.height) * sizeof(float)), 0);
    EXPECT_EQ(std::memcmp(a.conditional_guide, b.conditional_guide, texels * sizeof(uint16_t)), 0);
    const HierarchySampler hierarchy1(map.view(), 1), hierarchy3(map.view(), kThreads);
    EXPECT_EQ(std::memcmp(hierarchy1.view().hierarchy.weights, hierarchy3.view().hierarchy.weights,
                          hierarchy1.nbytes() - map.height * sizeof(RowWarp)),
              0);
    const BadTexels bad = count_bad_texels(map.view());
    for (const EnvironmentSampler* sampler :
         {(const EnvironmentSampler*)&alias3, (const EnvironmentSampler*)&shared,
          (const EnvironmentSampler*)&inversion3, (const EnvironmentSampler*)&hierarchy3}) {
      EXPECT_EQ(sampler->bad_texels().message(), bad.message());
    }
  }
}

TEST(ThreadTeam, DoesEveryPieceOnce) {
  ThreadTeam team(kThreads);
  EXPECT_EQ(team.size(), kThreads);
  for (int count : {0, 1, 2, 1000}) {
    std::vector<std::atomic<int>> done(count);
    for (int repeat = 0; repeat < 50; ++repeat) {
      team.run(count, [&](int worker, int piece) {
        EXPECT_LT(worker, team.size());
        ++done[piece];
      });
    }
    for (const auto& times : done) EXPECT_EQ(times, 50);
  }
  int items = 0;
  ThreadTeam(1).run_chunks(10, 4, [&](int, int first, int last) { items += 100 + last - first; });
  EXPECT_EQ(items, 310);
}

TEST(ThreadTeam, ThrowsWhatAPieceThrowsAndGoesOnWorking) {
  ThreadTeam team(kThreads);
  const auto fail = [](int, int piece) {
    if (piece == 40) throw std::runtime_error("piece 40");
  };
  EXPECT_THROW(team.run(100, fail), std::runtime_error);
  std::atomic<int> done{0};
  team.run(100, [&](int, int) { ++done; });
  EXPECT_EQ(done, 100);
  EXPECT_THROW(ThreadTeam(-1), std::invalid_argument);
}

}  // namespace
}  // namespace skytree
