// SPDX-License-Identifier: GPL-3.0-or-later
// Texels drawn from an alias table: Walker 1977, built as in Vose 1991. Constant time and one or
// two cache misses, but neighbouring random numbers land far apart.
#pragma once

#include "kernel/inversion.h"

namespace skytree {

struct AliasEntry {
  float threshold;  // below it the texel itself, from it on the alias
  uint32_t alias;
  float pdf;  // of this texel, per steradian
};

struct AliasView {
  const AliasEntry* entries;  // height x width
  const RowWarp* rows;        // height
  int32_t width, height;
};

/// u.x chooses the texel; 24 bits are too few for a large map, so its low digits come from u.y, and
/// what is left of them places the point along the row.
SKY_HD uint32_t sample_alias(const AliasView& table, Vec3 u, float* offset, float* pdf) {
  const uint64_t count = (uint64_t)table.width * (uint64_t)table.height;
  const uint64_t high = (uint64_t)(u.x * 16777216.0f);
  const uint64_t low = (uint64_t)(u.y * 16777216.0f);
  const uint64_t scaled = high * count + ((low * count) >> 24);
  const uint32_t texel = (uint32_t)(scaled >> 24);
  const float remainder = (float)(scaled & 0xffffffu) * 5.9604644775390625e-8f;
  const AliasEntry entry = table.entries[texel];
  const bool own = remainder < entry.threshold;
  *offset =
      own ? remainder / entry.threshold : (remainder - entry.threshold) / (1.0f - entry.threshold);
  *pdf = own ? entry.pdf : table.entries[entry.alias].pdf;
  return own ? texel : entry.alias;
}

}  // namespace skytree
