// SPDX-License-Identifier: GPL-3.0-or-later
// The kd-tree in one to four dimensions, with and without a condition: samples follow the density
// (chi^2), it integrates to 1 for every condition, and pdf(point) is what came with the point.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "src/nd_kdtree.h"

namespace skytree {
namespace {

std::vector<double> uneven_edges(int cells) {
  std::vector<double> edges;
  for (int i = 0; i <= cells; ++i) edges.push_back(std::pow(double(i) / cells, 1.7));
  return edges;
}

/// `shape` of the cells' middles; every second axis is uneven.
template <class Shape>
NdGrid make_grid(int dimensions, int cells, Shape shape) {
  NdGrid grid;
  for (int a = 0; a < dimensions; ++a) {
    grid.edges.push_back(a % 2 ? uneven_edges(cells) : uniform_edges(cells));
  }
  size_t count = 1;
  for (int a = 0; a < dimensions; ++a) count *= size_t(cells);
  for (size_t i = 0; i < count; ++i) {
    double x[kNdMaxDimensions] = {0, 0, 0, 0};
    size_t rest = i;
    for (int a = dimensions - 1; a >= 0; --a) {
      const size_t cell = rest % size_t(cells);
      rest /= size_t(cells);
      x[a] = 0.5 * (grid.edges[size_t(a)][cell] + grid.edges[size_t(a)][cell + 1]);
    }
    grid.values.push_back(float(shape(x)));
  }
  return grid;
}

double ridge(const double* x) {  // a bump that moves with the first coordinate
  double sum = 0;
  for (int a = 1; a < kNdMaxDimensions; ++a) sum += std::pow(x[a] - 0.2 - 0.5 * x[0], 2);
  return 0.02 + std::exp(-20.0 * sum) * (1.0 + 3.0 * x[0]);
}

int cells_for(int dimensions) {
  return dimensions == 1 ? 64 : dimensions == 2 ? 32 : dimensions == 3 ? 16 : 10;
}

class Numbers {
 public:
  explicit Numbers(uint32_t seed) : generator_(seed) {}
  float next() { return float(generator_() >> 8) * 0x1p-24f; }
  NdPoint point() { return {{next(), next(), next(), next()}}; }

 private:
  std::mt19937 generator_;
};

double chi2_tail(double value, int degrees) {
  const double v = 2.0 / (9.0 * degrees);
  return 0.5 * std::erfc((std::cbrt(value / degrees) - (1.0 - v)) / std::sqrt(2.0 * v));
}

struct Case {
  int dimensions, condition;
  BlockProbability probability;
  SplitCriterion criterion;
};

class NdKdTreeTest : public testing::TestWithParam<Case> {
 protected:
  NdKdTreeConfig config() const {
    NdKdTreeConfig c;
    c.block_count = 300;
    c.slice_count = 12;
    c.block_probability = GetParam().probability;
    c.split_criterion = GetParam().criterion;
    return c;
  }
};

/// Probability of each cell of the free axes' grid (density is constant there) against what falls
/// into it.
void expect_follows(const NdGrid& grid, const NdKdTree& tree, const NdPoint& condition) {
  constexpr int kSamples = 100000;
  const NdKdTreeView view = tree.view();
  const NdSlice& slice = nd_slice(view, condition);
  const int first = tree.condition_count(), free_count = tree.free_count();
  size_t count = 1;
  for (int a = 0; a < free_count; ++a) count *= size_t(grid.size(first + a));
  std::vector<double> expected(count), drawn(count, 0.0);
  double total = 0;
  for (size_t i = 0; i < count; ++i) {
    NdPoint middle = {};
    double volume = 1;
    size_t rest = i;
    for (int a = free_count - 1; a >= 0; --a) {
      const int cells = grid.size(first + a), cell = int(rest % size_t(cells));
      rest /= size_t(cells);
      volume *= grid.width(first + a, cell);
      middle.x[a] = float(0.5 * (grid.edges[size_t(first + a)][size_t(cell)] +
                                 grid.edges[size_t(first + a)][size_t(cell) + 1]));
    }
    expected[i] = nd_pdf(view, slice, middle) * volume;
    EXPECT_GT(expected[i], 0.0);
    total += expected[i];
  }
  EXPECT_NEAR(total, 1.0, 1e-5);
  Numbers numbers(7);
  for (int k = 0; k < kSamples; ++k) {
    const NdSample sample = nd_sample(view, slice, numbers.next(), numbers.point());
    ASSERT_EQ(sample.pdf, nd_pdf(view, slice, sample.point));
    size_t index = 0;
    for (int a = 0; a < free_count; ++a) {
      const std::vector<double>& edges = grid.edges[size_t(first + a)];
      const float x = sample.point.x[a];
      ASSERT_TRUE(x >= 0.0f && x < 1.0f);
      size_t cell = 0;
      while (float(edges[cell + 1]) <= x) ++cell;
      index = index * size_t(grid.size(first + a)) + cell;
    }
    drawn[index] += 1;
  }
  double chi2 = 0, pooled_expected = 0, pooled_drawn = 0;
  int degrees = -1;
  for (size_t i = 0; i < count; ++i) {
    pooled_expected += expected[i] * kSamples;
    pooled_drawn += drawn[i];
    if (pooled_expected < 10) continue;
    chi2 += std::pow(pooled_drawn - pooled_expected, 2) / pooled_expected;
    ++degrees;
    pooled_expected = pooled_drawn = 0;
  }
  if (degrees > 0) {
    EXPECT_GT(chi2_tail(chi2, degrees), 1e-5) << chi2 << " of " << degrees;
  }
}

TEST_P(NdKdTreeTest, SamplesFollowTheDensityForEveryCondition) {
  const Case c = GetParam();
  const NdGrid grid = make_grid(c.dimensions, cells_for(c.dimensions), ridge);
  const NdKdTree tree(grid, c.condition, config());
  EXPECT_GT(tree.block_count(), c.dimensions == 1 ? 20 : 100);
  for (const float at : {0.03f, 0.55f, 1.0f}) expect_follows(grid, tree, {{at, at, at, at}});
}

TEST_P(NdKdTreeTest, ConstantFunctionStaysOneBlockAndUniform) {
  const Case c = GetParam();
  const NdGrid grid = make_grid(c.dimensions, 8, [](const double*) { return 3.0; });
  const NdKdTree tree(grid, c.condition, config());
  EXPECT_EQ(tree.block_count(), 1);
  EXPECT_EQ(tree.slice_count(), 1);
  const NdPoint middle = {{0.4f, 0.4f, 0.4f, 0.4f}};
  EXPECT_FLOAT_EQ(nd_pdf(tree.view(), nd_slice(tree.view(), middle), middle), 1.0f);
}

TEST_P(NdKdTreeTest, BlackFunctionIsUniform) {
  const Case c = GetParam();
  const NdGrid grid = make_grid(c.dimensions, 4, [](const double*) { return 0.0; });
  const NdKdTree tree(grid, c.condition, config());
  expect_follows(grid, tree, {{0.5f, 0.5f, 0.5f, 0.5f}});
}

TEST_P(NdKdTreeTest, OneLitCellIsFound) {
  const Case c = GetParam();
  NdGrid grid = make_grid(c.dimensions, 8, [](const double*) { return 0.0; });
  size_t lit = 0;
  for (int a = 0; a < c.dimensions; ++a) lit = lit * 8 + 5;
  grid.values[lit] = 1.0f;
  const NdKdTree tree(grid, c.condition, config());
  const auto middle = [&](int axis) {
    return float(0.5 * (grid.edges[size_t(axis)][5] + grid.edges[size_t(axis)][6]));
  };
  NdPoint condition = {}, point = {};
  double volume = 1;
  for (int a = 0; a < c.condition; ++a) condition.x[a] = middle(a);
  for (int a = c.condition; a < c.dimensions; ++a) {
    point.x[a - c.condition] = middle(a);
    volume *= grid.width(a, 5);
  }
  expect_follows(grid, tree, condition);
  if (c.probability == BlockProbability::FITTED)
    return;  // a rank model cannot put all on one block
  EXPECT_NEAR(nd_pdf(tree.view(), nd_slice(tree.view(), condition), point) * volume, 0.95, 0.02);
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const auto& [dimensions, condition] :
       {std::pair{1, 0}, {2, 0}, {2, 1}, {3, 0}, {3, 1}, {4, 0}, {4, 2}, {4, 3}}) {
    all.push_back({dimensions, condition, BlockProbability::EXACT, SplitCriterion::SSE});
    all.push_back({dimensions, condition, BlockProbability::FITTED, SplitCriterion::VARIANCE});
    all.push_back(
        {dimensions, condition, BlockProbability::MIN_VARIANCE, SplitCriterion::MIN_VARIANCE});
  }
  return all;
}

std::string case_name(const testing::TestParamInfo<Case>& info) {
  const char* names[] = {"fitted", "exact", "min_variance"};
  return std::to_string(info.param.dimensions) + "D_given_" + std::to_string(info.param.condition) +
         "_" + names[int(info.param.probability)];
}

INSTANTIATE_TEST_SUITE_P(All, NdKdTreeTest, testing::ValuesIn(cases()), case_name);

TEST(NdKdTree, TwoDimensionsWithoutConditionFollowTheWarpOfStratifiedNumbers) {
  // One number in each of 32 x 32 strata: every block gets its share to within its border's strata.
  const NdGrid grid = make_grid(2, 32, ridge);
  NdKdTreeConfig config;
  config.block_count = 16;
  const NdKdTree tree(grid, 0, config);
  const NdKdTreeView view = tree.view();
  const NdSlice& slice = nd_slice(view, {});
  double mean = 0;  // of f/p, whose expectation is the integral
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) {
      const NdSample s =
          nd_sample(view, slice, {{(float(x) + 0.5f) / 32, (float(y) + 0.5f) / 32, 0, 0}});
      const double at[4] = {s.point.x[0], s.point.x[1], 0, 0};
      mean += ridge(at) / s.pdf / 1024;
    }
  }
  double integral = 0;
  for (int y = 0; y < 400; ++y) {
    for (int x = 0; x < 400; ++x) {
      const double at[4] = {(x + 0.5) / 400, (y + 0.5) / 400, 0, 0};
      integral += ridge(at) / 160000;
    }
  }
  EXPECT_NEAR(mean / integral, 1.0, 0.01);
}

TEST(NdKdTree, RanksServeWithOneNumberLess) {
  const NdGrid grid = make_grid(2, 32, ridge);
  NdKdTreeConfig config;
  config.block_probability = BlockProbability::FITTED;
  config.block_count = 64;
  const NdKdTree tree(grid, 0, config);
  const NdKdTreeView view = tree.view();
  const NdSlice& slice = nd_slice(view, {});
  std::vector<double> quarter(4, 0.0), expected(4, 0.0);
  Numbers numbers(3);
  for (int i = 0; i < 40000; ++i) {
    const NdSample s = nd_sample(view, slice, numbers.point());
    ASSERT_EQ(s.pdf, nd_pdf(view, slice, s.point));
    quarter[size_t(2 * (s.point.x[0] >= 0.5f) + (s.point.x[1] >= 0.5f))] += 1.0 / 40000;
  }
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 200; ++x) {
      const NdPoint p = {{(float(x) + 0.5f) / 200, (float(y) + 0.5f) / 200, 0, 0}};
      expected[size_t(2 * (x >= 100) + (y >= 100))] += nd_pdf(view, slice, p) / 40000;
    }
  }
  for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(quarter[i], expected[i], 0.01);
}

TEST(NdKdTree, SplitsWhereTheFunctionChangesWithTheCondition) {
  // Constant below 0.5 of the condition, a bump above: the only plane worth having is there.
  const NdGrid grid = make_grid(3, 16, [](const double* x) {
    return x[0] < 0.5 ? 1.0 : std::exp(-30.0 * (std::pow(x[1] - 0.3, 2) + std::pow(x[2] - 0.6, 2)));
  });
  NdKdTreeConfig config;
  config.slice_count = 2;
  const NdKdTree tree(grid, 1, config);
  ASSERT_EQ(tree.slice_count(), 2);
  EXPECT_EQ(tree.view().nodes[0].split, 0.5f);
}

TEST(NdKdTree, RefusesWhatIsNoDensity) {
  NdGrid grid = make_grid(2, 4, [](const double*) { return 1.0; });
  EXPECT_THROW(NdKdTree(grid, 2), std::invalid_argument);
  NdKdTreeConfig config;
  config.split_criterion = SplitCriterion::RANGE;
  EXPECT_THROW(NdKdTree(grid, 0, config), std::invalid_argument);
  grid.values[3] = -1.0f;
  EXPECT_THROW(NdKdTree(grid, 0), std::invalid_argument);
  grid.values[3] = NAN;
  EXPECT_THROW(NdKdTree(grid, 0), std::invalid_argument);
  grid.values.pop_back();
  EXPECT_THROW(NdKdTree(grid, 0), std::invalid_argument);
}

}  // namespace
}  // namespace skytree
