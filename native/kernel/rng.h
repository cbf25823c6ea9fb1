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
//
// With blue noise the pixels share one sequence, each shifted by a point of its own: along the
// Z-order of pixels, as in A. Ahmed and P. Wonka, "Screen-Space Blue-Noise Diffusion of Monte Carlo
// Sampling Error via Hierarchical Ordering of Pixels", SIGGRAPH Asia 2020, but with a shift that
// works for every prefix of the sequence (docs/blue_noise.md), so that a preview can go on
// refining.
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

/// The digits of the Pascal matrix times those of `index`, lowest bit = first digit: digit r is the
/// sum over j <= r of C(r, j) index_j. Unlike the digits of `index`, which end, these go on: any m
/// digits from the k-th on tell apart the 2^m numbers of m bits (the matrix C(k+i, j) has
/// determinant 1).
SKY_HD uint32_t pascal_digits(uint32_t index) {
  index ^= (index << 1) & 0xaaaaaaaau;
  index ^= (index << 2) & 0xccccccccu;
  index ^= (index << 4) & 0xf0f0f0f0u;
  index ^= (index << 8) & 0xff00ff00u;
  return index ^ (index << 16);
}

/// The low 12 bits of v in the even bits.
SKY_HD uint32_t spread_bits(uint32_t v) {
  v &= 0xfffu;
  v = (v | (v << 8)) & 0x00ff00ffu;
  v = (v | (v << 4)) & 0x0f0f0f0fu;
  v = (v | (v << 2)) & 0x33333333u;
  return (v | (v << 1)) & 0x55555555u;
}

/// 24 bits to [0,1): the result is exact and never rounds up to 1.
SKY_HD float unit_float(uint32_t v) {
  return static_cast<float>(static_cast<int32_t>(v >> 8)) * (1.0f / 16777216.0f);
}

/// Set in the seeds of pixels that share a sequence.
constexpr uint32_t kBlueNoiseSeed = 0x80000000u;

/// What distinguishes one pixel's sequences from another's; x and y are absolute pixel coordinates.
/// With blue_noise it is the pixel's place in the Z-order of a plane of which every `seed` shows
/// another part; it repeats after 4096 pixels.
SKY_HD uint32_t pixel_seed(uint32_t seed, uint32_t x, uint32_t y, bool blue_noise = false) {
  if (blue_noise) {
    // The lowest bit pairs neighbours whose errors differ most: side by side in some quads, one
    // above the other in the rest, or the noise would have a grain.
    const uint32_t place = (spread_bits(x) | spread_bits(y) << 1) ^ hash_u32(seed);
    const uint32_t turned = (place ^ (place >> 1)) & hash_u32(place >> 2) & 1u;
    return kBlueNoiseSeed | (place ^ (turned | turned << 1));
  }
  return hash_u32(x + hash_u32(y + hash_u32(seed + 0x9e3779b9u))) & ~kBlueNoiseSeed;
}

SKY_HD bool has_blue_noise(uint32_t pixel_seed) { return (pixel_seed & kBlueNoiseSeed) != 0; }

/// Separately hashed seeds: scrambles that share low seed bits flip the same leading digits, which
/// couples the index with x and y and undoes the stratification across pairs.
SKY_HD uint32_t index_scramble(uint32_t base) { return hash_u32(base); }
SKY_HD uint32_t x_scramble(uint32_t base) { return hash_u32(base ^ 0x55d35a81u); }
SKY_HD uint32_t y_scramble(uint32_t base) { return hash_u32(base ^ 0xa3c59ac3u); }
SKY_HD uint32_t pixel_scramble(uint32_t base) { return hash_u32(base ^ 0x68e31da4u); }

/// An index shuffled so that every aligned power of two of them stays together.
SKY_HD uint32_t shuffled_index(uint32_t index, uint32_t seed) {
  return reverse_bits(owen_scramble_reversed(reverse_bits(index), seed));
}

/// Point `index` of the sequence `pair` of a pixel without blue noise.
SKY_HD Vec2 hashed_pair(uint32_t pixel_seed, uint32_t index, uint32_t pair) {
  const uint32_t base = pixel_seed + pair * 0x9e3779b9u;
  const uint32_t shuffled = shuffled_index(index, index_scramble(base));
  const uint32_t x = owen_scramble_reversed(shuffled, x_scramble(base));
  const uint32_t y = owen_scramble_reversed(sobol_second_reversed(shuffled), y_scramble(base));
  return {unit_float(reverse_bits(x)), unit_float(reverse_bits(y))};
}

/// Point `index` of the sequence `pair` of a pixel with blue noise. Pixels are shuffled anew for
/// each pair, or the pairs of neighbours would hang together. The scrambles are the same for all
/// pixels, so that a loop over pixels computes them once.
SKY_HD Vec2 blue_noise_pair(uint32_t pixel_seed, uint32_t index, uint32_t pair) {
  const uint32_t base = 0x2545f491u + pair * 0x9e3779b9u;
  const uint32_t shuffled = shuffled_index(index, index_scramble(base));
  const uint32_t pixel = shuffled_index(pixel_seed & ~kBlueNoiseSeed, pixel_scramble(base));
  const uint32_t x = shuffled ^ pascal_digits(pixel);
  const uint32_t y = sobol_second_reversed(shuffled) ^ pascal_digits(sobol_second_reversed(pixel));
  return {unit_float(reverse_bits(owen_scramble_reversed(x, x_scramble(base)))),
          unit_float(reverse_bits(owen_scramble_reversed(y, y_scramble(base))))};
}

/// random_pair without a call, for loops that do little else.
SKY_HD Vec2 inlined_random_pair(uint32_t pixel_seed, uint32_t index, uint32_t pair) {
  return has_blue_noise(pixel_seed) ? blue_noise_pair(pixel_seed, index, pair)
                                    : hashed_pair(pixel_seed, index, pair);
}

/// Point `index` of the sequence `pair` of a pixel, in [0,1)^2.
SKY_HD_CALL Vec2 random_pair(uint32_t pixel_seed, uint32_t index, uint32_t pair) {
  return inlined_random_pair(pixel_seed, index, pair);
}

}  // namespace skytree
