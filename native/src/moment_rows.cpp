// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/moment_rows.h"

#include "src/clones.h"

namespace skytree {

SKY_CLONES void interpolated_power(const float* __restrict above, const float* __restrict centre,
                                   const float* __restrict below, int count, float weight,
                                   float* __restrict out) {
  const float scale = weight / 64.0f;
  for (int x = 0; x < count; ++x) {
    const float s0 = (above[x - 1] + below[x - 1]) + 6 * centre[x - 1];
    const float s1 = (above[x] + below[x]) + 6 * centre[x];
    const float s2 = (above[x + 1] + below[x + 1]) + 6 * centre[x + 1];
    out[x] = scale * ((s0 + s2) + 6 * s1);
  }
}

SKY_CLONES void interpolated_square(const float* __restrict above, const float* __restrict centre,
                                    const float* __restrict below, int count, float weight,
                                    float* __restrict out) {
  const float scale = weight / 576.0f;
  for (int x = 0; x < count; ++x) {
    const float b0 = 2 * centre[x - 1], b1 = centre[x], b2 = 2 * centre[x + 1];
    const float p0 = above[x - 1] + b0, p1 = above[x] + 2 * b1, p2 = above[x + 1] + b2;
    const float q0 = below[x - 1] + b0, q1 = below[x] + 2 * b1, q2 = below[x + 1] + b2;
    const float pl = p0 + 2 * p1, pr = p2 + 2 * p1;
    const float ql = q0 + 2 * q1, qr = q2 + 2 * q1;
    const float bl = 0.5f * b0 + 2 * b1, br = 0.5f * b2 + 2 * b1;
    out[x] = scale * ((pl * pl + pr * pr) + (ql * ql + qr * qr) +
                      6 * ((p1 * p1 + q1 * q1) + (bl * bl + br * br) + 6 * (b1 * b1)));
  }
}

CellFactors::CellFactors(const CellRow& row)
    : upper((float)(0.5 * row.upper)),
      lower((float)(0.5 * row.lower)),
      upper_square((float)(row.upper_square / 3)),
      product((float)(row.product / 3)),
      lower_square((float)(row.lower_square / 3)) {}

SKY_CLONES void cell_power(const float* __restrict upper, const float* __restrict lower, int count,
                           const CellFactors& row, float* __restrict out) {
  const float u = row.upper, l = row.lower;
  for (int x = 0; x < count; ++x) {
    out[x] = u * (upper[x] + upper[x + 1]) + l * (lower[x] + lower[x + 1]);
  }
}

SKY_CLONES void cell_square(const float* __restrict upper, const float* __restrict lower, int count,
                            const CellFactors& row, float* __restrict out) {
  const float uu = row.upper_square, ul = row.product, ll = row.lower_square;
  for (int x = 0; x < count; ++x) {
    const float a = upper[x], b = upper[x + 1], c = lower[x], d = lower[x + 1];
    out[x] = uu * (a * a + a * b + b * b) + ul * (a * (2 * c + d) + b * (c + 2 * d)) +
             ll * (c * c + c * d + d * d);
  }
}

SKY_CLONES void pixel_power(const float* __restrict centre, int count, float* __restrict out) {
  for (int x = 0; x < count; ++x) out[x] = centre[x];
}

SKY_CLONES void pixel_square(const float* __restrict centre, int count, float* __restrict out) {
  for (int x = 0; x < count; ++x) out[x] = centre[x] * centre[x];
}

SKY_CLONES void add_row(const float* __restrict values, int count, float* __restrict sums) {
  for (int x = 0; x < count; ++x) sums[x] += values[x];
}

SKY_CLONES void sum_tiles(const float* __restrict values, int count, float* __restrict out) {
  const int tiles = count / 16;
  for (int t = 0; t < tiles; ++t) {
    const float* v = values + 16 * t;
    float lanes[4];
    for (int i = 0; i < 4; ++i) lanes[i] = (v[i] + v[i + 4]) + (v[i + 8] + v[i + 12]);
    out[t] = (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]);
  }
  if (16 * tiles < count) {
    float sum = 0;
    for (int x = 16 * tiles; x < count; ++x) sum += values[x];
    out[tiles] = sum;
  }
}

}  // namespace skytree
