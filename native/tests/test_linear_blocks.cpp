// SPDX-License-Identifier: GPL-3.0-or-later
// Blocks of linear density: sums over cells against quadrature, the inverse against its
// distribution function, samples against the pdf inside cells, the pruning against every subtree.
// Round trips, seam, poles and unbiasedness are in test_samplers.cpp, with every other sampler.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "src/kdtree_sampler.h"
#include "src/tree_pruning.h"
#include "tests/synthetic_maps.h"

namespace skytree {
namespace {

using testing::Map;

const double kGauss3[] = {0.5 - 0.3872983346207417, 0.5, 0.5 + 0.3872983346207417};
const double kWeights3[] = {5.0 / 18, 8.0 / 18, 5.0 / 18};

KdTreeConfig linear_config(int block_count) {
  KdTreeConfig config;
  config.block_count = block_count;
  config.split_criterion = SplitCriterion::MIN_VARIANCE;
  config.block_probability = BlockProbability::MIN_VARIANCE;
  config.block_density = BlockDensity::LINEAR;
  return config;
}

std::vector<Map> maps() {
  std::vector<Map> all = {testing::make_outdoor_map(40, 20), testing::make_outdoor_map(7, 5),
                          Map(3, 2), Map(1, 6), Map(24, 12)};
  all[2].set(1, 1, 5.0f);
  all[3].set(0, 4, 2.0f);
  all[4].set(0, 0, 900.0f);    // a pole
  all[4].set(23, 11, 900.0f);  // the other, and the seam
  all[4].set(12, 6, 1.0f);
  return all;
}

/// visit(u, v, weight, column, row) at 3 x 3 points of every cell; the weights are solid angles.
template <typename Visit>
void for_cell_points(const TreeGrid& grid, const Visit& visit) {
  for (int row = 0; row < grid.rows(); ++row) {
    const double from = 0.5 * grid.half_texels(row) / grid.height;
    const double to = 0.5 * grid.half_texels(row + 1) / grid.height;
    for (int column = 0; column < grid.columns(); ++column) {
      for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < 3; ++i) {
          const double v = from + (to - from) * kGauss3[j];
          double u = (column + 0.5 + kGauss3[i]) / grid.width;
          u -= std::floor(u);
          const double weight = kWeights3[i] * 2 * M_PI / grid.width * kWeights3[j] * M_PI *
                                (to - from) * std::sin(M_PI * v);
          visit(u, v, weight, column, row);
        }
      }
    }
  }
}

TEST(LinearBlocks, SumsOverCellsAreThoseOfTheInterpolatedMap) {
  for (const Map& map : maps()) {
    SCOPED_TRACE(std::to_string(map.width) + "x" + std::to_string(map.height));
    ThreadTeam team(2);
    const auto shared =
        measure_statistics(read_luminance(map.view(), team, {}), Statistics::CELLS, team, {});
    const ImageStatistics& statistics = *shared;
    const TreeGrid& grid = statistics.grid();
    std::vector<Moments> cells((size_t)grid.columns() * grid.rows());
    std::vector<double> solid_angles(cells.size());
    for_cell_points(grid, [&](double u, double v, double weight, int column, int row) {
      const double l = luminance(lookup_bilinear_uv(map.view(), (float)u, (float)v));
      const size_t i = (size_t)row * grid.columns() + column;
      cells[i] = cells[i] + Moments{weight * l, weight * l * l};
      solid_angles[i] += weight;
    });
    for (int row = 0; row < grid.rows(); ++row) {
      for (int column = 0; column < grid.columns(); ++column) {
        const TexelRect cell = {{column, row}, {column + 1, row + 1}};
        const size_t i = (size_t)row * grid.columns() + column;
        const Moments sum = statistics.sum(cell);
        EXPECT_NEAR(sum.power, cells[i].power, 2e-4 * cells[i].power + 1e-6);
        EXPECT_NEAR(sum.square, cells[i].square, 4e-4 * cells[i].square + 1e-6);
        // Three points leave 1e-4 where a cell spans a quarter turn.
        EXPECT_NEAR(statistics.solid_angle(cell), solid_angles[i], 5e-4 * solid_angles[i]);
      }
    }
  }
}

TEST(LinearBlocks, InverseIsThatOfTheDistribution) {
  for (double a : {-0.98, -0.5, -1e-4, 0.0, 1e-4, 0.7, 0.98}) {
    for (double r : {0.0, 1e-7, 0.01, 0.3, 0.9, 1.0}) {
      const double x = sample_linear((float)a, (float)r);
      EXPECT_NEAR((1 - a) * x + a * x * x, r, 3e-7) << a << ' ' << r;
      EXPECT_GE(x, 0.0);
      EXPECT_LE(x, 1.0);
    }
  }
}

/// chi^2 over quarters of cells; in each the pdf is bilinear in azimuth and elevation.
TEST(LinearBlocks, SamplesFollowThePdfInsideCells) {
  constexpr int kSamples = 200000;
  for (const Map& map : maps()) {
    for (double compensation : {0.0, 1.0}) {
      SCOPED_TRACE(std::to_string(map.width) + "x" + std::to_string(map.height));
      KdTreeConfig config = linear_config(48);
      config.compensation = compensation;
      const KdTreeSampler sampler(map.view(), config);
      const EnvSamplerView view = sampler.view();
      const TreeGrid& grid = sampler.grid();
      const int columns = 2 * grid.columns(), rows = 2 * grid.rows();
      std::vector<double> expected((size_t)columns * rows), drawn(expected.size());
      double total = 0;
      for (int y = 0; y < rows; ++y) {
        const double h0 = grid.height_at(y / 2), rise = 0.5 * (grid.height_at(y / 2 + 1) - h0);
        for (int x = 0; x < columns; ++x) {
          double mass = 0;
          for (double gy : {0.2113248654051871, 0.7886751345948129}) {
            for (double gx : {0.2113248654051871, 0.7886751345948129}) {
              const double h = h0 + rise * (y % 2 + gy);
              double u = (x + gx) / columns + 0.5 / grid.width;
              u -= std::floor(u);
              const bool south = h > 0.5;
              const Vec3 d = direction_at_height((float)u, (float)(south ? 1 - h : h), south);
              mass += environment_pdf(view, d) * M_PI * rise / columns;
            }
          }
          total += mass;
          expected[(size_t)y * columns + x] = mass * kSamples;
        }
      }
      EXPECT_NEAR(total, 1.0, 5e-5);
      std::mt19937 generator(1);
      const auto next = [&] { return (float)(generator() >> 8) * 0x1p-24f; };
      for (int i = 0; i < kSamples; ++i) {
        const float u1 = next(), u2 = next();
        const Vec3 d = sample_environment(view, {0, u1, u2}).direction;
        const int x = std::min((int)(cell_azimuth(d, 1.0f / grid.width) * columns), columns - 1);
        const double h = d.z < 0 ? 1.0 - polar_height(d) : polar_height(d);
        int row = 0;
        while (row + 1 < grid.rows() && h >= grid.height_at(row + 1)) ++row;
        const double mid = 0.5 * (grid.height_at(row) + grid.height_at(row + 1));
        drawn[(size_t)(2 * row + (h >= mid)) * columns + x] += 1;
      }
      double chi2 = 0, pooled_expected = 0, pooled_drawn = 0;
      int bins = 0;
      for (size_t i = 0; i < expected.size(); ++i) {
        pooled_expected += expected[i];
        pooled_drawn += drawn[i];
        if (pooled_expected < 10 && i + 1 < expected.size()) continue;
        chi2 += std::pow(pooled_drawn - pooled_expected, 2) / std::max(pooled_expected, 1.0);
        pooled_expected = pooled_drawn = 0;
        ++bins;
      }
      EXPECT_LT(std::abs(chi2 - (bins - 1)), 5 * std::sqrt(2.0 * bins)) << bins;
    }
  }
}

/// Second moment of L / pdf over the squared power: 1 for a pdf in proportion to L.
double excess(const Map& map, const KdTreeSampler& sampler) {
  const TreeGrid grid = {map.width, map.height, true};
  double power = 0, square = 0;
  for_cell_points(grid, [&](double u, double v, double weight, int, int) {
    const double l = luminance(lookup_bilinear_uv(map.view(), (float)u, (float)v));
    power += weight * l;
    const Vec3 d = latlong_direction((float)u, (float)v);
    square += weight * l * l / environment_pdf(sampler.view(), d);
  });
  return square / (power * power);
}

/// Around one lit texel the interpolated map is four bilinear ramps.
TEST(LinearBlocks, FourBlocksDescribeOneLitTexel) {
  Map map(32, 16);
  map.set(13, 6, 1000.0f);
  KdTreeConfig config = linear_config(64);
  const KdTreeSampler linear(map.view(), config);
  config.block_density = BlockDensity::CONSTANT;
  const KdTreeSampler constant(map.view(), config);
  EXPECT_LT(excess(map, linear), 1.05);
  EXPECT_GT(excess(map, constant), 1.3);
}

TEST(LinearBlocks, LessVarianceThanConstantOnesAndMoreBlocksLessStill) {
  const Map map = testing::make_outdoor_map(256, 128);
  double before = 1e30;
  for (int blocks : {64, 256, 1024}) {
    KdTreeConfig config = linear_config(blocks);
    const double linear = excess(map, KdTreeSampler(map.view(), config));
    config.block_density = BlockDensity::CONSTANT;
    EXPECT_LT(linear, excess(map, KdTreeSampler(map.view(), config)));
    EXPECT_LT(linear, before);
    before = linear;
  }
}

TEST(LinearBlocks, AutoTakesAsManyBlocksAsPay) {
  const Map map = testing::make_outdoor_map(256, 128);
  KdTreeConfig config = linear_config(KdTreeConfig::kAutoBlockCount);
  const KdTreeSampler automatic(map.view(), config);
  EXPECT_GT(automatic.block_count(), 16);
  EXPECT_LT(automatic.block_count(), KdTreeConfig::kLargestAutoBlockCount);
  const KdTreeSampler largest(map.view(), linear_config(KdTreeConfig::kLargestAutoBlockCount));
  EXPECT_LT(excess(map, automatic), 1.03 * excess(map, largest));
  const Map even(64, 32, 1.0f);
  EXPECT_EQ(KdTreeSampler(even.view(), config).block_count(), 1);
  config.block_density = BlockDensity::CONSTANT;
  EXPECT_EQ(KdTreeSampler(map.view(), config).block_count(), KdTreeConfig::kDefaultBlockCount);
}

TEST(LinearBlocks, CompensationTakesFromEvenLightAndLeavesTheUniformShare) {
  Map map(64, 32, 1.0f);
  map.set(20, 8, 5e3f);
  KdTreeConfig config = linear_config(64);
  const KdTreeSampler plain(map.view(), config);
  config.compensation = 1.0;
  const KdTreeSampler compensated(map.view(), config);
  const Vec3 sun = latlong_direction(20.5f / 64, 8.5f / 32), sky = {0, 0, 1};
  EXPECT_GT(environment_pdf(compensated.view(), sun), environment_pdf(plain.view(), sun));
  EXPECT_NEAR(environment_pdf(compensated.view(), sky), 0.05f * kInvFourPi, 0.002f * kInvFourPi);
  EXPECT_GT(environment_pdf(plain.view(), sky), 0.2f * kInvFourPi);
}

TEST(LinearBlocks, SettingsThatExcludeEachOtherAreNamed) {
  const Map map(8, 4, 1.0f);
  KdTreeConfig config;
  config.block_density = BlockDensity::LINEAR;  // with the paper's blocks
  EXPECT_THROW(KdTreeSampler(map.view(), config), std::invalid_argument);
  config = {};
  config.compensation = 0.5;  // with the paper's probabilities
  EXPECT_THROW(KdTreeSampler(map.view(), config), std::invalid_argument);
  config = linear_config(16);
  config.compensation = 1.5;
  EXPECT_THROW(KdTreeSampler(map.view(), config), std::invalid_argument);
}

TEST(LinearBlocks, TablesOf1024BlocksTake50KilobytesWhateverTheMap) {
  for (int width : {256, 1024}) {
    const Map map = testing::make_outdoor_map(width, width / 2);
    EXPECT_EQ(KdTreeSampler(map.view(), linear_config(1024)).nbytes(), 51188u);
  }
}

/// Least cost of every number of blocks, by trying all subtrees.
std::vector<double> least_costs(const BuildTree& tree, const std::vector<double>& costs, int node) {
  std::vector<double> least = {INFINITY, costs[node]};
  const int child = tree.nodes[node].first_child;
  if (child < 0) return least;
  const std::vector<double> first = least_costs(tree, costs, child),
                            second = least_costs(tree, costs, child + 1);
  least.resize(first.size() + second.size() - 1, INFINITY);
  for (size_t i = 1; i < first.size(); ++i) {
    for (size_t j = 1; j < second.size(); ++j) {
      least[i + j] = std::min(least[i + j], first[i] + second[j]);
    }
  }
  return least;
}

/// Lower convex hull at each index.
std::vector<double> hull(const std::vector<double>& values) {
  std::vector<double> result(values.size());
  for (size_t i = 0; i < values.size(); ++i) {
    result[i] = values[i];
    for (size_t a = 0; a < i; ++a) {
      for (size_t b = i + 1; b < values.size(); ++b) {
        const double t = (double)(i - a) / (double)(b - a);
        result[i] = std::min(result[i], values[a] + t * (values[b] - values[a]));
      }
    }
  }
  return result;
}

TEST(LinearBlocks, PruningFindsTheBestTrees) {
  for (int seed = 0; seed < 20; ++seed) {
    BuildTree tree;
    tree.nodes.resize(1);
    std::vector<double> costs = {100};
    std::mt19937 generator(seed);
    for (int splits = 0; splits < 24; ++splits) {
      int leaf;
      do leaf = (int)(generator() % tree.nodes.size());
      while (tree.nodes[leaf].first_child >= 0);
      tree.nodes[leaf].first_child = (int)tree.nodes.size();
      tree.nodes.resize(tree.nodes.size() + 2);
      for (int k = 0; k < 2; ++k) {
        // Often one split alone saves nothing.
        costs.push_back(costs[leaf] * (0.5 - (generator() % 3 ? 0.0 : 0.2)));
      }
    }
    const std::vector<int32_t> splits = best_splits(tree, costs);
    ASSERT_EQ(splits.size(), 24u);
    std::vector<double> least = least_costs(tree, costs, 0), found;
    least.erase(least.begin());
    for (size_t count = 0; count <= splits.size(); ++count) {
      std::map<int, bool> is_split;
      double sum = costs[0];
      for (size_t s = 0; s < count; ++s) {
        const int child = tree.nodes[splits[s]].first_child;
        sum += costs[child] + costs[child + 1] - costs[splits[s]];
        if (splits[s] > 0) {
          bool below = false;  // a parent comes before its children
          for (const auto& [node, made] : is_split) {
            const int first = tree.nodes[node].first_child;
            below |= splits[s] == first || splits[s] == first + 1;
          }
          EXPECT_TRUE(below);
        }
        is_split[splits[s]] = true;
      }
      found.push_back(sum);
      EXPECT_GE(sum, least[count] - 1e-9);
      EXPECT_EQ(take_splits(tree, splits, count).nodes.size(), 2 * count + 1);
    }
    const std::vector<double> best = hull(least), ours = hull(found);
    for (size_t i = 0; i < best.size(); ++i)
      EXPECT_NEAR(ours[i], best[i], 1e-9) << seed << ' ' << i;
  }
}

}  // namespace
}  // namespace skytree
