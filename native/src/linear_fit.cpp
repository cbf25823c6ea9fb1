// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/linear_fit.h"

#include <algorithm>
#include <climits>
#include <cmath>
#include <vector>

#include "src/clones.h"

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;
constexpr double kLargestTilt = 0.98;
constexpr double kGauss = 0.5 - 0.28867513459481287;  // two points of Gauss and Legendre on [0, 1]

/// Sums over cells of a row of centres' mean and of its integral times the column.
SKY_CLONES void sum_row(const float* __restrict centres, int count, double* mean, double* along) {
  float sums[8] = {}, moments[8] = {};
  double sum = 0, moment = 0;
  constexpr int kRun = 512;  // before float sums become coarse
  for (int run = 0; run < count; run += kRun) {
    const int n = count - run < kRun ? count - run : kRun;
    const float* c = centres + run;
    for (int lane = 0; lane < 8; ++lane) sums[lane] = moments[lane] = 0;
    int x = 0;
    for (; x + 8 <= n; x += 8) {
      for (int lane = 0; lane < 8; ++lane) {
        const float a = c[x + lane], b = c[x + lane + 1];
        const float mid = 0.5f * (a + b);
        sums[lane] += mid;
        moments[lane] += mid * ((float)(x + lane) + 0.5f) + (b - a) * (1.0f / 12.0f);
      }
    }
    for (; x < n; ++x) {
      const float mid = 0.5f * (c[x] + c[x + 1]);
      sums[0] += mid;
      moments[0] += mid * ((float)x + 0.5f) + (c[x + 1] - c[x]) * (1.0f / 12.0f);
    }
    double s = 0, m = 0;
    for (int lane = 0; lane < 8; ++lane) {
      s += sums[lane];
      m += moments[lane];
    }
    sum += s;
    moment += m + run * s;
  }
  *mean = sum;
  *along = moment;
}

/// Sums over the cells of a row at one height, two points in each.
struct SquareSums {
  double plain, weighted;  // of L^2 * scale, and of that times the factors
};

/// Adds L^2 * scale to the columns, too. At a share f between its rows of centres a row is linear
/// between interpolated centres.
SKY_CLONES SquareSums add_squares(const float* __restrict upper, const float* __restrict lower,
                                  float f, int count, float scale, const float* __restrict factors0,
                                  const float* __restrict factors1, float* __restrict columns0,
                                  float* __restrict columns1) {
  const float g0 = (float)kGauss, g1 = 1.0f - (float)kGauss;
  float sums[8] = {}, plains[8] = {};
  int x = 0;
  for (; x + 8 <= count; x += 8) {
    for (int lane = 0; lane < 8; ++lane) {
      const int i = x + lane;
      const float a = upper[i] + f * (lower[i] - upper[i]);
      const float b = upper[i + 1] + f * (lower[i + 1] - upper[i + 1]);
      const float l0 = g1 * a + g0 * b, l1 = g0 * a + g1 * b;
      const float s0 = scale * (l0 * l0), s1 = scale * (l1 * l1);
      columns0[i] += s0;
      columns1[i] += s1;
      plains[lane] += s0 + s1;
      sums[lane] += s0 * factors0[i] + s1 * factors1[i];
    }
  }
  SquareSums sum = {0, 0};
  for (; x < count; ++x) {
    const float a = upper[x] + f * (lower[x] - upper[x]);
    const float b = upper[x + 1] + f * (lower[x + 1] - upper[x + 1]);
    const float l0 = g1 * a + g0 * b, l1 = g0 * a + g1 * b;
    const float s0 = scale * (l0 * l0), s1 = scale * (l1 * l1);
    columns0[x] += s0;
    columns1[x] += s1;
    sum.plain += s0 + s1;
    sum.weighted += s0 * factors0[x] + s1 * factors1[x];
  }
  for (float s : sums) sum.weighted += s;
  for (float s : plains) sum.plain += s;
  return sum;
}

/// Weights at positions t in [0, 1]: what is to be divided by 1 + tilt (2t - 1).
struct Profile {
  std::vector<double> positions, weights;

  void clear() {
    positions.clear();
    weights.clear();
  }
  void add(double position, double weight) {
    positions.push_back(2 * position - 1);
    weights.push_back(weight);
  }
  double integral(double tilt) const {
    double sum = 0;
    for (size_t i = 0; i < weights.size(); ++i) sum += weights[i] / (1 + tilt * positions[i]);
    return sum;
  }
  /// The tilt of least integral, which is convex in it: Newton's method, kept inside.
  double best_tilt(double tilt) const {
    for (int step = 0; step < 8; ++step) {
      double slope = 0, curvature = 0;
      for (size_t i = 0; i < weights.size(); ++i) {
        const double g = 1 / (1 + tilt * positions[i]);
        const double w = weights[i] * g * g * positions[i];
        slope -= w;
        curvature += 2 * w * g * positions[i];
      }
      if (!(curvature > 0)) break;
      const double next = std::clamp(tilt - slope / curvature, -kLargestTilt, kLargestTilt);
      const double moved = std::abs(next - tilt);
      tilt = next;
      if (moved < 1e-3) break;
    }
    return tilt;
  }
};

/// Tilts need no more than some cells of a block; sums over all of them are in the statistics.
constexpr int64_t kMeasuredCells = 1024, kFittedCells = 2048;

/// visit(y) for evenly spread rows of the rectangle, with about `cells` cells together or all.
template <typename Visit>
void for_some_rows(const TexelRect& rect, int64_t cells, const Visit& visit) {
  const int stride = (int)std::clamp<int64_t>(rect.area() / cells, 1, (rect.size(1) + 7) / 8);
  for (int y = rect.lo[1] + (stride - 1) / 2; y < rect.hi[1]; y += stride) visit(y);
}

}  // namespace

TiltMoments measure_tilt(const ImageStatistics& statistics, const TexelRect& rect,
                         const Moments& exact) {
  const TreeGrid& grid = statistics.grid();
  const LuminancePlane& plane = statistics.luminance();
  const int count = rect.size(0);
  const double scale = kPiDouble / (2 * grid.height);
  double power = 0, along = 0, down = 0;
  double upper[2], lower[2];  // sums over the rows of centres above and below y
  int known = INT32_MIN;      // the last y
  for_some_rows(rect, kMeasuredCells, [&](int y) {
    if (known == y - 1) {
      std::copy(lower, lower + 2, upper);
    } else {
      sum_row(plane.row(y - 1) + rect.lo[0], count, &upper[0], &upper[1]);
    }
    sum_row(plane.row(y) + rect.lo[0], count, &lower[0], &lower[1]);
    known = y;
    const CellRow& row = statistics.cell_row(y);
    const double sum = row.upper * upper[0] + row.lower * lower[0];
    power += sum;
    along += row.upper * upper[1] + row.lower * lower[1] + rect.lo[0] * sum;
    // h at the row's own centre of light, halfway between what the map and the sphere say.
    const double from = scale * grid.half_texels(y), to = scale * grid.half_texels(y + 1);
    const double f = sum > 0 ? (row.upper * upper[0] + 2 * row.lower * lower[0]) / (3 * sum) : 0.5;
    const double sine = std::sin(0.5 * (from + f * (to - from)));
    down += sum * sine * sine;
  });
  const double share = power > 0 ? exact.power / power : 0;
  return {exact.power, exact.square, along * share, down * share};
}

Tilts tilts_of(const TreeGrid& grid, const TexelRect& rect, const TiltMoments& moments) {
  if (!(moments.power > 0)) return {};
  const double p = (moments.along / moments.power - rect.lo[0]) / rect.size(0);
  const double top = grid.height_at(rect.lo[1]);
  const double q = (moments.down / moments.power - top) / grid.rise(rect.lo[1], rect.hi[1]);
  const auto tilt = [](double mean) {
    return std::clamp(3 * (2 * mean - 1), -kLargestTilt, kLargestTilt);
  };
  return {tilt(p), tilt(q)};
}

double approximate_cost(const ImageStatistics& statistics, const TexelRect& rect,
                        const TiltMoments& moments) {
  const double solid_angle = statistics.solid_angle(rect);
  const Tilts t = tilts_of(statistics.grid(), rect, moments);
  const double flat = moments.power * moments.power / solid_angle;
  const double linear = flat * (1 + t.along * t.along / 3) * (1 + t.down * t.down / 3);
  return std::sqrt(solid_angle * (flat + std::max(moments.square - linear, 0.0)));
}

FittedTilts fit_tilts(const ImageStatistics& statistics, const TexelRect& rect,
                      const TiltMoments& moments) {
  const TreeGrid& grid = statistics.grid();
  const LuminancePlane& plane = statistics.luminance();
  const int count = rect.size(0);
  const bool southern = grid.is_southern(rect.lo[1], rect.hi[1]);
  const double rise = grid.rise(rect.lo[1], rect.hi[1]);
  const double scale = kPiDouble / (2 * grid.height);
  const double start_height =
      southern ? grid.height_from_south(rect.lo[1]) : grid.height_at(rect.lo[1]);

  std::vector<float> factors[2], columns[2];
  Profile across, down;
  Tilts tilts = tilts_of(grid, rect, moments);
  FittedTilts best;
  constexpr int kPasses = 3;
  for (int pass = 0; pass < kPasses; ++pass) {
    for (int i = 0; i < 2; ++i) {
      factors[i].resize(count);
      columns[i].assign(count, 0.0f);
      for (int x = 0; x < count; ++x) {
        const double p = (x + (i == 0 ? kGauss : 1 - kGauss)) / count;
        factors[i][x] = (float)(1 / (1 + tilts.along * (2 * p - 1)));
      }
    }
    across.clear();
    down.clear();
    double integral = 0, plain = 0;
    for_some_rows(rect, kFittedCells, [&](int y) {
      const double from = scale * grid.half_texels(y), to = scale * grid.half_texels(y + 1);
      const double cell = 0.25 * statistics.cell_row(y).solid_angle();
      for (double f : {kGauss, 1 - kGauss}) {
        const double theta = from + f * (to - from);
        const double sine = std::sin(0.5 * (southern ? kPiDouble - theta : theta));
        const double q = std::clamp(
            (southern ? start_height - sine * sine : sine * sine - start_height) / rise, 0.0, 1.0);
        const double shape = 1 + tilts.down * (2 * q - 1);
        const SquareSums row =
            add_squares(plane.row(y - 1) + rect.lo[0], plane.row(y) + rect.lo[0], (float)f, count,
                        (float)(cell / shape), factors[0].data(), factors[1].data(),
                        columns[0].data(), columns[1].data());
        plain += row.plain * shape;
        integral += row.weighted;
        down.add(q, row.weighted * shape);
      }
    });
    integral *= plain > 0 ? moments.square / plain : 0.0;
    if (pass == 0 || integral < best.integral) best = {tilts, integral};
    for (int i = 0; i < 2; ++i) {
      for (int x = 0; x < count; ++x) {
        across.add((x + (i == 0 ? kGauss : 1 - kGauss)) / count, columns[i][x]);
      }
    }
    const Tilts next = {across.best_tilt(tilts.along), down.best_tilt(tilts.down)};
    const double moved =
        std::max(std::abs(next.along - tilts.along), std::abs(next.down - tilts.down));
    if (moved < 0.02) break;
    tilts = next;
  }
  return best;
}

}  // namespace skytree
