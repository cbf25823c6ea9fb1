// SPDX-License-Identifier: GPL-3.0-or-later
// Moments of texels, row by row, from rows of luminance. Pointers are to the first texel; its left
// neighbour and the last one's right neighbour are read too.
#pragma once

namespace skytree {

/// Mean over each texel of L, with L linear between texel centres: [1 6 1]/8 across and down.
void interpolated_power(const float* above, const float* centre, const float* below, int count,
                        float weight, float* out);

/// Mean over each texel of L^2. In one dimension it is (a^2 + c^2 + 4b(a + c) + 14b^2)/24 =
/// ((a + 2b)^2 + (c + 2b)^2 + 6b^2)/24, in two the product of both forms.
void interpolated_square(const float* above, const float* centre, const float* below, int count,
                         float weight, float* out);

/// Row weights of a cell between texel centres, with f the way from its upper to its lower row of
/// centres: integrals of 1 - f and f, and of (1 - f)^2, f (1 - f) and f^2, over solid angle.
struct CellRow {
  double upper = 0, lower = 0;
  double upper_square = 0, product = 0, lower_square = 0;

  double solid_angle() const { return upper + lower; }
};

/// A CellRow's as factors of cell_power's and cell_square's sums.
struct CellFactors {
  float upper, lower, upper_square, product, lower_square;

  explicit CellFactors(const CellRow& row);
};

/// Integrals over cells of L and L^2, L bilinear: cell x lies between columns x and x + 1.
void cell_power(const float* upper, const float* lower, int count, const CellFactors& row,
                float* out);
void cell_square(const float* upper, const float* lower, int count, const CellFactors& row,
                 float* out);

/// The pixel's own value and its square.
void pixel_power(const float* centre, int count, float* out);
void pixel_square(const float* centre, int count, float* out);

/// sums[i] += values[i].
void add_row(const float* values, int count, float* sums);

/// out[t] = sum of the t-th 16 values; the last tile may be shorter.
void sum_tiles(const float* values, int count, float* out);

}  // namespace skytree
