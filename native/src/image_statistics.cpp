// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/image_statistics.h"

#include <algorithm>
#include <cmath>

namespace skytree {
namespace {

constexpr int kTile = ImageStatistics::kTile;
// In columns, of a piece of work: some pages.
constexpr int kColumns = 1024;

/// Weights of a cell in row y, by Gauss and Legendre with 3 points a piece of at most an eighth of
/// a turn. Between the pole and the first centres the map is level: both rows are the same there.
CellRow make_cell_row(const TreeGrid& grid, int y) {
  constexpr double kPiDouble = 3.14159265358979323846;
  const double scale = kPiDouble / (2 * grid.height);
  const double from = scale * grid.half_texels(y), to = scale * grid.half_texels(y + 1);
  CellRow row;
  constexpr double kPoints[] = {0.5 - 0.3872983346207417, 0.5, 0.5 + 0.3872983346207417};
  constexpr double kWeights[] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
  constexpr int kPieces = 4;
  for (int piece = 0; piece < kPieces; ++piece) {
    for (int i = 0; i < 3; ++i) {
      const double f = (piece + kPoints[i]) / kPieces;
      const double w = 2.0 * kPiDouble / grid.width * kWeights[i] * (to - from) / kPieces *
                       std::sin(from + f * (to - from));
      row.upper += w * (1 - f);
      row.lower += w * f;
      row.upper_square += w * (1 - f) * (1 - f);
      row.product += w * f * (1 - f);
      row.lower_square += w * f * f;
    }
  }
  return row;
}

}  // namespace

/// What a thread needs to sum a strip.
struct StripSums {
  StripSums(int width, int columns)
      : values(width), strip(width), tiles(columns), prefix((size_t)kTile * (columns + 1)) {}

  std::vector<float> values;   // of the current row
  std::vector<float> strip;    // of the strip so far, by column
  std::vector<float> tiles;    // of the current row
  std::vector<double> prefix;  // over tiles, for each row of the strip
};

ImageStatistics::ImageStatistics(std::shared_ptr<const LuminancePlane> luminance,
                                 Statistics statistics, ThreadTeam& team,
                                 const std::function<void(double)>& keep_going)
    : plane_(std::move(luminance)),
      statistics_(statistics),
      grid_{plane_->width(), plane_->height(), statistics == Statistics::CELLS} {
  switch (statistics) {
    case Statistics::PIXELS:
      row_weights_.assign(grid_.height, 1.0);
      break;
    case Statistics::RADIANCE:
      row_weights_ = row_solid_angles(grid_.width, grid_.height);
      break;
    case Statistics::CELLS:
      for (int y = 0; y < grid_.rows(); ++y) {
        cell_rows_.push_back(make_cell_row(grid_, y));
        cell_factors_.emplace_back(cell_rows_.back());
        row_weights_.push_back(cell_rows_.back().solid_angle());
      }
      break;
  }
  cumulative_rows_.assign(grid_.rows() + 1, 0.0);
  for (int y = 0; y < grid_.rows(); ++y) {
    cumulative_rows_[y + 1] = cumulative_rows_[y] + row_weights_[y];
  }
  build(team, keep_going);
}

int32_t ImageStatistics::border(int axis, int index) const {
  return std::min(index * kTile, extent(axis));
}

size_t ImageStatistics::nbytes() const {
  size_t bytes = 0;
  for (const auto& quantity : tables_) bytes += quantity[0].nbytes() + quantity[1].nbytes();
  return bytes;
}

void ImageStatistics::build(ThreadTeam& team, const std::function<void(double)>& keep_going) {
  const int width = grid_.width, height = grid_.rows();
  const int columns = (width + kTile - 1) / kTile, rows = (height + kTile - 1) / kTile;
  for (auto& quantity : tables_) {
    quantity[0] = LargeArray<double>((size_t)(rows + 1) * (width + 1));
    quantity[1] = LargeArray<double>((size_t)(columns + 1) * (height + 1));
    std::fill_n(quantity[0].data(), width + 1, 0.0);
    std::fill_n(quantity[1].data(), height + 1, 0.0);
  }
  std::vector<StripSums> sums(team.size(), StripSums(width, columns));
  team.run(rows, [&](int worker, int strip) {
    if (worker == 0) keep_going((double)strip / rows);
    sum_strip(strip, &sums[worker]);
  });

  // Now add up, strip by strip and row by row.
  const int chunks = width / kColumns + 1;
  team.run(2 * (chunks + columns), [&](int, int piece) {
    LargeArray<double>* tables = tables_[piece % 2];
    piece /= 2;
    if (piece < chunks) {
      const int first = piece * kColumns, last = std::min(first + kColumns, width + 1);
      for (int strip = 0; strip < rows; ++strip) {
        const double* __restrict upper = &tables[0][(int64_t)strip * (width + 1)];
        double* __restrict lower = &tables[0][(int64_t)(strip + 1) * (width + 1)];
        for (int x = first; x < last; ++x) lower[x] = upper[x] + lower[x];
      }
    } else {
      double* column = &tables[1][(int64_t)(piece - chunks + 1) * (height + 1)];
      for (int y = 0; y < height; ++y) column[y + 1] = column[y] + column[y + 1];
    }
  });
}

void ImageStatistics::sum_strip(int strip, StripSums* sums) {
  const int width = grid_.width, height = grid_.rows(), columns = (int)sums->tiles.size();
  const int first = strip * kTile, last = std::min(first + kTile, height);
  for (Quantity quantity : {Quantity::POWER, Quantity::SQUARE}) {
    LargeArray<double>* tables = tables_[(int)quantity];
    std::fill(sums->strip.begin(), sums->strip.end(), 0.0f);
    for (int y = first; y < last; ++y) {
      moments_of_row(0, y, width, quantity, sums->values.data());
      add_row(sums->values.data(), width, sums->strip.data());
      sum_tiles(sums->values.data(), width, sums->tiles.data());
      double* prefix = &sums->prefix[(size_t)(y - first) * (columns + 1)];
      double run = 0;
      for (int t = 0; t < columns; ++t) prefix[t + 1] = run += sums->tiles[t];
    }
    for (int t = 1; t <= columns; ++t) {
      double* column = &tables[1][(int64_t)t * (height + 1)];
      const double* prefix = &sums->prefix[t];
      if (strip == 0) column[0] = 0.0;
      for (int y = first; y < last; ++y) {
        column[y + 1] = prefix[(size_t)(y - first) * (columns + 1)];
      }
    }
    double* row = &tables[0][(int64_t)(strip + 1) * (width + 1)];
    double run = 0;
    row[0] = 0;
    for (int x = 0; x < width; ++x) row[x + 1] = run += sums->strip[x];
  }
}

void ImageStatistics::moments_of_row(int x, int y, int count, Quantity quantity, float* out) const {
  const float* centre = plane_->row(y) + x;
  if (statistics_ == Statistics::PIXELS) {
    (quantity == Quantity::POWER ? pixel_power : pixel_square)(centre, count, out);
  } else if (statistics_ == Statistics::CELLS) {
    const auto moments = quantity == Quantity::POWER ? cell_power : cell_square;
    moments(plane_->row(y - 1) + x, centre, count, cell_factors_[y], out);
  } else {
    const auto moments = quantity == Quantity::POWER ? interpolated_power : interpolated_square;
    moments(plane_->row(y - 1) + x, centre, plane_->row(y + 1) + x, count, (float)row_weights_[y],
            out);
  }
}

void ImageStatistics::load_patch(const TexelRect& rect, Quantity quantity, float* values) const {
  // Whole vectors; the luminance has as much slack at the end of its rows.
  static_assert(LuminancePlane::kSlack >= 8 && kTile % 8 == 0);
  const int count = (rect.size(0) + 7) / 8 * 8;
  // Hardly ever in a cache, and each row in a page of its own.
  for (int y = rect.lo[1] - 1; y <= rect.hi[1]; ++y) {
    const float* row = plane_->row(y) + rect.lo[0];
    __builtin_prefetch(row);
    __builtin_prefetch(row + count);
  }
  for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
    moments_of_row(rect.lo[0], y, count, quantity, values + (y - rect.lo[1]) * kTile);
  }
}

Moments ImageStatistics::corner_sum(const TexelRect& rect, CornerSums* known) const {
  if (rect.area() <= 0) return {};
  const uint64_t key = (uint64_t)rect.lo[0] | (uint64_t)rect.lo[1] << 16 |
                       (uint64_t)rect.hi[0] << 32 | (uint64_t)rect.hi[1] << 48;
  CornerSums::Slot* slot = known ? &known->slot(key) : nullptr;
  if (slot && slot->key == key) return slot->sum;
  double total[2] = {0, 0};
  float values[kTile * kTile];
  for (Quantity quantity : {Quantity::POWER, Quantity::SQUARE}) {
    load_patch(rect, quantity, values);
    for (int j = 0; j < rect.size(1); ++j) {
      for (int i = 0; i < rect.size(0); ++i) total[(int)quantity] += values[j * kTile + i];
    }
  }
  const Moments sum = {total[0], total[1]};
  if (slot) *slot = {key, sum};
  return sum;
}

double ImageStatistics::aligned_sum(const TexelRect& rect, int axis, Quantity quantity) const {
  const int other = 1 - axis;
  const int64_t stride = extent(other) + 1;
  const double* table = tables_[(int)quantity][other].data();
  const double* first = table + first_border_from(rect.lo[axis]) * stride;
  const double* last = table + first_border_from(rect.hi[axis]) * stride;
  const int lo = rect.lo[other], hi = rect.hi[other];
  return std::max((last[hi] - last[lo]) - (first[hi] - first[lo]), 0.0);
}

Moments ImageStatistics::aligned_moments(const TexelRect& rect, int axis) const {
  return {aligned_sum(rect, axis, Quantity::POWER), aligned_sum(rect, axis, Quantity::SQUARE)};
}

/// The part of a rectangle between the outermost tile borders inside it along an axis. Without a
/// border inside it is empty, at the rectangle's start; with one, empty at that border.
TexelRect ImageStatistics::inner_part(const TexelRect& rect, int axis) const {
  const int first = first_border_from(rect.lo[axis]), last = last_border_until(axis, rect.hi[axis]);
  TexelRect inner = rect;
  inner.lo[axis] = first <= last ? border(axis, first) : rect.lo[axis];
  inner.hi[axis] = first <= last ? border(axis, last) : rect.lo[axis];
  return inner;
}

Moments ImageStatistics::thin_sum(const TexelRect& rect, CornerSums* known) const {
  if (rect.size(1) == 0) return {};
  const TexelRect inner = inner_part(rect, 0);
  TexelRect left = rect, right = rect;
  left.hi[0] = inner.lo[0];
  right.lo[0] = inner.hi[0];
  const Moments rim = corner_sum(left, known) + corner_sum(right, known);
  return inner.size(0) > 0 ? rim + aligned_moments(inner, 0) : rim;
}

Moments ImageStatistics::sum(const TexelRect& rect, CornerSums* known) const {
  const TexelRect inner = inner_part(rect, 1);
  TexelRect top = rect, bottom = rect;
  top.hi[1] = inner.lo[1];
  bottom.lo[1] = inner.hi[1];
  const Moments rim = thin_sum(top, known) + thin_sum(bottom, known);
  return inner.size(1) > 0 ? rim + aligned_moments(inner, 1) : rim;
}

void ImageStatistics::inner_slices(const TexelRect& rect, int axis, Quantity quantity,
                                   double* out) const {
  const int other = 1 - axis, count = rect.size(axis);
  const TexelRect inner = inner_part(rect, other);
  if (inner.size(other) == 0) {
    std::fill(out, out + count, 0.0);
    return;
  }
  const int64_t stride = extent(axis) + 1;
  const double* table = tables_[(int)quantity][axis].data() + rect.lo[axis];
  const double* first = table + first_border_from(inner.lo[other]) * stride;
  const double* last = table + first_border_from(inner.hi[other]) * stride;
  for (int i = 0; i < count; ++i) {
    out[i] = std::max((last[i + 1] - last[i]) - (first[i + 1] - first[i]), 0.0);
  }
}

void ImageStatistics::add_rim_slices(const TexelRect& rect, int axis, Quantity quantity,
                                     double* out) const {
  const int other = 1 - axis;
  const TexelRect inner = inner_part(rect, other);
  float values[kTile * kTile];
  const auto add_part = [&](int32_t from, int32_t to) {
    if (from == to) return;
    TexelRect part = rect;
    part.lo[other] = from;
    part.hi[other] = to;
    load_patch(part, quantity, values);
    for (int j = 0; j < part.size(1); ++j) {
      for (int i = 0; i < part.size(0); ++i) out[axis == 0 ? i : j] += values[j * kTile + i];
    }
  };
  add_part(rect.lo[other], inner.lo[other]);
  add_part(inner.hi[other], rect.hi[other]);
}

}  // namespace skytree
