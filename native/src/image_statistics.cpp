// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/image_statistics.h"

#include <algorithm>
#include <cstring>

namespace skytree {
namespace {

constexpr int kTile = ImageStatistics::kTile;

/// Power and square of a row of texels from luminances with one more at either end.
///
/// The mean of L over a texel, L linear between texel centres, is (a + 6b + c)/8 in one dimension;
/// the mean of L^2 is (a^2 + c^2 + 4b(a + c) + 14b^2)/24 = ((a + 2b)^2 + (c + 2b)^2 + 6b^2)/24. In
/// two dimensions both are products.
void interpolated_moments(const float* __restrict above, const float* __restrict centre,
                          const float* __restrict below, int count, float weight,
                          float* __restrict power, float* __restrict square) {
  const float power_weight = weight / 64.0f;
  const float square_weight = weight / 576.0f;
  for (int x = 0; x < count; ++x) {
    const float b0 = centre[x], b1 = centre[x + 1], b2 = centre[x + 2];
    const float p0 = above[x] + 2 * b0, p1 = above[x + 1] + 2 * b1, p2 = above[x + 2] + 2 * b2;
    const float q0 = below[x] + 2 * b0, q1 = below[x + 1] + 2 * b1, q2 = below[x + 2] + 2 * b2;
    const float s0 = p0 + q0 + 2 * b0, s1 = p1 + q1 + 2 * b1, s2 = p2 + q2 + 2 * b2;
    power[x] = power_weight * (s0 + s2 + 6 * s1);
    const float pl = p0 + 2 * p1, pr = p2 + 2 * p1;
    const float ql = q0 + 2 * q1, qr = q2 + 2 * q1;
    const float bl = b0 + 2 * b1, br = b2 + 2 * b1;
    square[x] = square_weight * ((pl * pl + pr * pr) + (ql * ql + qr * qr) +
                                 6 * ((p1 * p1 + q1 * q1) + (bl * bl + br * br) + 6 * b1 * b1));
  }
}

void pixel_moments(const float* __restrict centre, int count, float* __restrict power,
                   float* __restrict square) {
  for (int x = 0; x < count; ++x) {
    power[x] = centre[x + 1];
    square[x] = centre[x + 1] * centre[x + 1];
  }
}

void wrap_ends(float* row, int width) {
  row[0] = row[width];
  row[width + 1] = row[1];
}

}  // namespace

struct ImageStatistics::Patch {
  float power[kTile * kTile], square[kTile * kTile];
};

ImageStatistics::ImageStatistics(const LatLongImage& image, Statistics statistics,
                                 const std::function<void(double)>& keep_going)
    : image_(image), statistics_(statistics) {
  check_image(image);
  row_weights_ = statistics == Statistics::PIXELS ? std::vector<double>(image.height, 1.0)
                                                  : row_solid_angles(image.width, image.height);
  cumulative_rows_.assign(image.height + 1, 0.0);
  for (int y = 0; y < image.height; ++y) {
    cumulative_rows_[y + 1] = cumulative_rows_[y] + row_weights_[y];
  }
  build(keep_going);
}

int32_t ImageStatistics::border(int axis, int index) const {
  return std::min(index * kTile, extent(axis));
}

void ImageStatistics::build(const std::function<void(double)>& keep_going) {
  const int width = image_.width, height = image_.height;
  const int columns = (width + kTile - 1) / kTile, rows = (height + kTile - 1) / kTile;
  tables_[0].reset(new Moments[(int64_t)(rows + 1) * (width + 1)]);
  tables_[1].reset(new Moments[(int64_t)(columns + 1) * (height + 1)]);
  for (int x = 0; x <= width; ++x) tables_[0][x] = Moments{};
  for (int y = 0; y <= height; ++y) tables_[1][y] = Moments{};
  for (int t = 0; t <= columns; ++t) tables_[1][(int64_t)t * (height + 1)] = Moments{};

  std::vector<float> luminance[3];
  for (auto& row : luminance) row.resize(width + 2);
  float* above = luminance[0].data();
  float* centre = luminance[1].data();
  float* below = luminance[2].data();
  std::vector<float> power(width), square(width), strip_power(width), strip_square(width);
  std::vector<Moments> prefix((int64_t)kTile * (columns + 1));  // of the strip's rows, over tiles

  const auto load = [&](int y, float* row) {
    luminance_row(image_, y, row + 1, &bad_);
    wrap_ends(row, width);
  };
  load(0, centre);
  std::copy(centre, centre + width + 2, above);
  for (int strip = 0; strip < rows; ++strip) {
    keep_going((double)strip / rows);
    const int first = strip * kTile, last = std::min(first + kTile, height);
    std::fill(strip_power.begin(), strip_power.end(), 0.0f);
    std::fill(strip_square.begin(), strip_square.end(), 0.0f);
    for (int y = first; y < last; ++y) {
      if (y + 1 < height) {
        load(y + 1, below);
      } else {
        std::copy(centre, centre + width + 2, below);
      }
      if (statistics_ == Statistics::PIXELS) {
        pixel_moments(centre, width, power.data(), square.data());
      } else {
        interpolated_moments(above, centre, below, width, (float)row_weights_[y], power.data(),
                             square.data());
      }
      for (int x = 0; x < width; ++x) strip_power[x] += power[x];
      for (int x = 0; x < width; ++x) strip_square[x] += square[x];
      Moments* sums = &prefix[(int64_t)(y - first) * (columns + 1)];
      Moments run{};
      for (int t = 0; t < columns; ++t) {
        const int begin = t * kTile, end = std::min(begin + kTile, width);
        float p = 0, q = 0;
        for (int x = begin; x < end; ++x) p += power[x], q += square[x];
        run = run + Moments{p, q};
        sums[t + 1] = run;
      }
      float* spare = above;
      above = centre;
      centre = below;
      below = spare;
    }
    for (int t = 1; t <= columns; ++t) {
      Moments* column = &tables_[1][(int64_t)t * (height + 1)];
      for (int y = first; y < last; ++y) {
        column[y + 1] = column[y] + prefix[(int64_t)(y - first) * (columns + 1) + t];
      }
    }
    const Moments* upper = &tables_[0][(int64_t)strip * (width + 1)];
    Moments* lower = &tables_[0][(int64_t)(strip + 1) * (width + 1)];
    Moments run{};
    lower[0] = Moments{};
    for (int x = 0; x < width; ++x) {
      run = run + Moments{strip_power[x], strip_square[x]};
      lower[x + 1] = upper[x + 1] + run;
    }
  }
}

void ImageStatistics::load_patch(const TexelRect& rect, Patch* patch) const {
  float rows[3][kTile + 2];
  float* above = rows[0];
  float* centre = rows[1];
  float* below = rows[2];
  const int width = image_.width, height = image_.height;
  const int count = rect.size(0);
  const auto load = [&](int y, float* row) {
    y = std::clamp(y, 0, height - 1);
    const float* texels = image_.texels + 3 * (int64_t)y * width;
    for (int i = 0; i < count + 2; ++i) {
      const int x = (rect.lo[0] + i - 1 + width) % width;
      row[i] = texel_luminance(texels + 3 * (int64_t)x);
    }
  };
  load(rect.lo[1] - 1, above);
  load(rect.lo[1], centre);
  for (int y = rect.lo[1]; y < rect.hi[1]; ++y) {
    load(y + 1, below);
    float* power = patch->power + (y - rect.lo[1]) * kTile;
    float* square = patch->square + (y - rect.lo[1]) * kTile;
    if (statistics_ == Statistics::PIXELS) {
      pixel_moments(centre, count, power, square);
    } else {
      interpolated_moments(above, centre, below, count, (float)row_weights_[y], power, square);
    }
    float* spare = above;
    above = centre;
    centre = below;
    below = spare;
  }
}

Moments ImageStatistics::texel_sum(const TexelRect& rect) const {
  Moments total{};
  Patch patch;
  for (int y = rect.lo[1]; y < rect.hi[1]; y += kTile) {
    for (int x = rect.lo[0]; x < rect.hi[0]; x += kTile) {
      const TexelRect part = {{x, y},
                              {std::min(x + kTile, rect.hi[0]), std::min(y + kTile, rect.hi[1])}};
      load_patch(part, &patch);
      for (int j = 0; j < part.size(1); ++j) {
        for (int i = 0; i < part.size(0); ++i) {
          total.power += patch.power[j * kTile + i];
          total.square += patch.square[j * kTile + i];
        }
      }
    }
  }
  return total;
}

Moments ImageStatistics::aligned_sum(const TexelRect& rect, int axis) const {
  const int other = 1 - axis;
  const int first = first_border_from(rect.lo[axis]), last = first_border_from(rect.hi[axis]);
  const Moments sum = (table(other, last, rect.hi[other]) - table(other, last, rect.lo[other])) -
                      (table(other, first, rect.hi[other]) - table(other, first, rect.lo[other]));
  return {std::max(sum.power, 0.0), std::max(sum.square, 0.0)};
}

Moments ImageStatistics::thin_sum(const TexelRect& rect) const {
  if (rect.area() <= 0) return {};
  const int first = first_border_from(rect.lo[0]), last = last_border_until(0, rect.hi[0]);
  if (first >= last) return texel_sum(rect);
  TexelRect left = rect, inner = rect, right = rect;
  left.hi[0] = inner.lo[0] = border(0, first);
  right.lo[0] = inner.hi[0] = border(0, last);
  return aligned_sum(inner, 0) + texel_sum(left) + texel_sum(right);
}

Moments ImageStatistics::sum(const TexelRect& rect) const {
  const int first = first_border_from(rect.lo[1]), last = last_border_until(1, rect.hi[1]);
  if (first >= last) return thin_sum(rect);
  TexelRect top = rect, inner = rect, bottom = rect;
  top.hi[1] = inner.lo[1] = border(1, first);
  bottom.lo[1] = inner.hi[1] = border(1, last);
  return aligned_sum(inner, 1) + thin_sum(top) + thin_sum(bottom);
}

void ImageStatistics::slices(const TexelRect& rect, int axis, Moments* out) const {
  const int other = 1 - axis;
  const int count = rect.size(axis);
  std::fill(out, out + count, Moments{});
  Patch patch;
  const auto add_texels = [&](int32_t from, int32_t to) {
    for (int32_t c = from; c < to; c += kTile) {
      TexelRect part = rect;
      part.lo[other] = c;
      part.hi[other] = std::min(c + kTile, to);
      load_patch(part, &patch);
      for (int j = 0; j < part.size(1); ++j) {
        for (int i = 0; i < part.size(0); ++i) {
          Moments& slice = out[axis == 0 ? i : j];
          slice.power += patch.power[j * kTile + i];
          slice.square += patch.square[j * kTile + i];
        }
      }
    }
  };
  const int first = first_border_from(rect.lo[other]),
            last = last_border_until(other, rect.hi[other]);
  if (first >= last) {
    add_texels(rect.lo[other], rect.hi[other]);
    return;
  }
  for (int i = 0; i < count; ++i) {
    TexelRect part = rect;
    part.lo[axis] = rect.lo[axis] + i;
    part.hi[axis] = part.lo[axis] + 1;
    part.lo[other] = border(other, first);
    part.hi[other] = border(other, last);
    out[i] = aligned_sum(part, other);
  }
  add_texels(rect.lo[other], border(other, first));
  add_texels(border(other, last), rect.hi[other]);
}

}  // namespace skytree
