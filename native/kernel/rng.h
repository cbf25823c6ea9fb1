// SPDX-License-Identifier: GPL-3.0-or-later
// Random numbers that depend on (seed, pixel, sample index, pair) and on nothing else: the
// two-dimensional Sobol' sequence, Owen-scrambled by hashing and padded to any number of dimension
// pairs.
//
// B. Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020 (shuffled scrambled Sobol',
// section 4). The hash inside the scrambling is N. Vegdahl's, "Building a Better LK Hash", 2021.
// The second Sobol' dimension is the Pascal matrix modulo 2, applied in log2(32) steps instead of a
// table of direction numbers: A. Ahmed, "An Implementation Algorithm of 2D Sobol Sequence Fast,
// Elegant, and Compact", EGSR 2024.
#pragma once

#include <stdint.h>

#include "kernel/vec.h"

namespace skytree {

SKY_HD uint32_t reverse_bits(uint32_t v) {
  v = (v >> 16) | (v << 16);
  v = ((v & 0xff00ff00u) >> 8) | ((v & 0x00ff00ffu) << 8);
  v = ((v & 0xf0f0f0f0u) >> 4) | ((v & 0x0f0f0f0fu) << 4);
  v = ((v & 0xccccccccu) >> 2) | ((v & 0x33333333u) << 2);
  return ((v & 0xaaaaaaaau) >> 1) | ((v & 0x55555555u) << 1);
}

/// Mixes all bits (C. Wellons' lowbias32).
SKY_HD uint32_t hash_u32(uint32_t v) {
  v ^= v >> 16;
  v *= 0x7feb352du;
  v ^= v >> 15;
  v *= 0x846ca68bu;
  return v ^ (v >> 16);
}

/// Owen scrambling of a number whose bits are stored lowest bit = first digit.
SKY_HD uint32_t owen_scramble_reversed(uint32_t v, uint32_t seed) {
  v ^= v * 0x3d20adeau;
  v += seed;
  v *= (seed >> 16) | 1u;
  v ^= v * 0x05526c56u;
  return v ^ (v * 0x53a22864u);
}

/// The second Sobol' coordinate of `index`, lowest bit = first digit.
SKY_HD uint32_t sobol_second_reversed(uint32_t index) {
  index ^= index >> 16;
  index ^= (index >> 8) & 0x00ff00ffu;
  index ^= (index >> 4) & 0x0f0f0f0fu;
  index ^= (index >> 2) & 0x33333333u;
  return index ^ ((index >> 1) & 0x55555555u);
}

/// 24 bits to [0,1): the result is exact and never rounds up to 1.
SKY_HD float unit_float(uint32_t v) {
  return static_cast<float>(static_cast<int32_t>(v >> 8)) * (1.0f / 16777216.0f);
}

/// What distinguishes one pixel's sequences from another's; x and y are absolute pixel coordinates.
SKY_HD uint32_t pixel_seed(uint32_t seed, uint32_t x, uint32_t y) {
  return hash_u32(x + hash_u32(y + hash_u32(seed + 0x9e3779b9u)));
}

/// Point `index` of the sequence `pair` of a pixel, in [0,1)^2.
SKY_HD Vec2 random_pair(uint32_t pixel_seed, uint32_t index, uint32_t pair) {
  // Three separately hashed seeds: scrambles that share low seed bits flip the same leading digits,
  // which couples the index with x and y and undoes the stratification across pairs.
  const uint32_t base = pixel_seed + pair * 0x9e3779b9u;
  const uint32_t index_seed = hash_u32(base);
  const uint32_t x_seed = hash_u32(base ^ 0x55d35a81u);
  const uint32_t y_seed = hash_u32(base ^ 0xa3c59ac3u);
  const uint32_t shuffled = reverse_bits(owen_scramble_reversed(reverse_bits(index), index_seed));
  const uint32_t x = owen_scramble_reversed(shuffled, x_seed);
  const uint32_t y = owen_scramble_reversed(sobol_second_reversed(shuffled), y_seed);
  return {unit_float(reverse_bits(x)), unit_float(reverse_bits(y))};
}

}  // namespace skytree
