// SPDX-License-Identifier: GPL-3.0-or-later
// Correlated multi-jittered points: N points, known beforehand, of which each lies alone in its
// cell of a grid of m columns, in its Nth part of x and in its Nth part of y. What takes their
// place in a sequence of any length is Sobol' (kernel/rng.h).
//
// A. Kensler, "Correlated Multi-Jittered Sampling", Pixar Technical Memo 13-01, 2013. Two choices
// differ: the permutations, and that with powers of two all is done in integers, so that points are
// exactly where they should be and loops over pixels have no branches.
#pragma once

#include "kernel/math.h"
#include "kernel/rng.h"

namespace skytree {

/// A permutation of 0..mask, mask + 1 = 2^bits, that `key` chooses: every step can be undone. With
/// fewer rounds small sets get some permutations much more often than others.
SKY_HD uint32_t permute_bits(uint32_t v, uint32_t bits, uint32_t mask, uint32_t key) {
  const uint32_t half = bits > 0 ? (bits + 1) >> 1 : 1;
  for (int round = 0; round < 4; ++round) {
    v = ((v ^ (key >> 4)) * (key >> 10 | 1u)) & mask;
    v ^= v >> half;
    key = key * 0x9e3779b1u + 0x7f4a7c15u;
    v = (v + (key >> 17)) & mask;
  }
  return v;
}

/// Of the mask 2^bits - 1, by the exponent of a float.
SKY_HD uint32_t bits_of(uint32_t mask) {
  return (float_bits(static_cast<float>(static_cast<int32_t>(mask) + 1)) >> 23) - 127u;
}

/// Numbers below `count`, and the next power of two that permutations of them are made of.
struct PermutedRange {
  uint32_t count, mask, bits;
};

SKY_HD PermutedRange permuted_range(uint32_t count) {
  uint32_t mask = count - 1;
  mask |= mask >> 1;
  mask |= mask >> 2;
  mask |= mask >> 4;
  mask |= mask >> 8;
  mask |= mask >> 16;
  return {count, mask, bits_of(mask)};
}

SKY_HD uint32_t permute_once(const PermutedRange& range, uint32_t v, uint32_t key) {
  return permute_bits(v, range.bits, range.mask, key);
}

/// A permutation of 0..count-1: that of the power of two, walked along until it is back.
SKY_HD uint32_t permute_index(const PermutedRange& range, uint32_t v, uint32_t key) {
  do v = permute_once(range, v, key);
  while (v >= range.count);
  return v;
}

/// What the keys of one set of points are for, each hashed by itself.
enum JitterKey : uint32_t {
  kIndexKey = 0x51633e2du,
  kColumnKey = 0xa511e9b3u,
  kRowKey = 0x63d83595u,
  kXKey = 0xa399d265u,
  kYKey = 0x711ad6a5u
};

SKY_HD uint32_t jitter_key(uint32_t pixel_seed, uint32_t pair, JitterKey use) {
  return hash_u32((pixel_seed + pair * 0x9e3779b9u) ^ use);
}

/// Sets of fewer points keep enough digits for where a point lies in its cell.
constexpr uint32_t kLargestJitteredSet = 1u << 22;

SKY_HD bool is_power_of_two(uint32_t count) { return (count & (count - 1)) == 0; }

/// Point `index` of a set of 2^bits.
SKY_HD Vec2 jittered_power_pair(uint32_t pixel_seed, uint32_t index, uint32_t pair, uint32_t bits) {
  const auto key = [&](JitterKey use) { return jitter_key(pixel_seed, pair, use); };
  const uint32_t column_bits = bits >> 1, row_bits = bits - column_bits;
  const uint32_t column_mask = (1u << column_bits) - 1u;
  const uint32_t place = permute_bits(index, bits, (1u << bits) - 1u, key(kIndexKey));
  const uint32_t column =
      permute_bits(place & column_mask, column_bits, column_mask, key(kColumnKey));
  const uint32_t row =
      permute_bits(place >> column_bits, row_bits, (1u << row_bits) - 1u, key(kRowKey));
  // In units of 2^-24.
  const uint32_t x = (column << row_bits | row) << (24u - bits);
  const uint32_t y = place << (24u - bits);
  const uint32_t in_cell = (1u << (24u - bits)) - 1u;
  return {unit_float((x | (hash_u32(place ^ key(kXKey)) & in_cell)) << 8),
          unit_float((y | (hash_u32(place ^ key(kYKey)) & in_cell)) << 8)};
}

/// The grid of a set that is no power of two.
struct JitteredGrid {
  PermutedRange places, columns, rows;
};

/// Columns: the factor of `count` nearest to its root if it is not much smaller, or the root; then
/// some cells stay empty.
SKY_HD JitteredGrid jittered_grid(uint32_t count) {
  uint32_t root = static_cast<uint32_t>(sqrtf(static_cast<float>(count)));
  while (root * root > count) --root;
  uint32_t columns = root;
  while (count % columns != 0 && 2 * columns > root) --columns;
  if (count % columns != 0) columns = root;
  return {permuted_range(count), permuted_range(columns),
          permuted_range((count + columns - 1) / columns)};
}

/// The row of a place; float division is exact enough for kLargestJitteredSet, and vectorises.
SKY_HD uint32_t row_of_place(const JitteredGrid& grid, uint32_t place) {
  return static_cast<uint32_t>(
      static_cast<int32_t>(static_cast<float>(static_cast<int32_t>(place)) /
                           static_cast<float>(static_cast<int32_t>(grid.columns.count))));
}

/// The point of a place whose column and row are permuted.
SKY_HD Vec2 point_of_place(const JitteredGrid& grid, uint32_t place, uint32_t column, uint32_t row,
                           uint32_t pixel_seed, uint32_t pair) {
  const float x = unit_float(hash_u32(place ^ jitter_key(pixel_seed, pair, kXKey)));
  const float y = unit_float(hash_u32(place ^ jitter_key(pixel_seed, pair, kYKey)));
  const auto part = [](uint32_t i, float in_part, uint32_t parts) {
    return minf((static_cast<float>(static_cast<int32_t>(i)) + in_part) /
                    static_cast<float>(static_cast<int32_t>(parts)),
                kOneMinusEpsilon);
  };
  return {part(column * grid.rows.count + row, x, grid.columns.count * grid.rows.count),
          part(place, y, grid.places.count)};
}

/// Point `index` of a set of any number.
SKY_HD Vec2 jittered_pair(uint32_t pixel_seed, uint32_t index, uint32_t pair, uint32_t count) {
  if (is_power_of_two(count)) {
    return jittered_power_pair(pixel_seed, index, pair, bits_of(count - 1));
  }
  const auto key = [&](JitterKey use) { return jitter_key(pixel_seed, pair, use); };
  const JitteredGrid grid = jittered_grid(count);
  const uint32_t place = permute_index(grid.places, index, key(kIndexKey));
  const uint32_t row = row_of_place(grid, place), column = place - row * grid.columns.count;
  return point_of_place(grid, place, permute_index(grid.columns, column, key(kColumnKey)),
                        permute_index(grid.rows, row, key(kRowKey)), pixel_seed, pair);
}

/// Point `index` of the sequence `pair` of a pixel: of Sobol's if `count` is 0, or of a
/// multi-jittered set of `count`.
SKY_HD_CALL Vec2 sample_pair(uint32_t count, uint32_t pixel_seed, uint32_t index, uint32_t pair) {
  return count > 0 ? jittered_pair(pixel_seed, index, pair, count)
                   : inlined_random_pair(pixel_seed, index, pair);
}

}  // namespace skytree
