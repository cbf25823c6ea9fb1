// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/linear_fit.h"

#include <algorithm>
#include <climits>
#include <cmath>
#include <cstring>
#include <vector>

#include "src/clones.h"

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;
constexpr double kLargestTilt = 0.98;
constexpr double kGauss = 0.5 - 0.28867513459481287;  // two points of Gauss and Legendre on [0, 1]

/// As the compiler makes nothing of loops over eight lanes with a condition inside.
typedef float Lanes __attribute__((vector_size(8 * sizeof(float))));
typedef int32_t LaneMask __attribute__((vector_size(8 * sizeof(int32_t))));

double sum_of(const float* lanes) {
  const double low = ((double)lanes[0] + lanes[1]) + ((double)lanes[2] + lanes[3]);
  const double high = ((double)lanes[4] + lanes[5]) + ((double)lanes[6] + lanes[7]);
  return low + high;
}

/// Sums over cells of a row of centres' mean and of its integral times the column. Whole vectors
/// are read: the luminance has as much slack at the end of its rows.
SKY_CLONES void sum_row(const float* __restrict centres, int count, double* mean, double* along) {
  static_assert(LuminancePlane::kSlack >= 8);
  const LaneMask lane = {0, 1, 2, 3, 4, 5, 6, 7};
  const Lanes first_column = {0.5f, 1.5f, 2.5f, 3.5f, 4.5f, 5.5f, 6.5f, 7.5f};
  double sum = 0, moment = 0;
  constexpr int kRun = 512;  // before float sums become coarse
  for (int run = 0; run < count; run += kRun) {
    const int n = count - run < kRun ? count - run : kRun;
    const float* c = centres + run;
    Lanes sums = {}, moments = {};
    for (int x = 0; x < n; x += 8) {
      Lanes a, b;
      std::memcpy(&a, c + x, sizeof a);
      std::memcpy(&b, c + x + 1, sizeof b);
      const Lanes mid = 0.5f * (a + b);
      const Lanes moment_of = mid * (first_column + (float)x) + (b - a) * (1.0f / 12.0f);
      const LaneMask inside = lane < n - x;
      sums += inside ? mid : Lanes{};
      moments += inside ? moment_of : Lanes{};
    }
    float lanes[8];
    std::memcpy(lanes, &sums, sizeof lanes);
    const double s = sum_of(lanes);
    sum += s;
    std::memcpy(lanes, &moments, sizeof lanes);
    moment += sum_of(lanes) + run * s;
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

/// First and second derivative by the tilt of the sum of weights / (1 + tilt * positions).
struct Slopes {
  double first, second;
};

SKY_CLONES Slopes slopes_at(double tilt, const double* __restrict positions,
                            const double* __restrict weights, int count) {
  double first[4] = {}, second[4] = {};
  int i = 0;
  for (; i + 4 <= count; i += 4) {
    for (int lane = 0; lane < 4; ++lane) {
      const double x = positions[i + lane], g = 1 / (1 + tilt * x);
      const double w = weights[i + lane] * g * g * x;
      first[lane] -= w;
      second[lane] += 2 * w * g * x;
    }
  }
  for (; i < count; ++i) {
    const double x = positions[i], g = 1 / (1 + tilt * x);
    const double w = weights[i] * g * g * x;
    first[0] -= w;
    second[0] += 2 * w * g * x;
  }
  return {(first[0] + first[1]) + (first[2] + first[3]),
          (second[0] + second[1]) + (second[2] + second[3])};
}

/// Weights at positions from -1 to 1: what is to be divided by 1 + tilt * position.
struct Profile {
  std::vector<double> positions, weights;

  /// The tilt of least integral, which is convex in it: Newton's method, kept inside.
  double best_tilt(double tilt) const {
    for (int step = 0; step < 8; ++step) {
      const Slopes slopes = slopes_at(tilt, positions.data(), weights.data(), (int)weights.size());
      if (!(slopes.second > 0)) break;
      const double next =
          std::clamp(tilt - slopes.first / slopes.second, -kLargestTilt, kLargestTilt);
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

  struct Line {  // where the map is looked at: at a share f between a row of centres and the next
    int y;
    float f;
    double solid_angle;  // of half a cell's width
  };
  std::vector<Line> lines;
  Profile across, down;
  for_some_rows(rect, kFittedCells, [&](int y) {
    const double from = scale * grid.half_texels(y), to = scale * grid.half_texels(y + 1);
    for (double f : {kGauss, 1 - kGauss}) {
      const double theta = from + f * (to - from);
      const double sine = std::sin(0.5 * (southern ? kPiDouble - theta : theta));
      const double q = std::clamp(
          (southern ? start_height - sine * sine : sine * sine - start_height) / rise, 0.0, 1.0);
      lines.push_back({y, (float)f, 0.25 * statistics.cell_row(y).solid_angle()});
      down.positions.push_back(2 * q - 1);
    }
  });
  for (int i = 0; i < 2; ++i) {
    for (int x = 0; x < count; ++x) {
      const double p = (x + (i == 0 ? kGauss : 1 - kGauss)) / count;
      across.positions.push_back(2 * p - 1);
    }
  }
  down.weights.resize(lines.size());
  // Of both points in a cell, those of all its first points before those of its second.
  std::vector<float> factors(2 * (size_t)count), columns;
  Tilts tilts = tilts_of(grid, rect, moments);
  FittedTilts best;
  constexpr int kPasses = 3;
  for (int pass = 0; pass < kPasses; ++pass) {
    for (size_t i = 0; i < factors.size(); ++i) {
      factors[i] = (float)(1 / (1 + tilts.along * across.positions[i]));
    }
    columns.assign(factors.size(), 0.0f);
    double integral = 0, plain = 0;
    for (size_t i = 0; i < lines.size(); ++i) {
      const Line& line = lines[i];
      const double shape = 1 + tilts.down * down.positions[i];
      const SquareSums row =
          add_squares(plane.row(line.y - 1) + rect.lo[0], plane.row(line.y) + rect.lo[0], line.f,
                      count, (float)(line.solid_angle / shape), factors.data(),
                      factors.data() + count, columns.data(), columns.data() + count);
      plain += row.plain * shape;
      integral += row.weighted;
      down.weights[i] = row.weighted * shape;
    }
    integral *= plain > 0 ? moments.square / plain : 0.0;
    if (pass == 0 || integral < best.integral) best = {tilts, integral};
    if (pass + 1 == kPasses) break;
    across.weights.assign(columns.begin(), columns.end());
    const Tilts next = {across.best_tilt(tilts.along), down.best_tilt(tilts.down)};
    const double moved =
        std::max(std::abs(next.along - tilts.along), std::abs(next.down - tilts.down));
    if (moved < 0.02) break;
    tilts = next;
  }
  return best;
}

}  // namespace skytree
